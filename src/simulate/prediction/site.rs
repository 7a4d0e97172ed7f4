//! Where a rig is driven: the scene, the path through it, the grid that counts it.

use glam::DVec3;

use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::{LoadedScene, Scene};
use crate::world::surface::{ObservableSurface, SurfaceSamples};
use crate::world::trajectory::Trajectory;

/// A scene and a trajectory through it.
pub(crate) struct Site {
    pub loaded: LoadedScene,
    pub trajectory: Trajectory,
    pub grid: VoxelGrid,
}

/// Most voxels of the walls of a room, which are held one by one (half a GiB).
const MAX_WALL_VOXELS: f64 = 67_108_864.0;

/// Why a scene has no such grid.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TooManyVoxels {
    #[error("--voxel {voxel_m} makes {cells:.0} cells of this scene, more than can be numbered")]
    OfScene { voxel_m: f64, cells: DVec3 },
    #[error(
        "--voxel {voxel_m} makes {walls:.0} voxels of the walls of --room, expected {MAX_WALL_VOXELS:.0} at most: give a \
         larger --voxel"
    )]
    OfWalls { voxel_m: f64, walls: f64 },
}

/// The grid of a scene: planes of its bounds run through voxel centres; of a map a voxel is one of its own.
pub(crate) fn grid_of(scene: &Scene, voxel_m: f64) -> Result<VoxelGrid, TooManyVoxels> {
    let bounds_m = scene.bounds_m();
    let cells = (bounds_m[1] - bounds_m[0]) / voxel_m + 2.0;
    // bricks are numbered in 21 bits along each axis
    if cells.max_element() > f64::from(1 << 23) || cells.element_product() > 2f64.powi(60) {
        return Err(TooManyVoxels::OfScene { voxel_m, cells });
    }
    let grid = match scene {
        Scene::Voxels(_) => VoxelGrid::from_corner(bounds_m, voxel_m),
        Scene::Mesh(_) | Scene::Box(_) => VoxelGrid::centred_on(bounds_m, voxel_m),
    };
    let walls = grid.outer_count();
    if matches!(scene, Scene::Box(_)) && walls > MAX_WALL_VOXELS {
        return Err(TooManyVoxels::OfWalls { voxel_m, walls });
    }
    Ok(grid)
}

impl Site {
    /// The voxels that could be seen from the path, ascending: the walls of a room, where a mesh has an observable sample
    /// or was seen, or the occupied voxels of a map that are observable or were seen.
    pub(crate) fn observable_voxels(
        &self,
        surface: Option<&ObservableSurface>,
        coverage: &Coverage,
        stations_m: &[DVec3],
    ) -> Vec<usize> {
        let scene = &self.loaded.scene;
        let of_map;
        let surface = match (surface, scene) {
            (Some(surface), _) => Some(surface),
            (None, Scene::Voxels(map)) => {
                let centres = SurfaceSamples::new(map.occupied_m().collect()).ok();
                of_map = centres.map(|centres| ObservableSurface::new(scene, centres, stations_m));
                of_map.as_ref()
            }
            (None, _) => return self.grid.outer_cells().collect(),
        };
        let observable_m = surface.into_iter().flat_map(ObservableSurface::observable_m);
        let mut cells: Vec<usize> = observable_m.filter_map(|at_m| self.grid.index(at_m)).collect();
        cells.extend(coverage.union_cells());
        cells.sort_unstable();
        cells.dedup();
        cells
    }
}
