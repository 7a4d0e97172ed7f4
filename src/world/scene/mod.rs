//! What rays hit.

mod box_scene;
pub(crate) mod bricks;
mod cloud_file;
mod loaded;
mod map_builder;
mod mesh;
mod mesh_file;
mod tree;
mod voxels;

pub use box_scene::BoxScene;
pub use cloud_file::{CLOUD_ENDINGS, CloudFileError, CloudPoint, is_cloud, read_cloud};
pub(crate) use loaded::{LoadedScene, MeshFile, MeshSummary};
pub(crate) use map_builder::{MapBuilder, MapError, MapSummary};
pub use mesh::{Mesh, MeshError};
pub use mesh_file::{LoadedMesh, MESH_ENDINGS, MeshFileError, MeshUnit, UpAxis, load_mesh};
pub(crate) use mesh_file::{UNITS, plausible_units};
pub(crate) use tree::{PACKET, RayTile};
pub use voxels::{Cell, Sight, Strays, VoxelMap, VoxelMapError};

use std::sync::Arc;

use glam::DVec3;

/// A surface point that a ray reached first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, m.
    pub distance_m: f64,
    /// Unit normal, turned against the ray.
    pub normal: DVec3,
}

/// A scene in world coordinates.
///
/// ```
/// use glam::DVec3;
/// use outrigger::world::scene::{BoxScene, Scene};
///
/// let room = Scene::Box(BoxScene::closed(DVec3::ZERO, DVec3::new(6.0, 4.0, 2.5)));
/// let hit = room.cast(DVec3::new(1.0, 2.0, 1.0), DVec3::X).unwrap();
/// assert_eq!((hit.distance_m, hit.normal), (5.0, DVec3::NEG_X));
/// ```
#[derive(Clone, Debug)]
pub enum Scene {
    /// An axis-aligned box seen from inside.
    Box(BoxScene),
    /// Triangles, shared by clones.
    Mesh(Arc<Mesh>),
    /// Cells of a recording, shared by clones.
    Voxels(Arc<VoxelMap>),
}

impl Scene {
    /// First surface along a ray (unit direction), or none.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        match self {
            Scene::Box(scene) => scene.cast(origin_m, direction),
            Scene::Mesh(scene) => scene.cast(origin_m, direction),
            Scene::Voxels(scene) => scene.cast(origin_m, direction),
        }
    }

    /// First surfaces along many rays (unit directions), in the order given; `report` gets the index of each ray.
    /// Fastest when rays that stand side by side in the slices point side by side.
    pub fn cast_many(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<Hit>),
    ) {
        match self {
            Scene::Mesh(scene) => scene.cast_many(origins_m, directions, report),
            Scene::Box(_) | Scene::Voxels(_) => {
                for (index, (origin, direction)) in origins_m.iter().zip(directions).enumerate() {
                    report(index, self.cast(*origin, *direction));
                }
            }
        }
    }

    /// Whether nothing stands between two points, but for what is nearer than `tolerance_m` to the second.
    pub(crate) fn sees(&self, from_m: DVec3, to_m: DVec3, tolerance_m: f64) -> bool {
        let step_m = to_m - from_m;
        let length_m = step_m.length();
        length_m > 0.0
            && self.cast(from_m, step_m / length_m).is_none_or(|hit| hit.distance_m >= length_m - tolerance_m)
    }

    /// Least axis-aligned box around every surface, m.
    pub fn bounds_m(&self) -> [DVec3; 2] {
        match self {
            Scene::Box(scene) => [scene.min_m, scene.max_m],
            Scene::Mesh(scene) => scene.bounds_m(),
            Scene::Voxels(scene) => scene.bounds_m(),
        }
    }
}
