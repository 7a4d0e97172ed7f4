//! A scene as read from a file, with how it was read.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;

use super::map_builder::MadeMap;
use super::mesh_file::plausible_units;
use super::{LoadedMesh, MapSummary, Mesh, MeshFileError, MeshUnit, Scene, UpAxis, load_mesh};
use crate::world::local_origin::LocalOrigin;

/// A mesh higher than this, m, may be in another unit where none is stated; so may one with rooms higher than this.
const HIGH_M: f64 = 100.0;
const HIGH_ROOM_M: f64 = 40.0;
/// Places along x and y at which rooms are measured.
const PLACES: u32 = 8;

/// A scene and the notes on it.
pub(crate) struct LoadedScene {
    /// In the local frame.
    pub scene: Scene,
    /// Where that frame begins in the one of the files.
    pub origin: LocalOrigin,
    /// Of a mesh.
    pub mesh: Option<MeshSummary>,
    /// Of a map.
    pub map: Option<MapSummary>,
    pub warnings: Vec<String>,
}

/// How a mesh file was read.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct MeshSummary {
    unit: &'static str,
    up: &'static str,
    /// Whether the user, the file or the format states the unit.
    is_unit_stated: bool,
    /// Whether the user or the format states the axis.
    is_up_stated: bool,
    extent_m: [f64; 3],
    /// Of one side.
    area_m2: f64,
    triangles: usize,
    /// Where the frame of the computation begins in that of the files.
    local_origin_m: [f64; 3],
    #[serde(skip)]
    origin: LocalOrigin,
}

/// A mesh as read.
pub(crate) struct MeshFile {
    pub mesh: Arc<Mesh>,
    pub origin: LocalOrigin,
    pub summary: MeshSummary,
    pub warnings: Vec<String>,
}

impl LoadedScene {
    /// A scene of no file, such as a room by its corners.
    pub(crate) fn of_room(room: &Scene) -> Self {
        let origin = LocalOrigin::of_box(room.bounds_m());
        let scene = match room {
            Scene::Box(room) => Scene::Box(room.moved(-origin.world_m())),
            other => other.clone(),
        };
        Self { scene, origin, mesh: None, map: None, warnings: Vec::new() }
    }
}

impl From<MeshFile> for LoadedScene {
    fn from(MeshFile { mesh, origin, summary, warnings }: MeshFile) -> Self {
        Self { scene: Scene::Mesh(mesh), origin, mesh: Some(summary), map: None, warnings }
    }
}

impl MeshFile {
    /// Reads a mesh file; what neither the user nor the file nor the format states is metres, z up.
    ///
    /// # Errors
    /// Those of [`load_mesh`].
    pub(crate) fn read(
        path: &Path,
        unit: Option<MeshUnit>,
        up: Option<UpAxis>,
    ) -> Result<Self, MeshFileError> {
        let LoadedMesh { mesh, origin, unit: read_unit, is_unit_stated, mut warnings } =
            load_mesh(path, unit, up)?;
        let is_gltf = ["gltf", "glb"].contains(&crate::base::files::ending(path).as_str());
        let extent = mesh.bounds_m()[1] - mesh.bounds_m()[0];
        let room_m = rooms_m(&mesh).unwrap_or(0.0);
        if unit.is_none() && (extent.z > HIGH_M || room_m > HIGH_ROOM_M) {
            let units = plausible_units((extent / read_unit.metres()).to_array());
            let likely = units.first().map_or(String::new(), |unit| format!(" {}", unit.name()));
            let other = format!("{likely}{}", MeshUnit::offer(&units, extent / read_unit.metres()));
            warnings.push(format!(
                "{}: {} {:.0} m high: if the file is in another unit, pass --mesh-unit{other}",
                path.display(),
                if room_m > HIGH_ROOM_M { "rooms of the mesh are" } else { "the mesh is" },
                if room_m > HIGH_ROOM_M { room_m } else { extent.z }
            ));
        }
        let summary = MeshSummary {
            unit: read_unit.name(),
            up: match up {
                None if is_gltf => "y",
                None | Some(UpAxis::Z) => "z",
                Some(UpAxis::Y) => "y",
            },
            is_unit_stated: is_gltf || is_unit_stated,
            is_up_stated: is_gltf || up.is_some(),
            extent_m: extent.to_array(),
            area_m2: mesh.area_m2(),
            triangles: mesh.triangles(),
            local_origin_m: origin.world_m().to_array(),
            origin,
        };
        Ok(Self { mesh: Arc::new(mesh), origin, summary, warnings })
    }
}

/// From floor to ceiling at half of the places in the plan that have both; none where few have.
fn rooms_m(mesh: &Mesh) -> Option<f64> {
    let [low_m, high_m] = mesh.bounds_m();
    let share = |place: u32| (f64::from(place) + 0.5) / f64::from(PLACES);
    let places = (0..PLACES).flat_map(|x| (0..PLACES).map(move |y| DVec3::new(share(x), share(y), 0.5)));
    let heights = places.filter_map(|place| mesh.clear_height_m(low_m + place * (high_m - low_m)));
    let mut heights_m: Vec<f64> = heights.map(|[down_m, up_m]| down_m + up_m).collect();
    let middle = heights_m.len() / 2;
    (heights_m.len() >= PLACES as usize).then(|| *heights_m.select_nth_unstable_by(middle, f64::total_cmp).1)
}

impl LoadedScene {
    pub(crate) fn from_map(made: MadeMap) -> Self {
        let MadeMap { map, origin, summary, warnings } = made;
        Self { scene: Scene::Voxels(Arc::new(map)), origin, mesh: None, map: Some(summary), warnings }
    }
}

impl MeshSummary {
    /// Size, unit and axis, and the local origin where there is one, each with a label.
    pub(crate) fn figures(&self) -> impl Iterator<Item = (&'static str, String)> {
        [("mesh", self.words())].into_iter().chain(self.origin.words().map(|words| ("local origin", words)))
    }

    fn words(&self) -> String {
        let [x, y, z] = self.extent_m;
        let assumed = match (self.is_unit_stated, self.is_up_stated) {
            (true, true) => "",
            (false, true) => "; no unit is stated (--mesh-unit)",
            (true, false) => "; no axis is stated (--up)",
            (false, false) => "; neither is stated (--mesh-unit, --up)",
        };
        format!(
            "{x:.2} x {y:.2} x {z:.2} m, {:.2} m² in {} triangles, read in {}, {} up{assumed}",
            self.area_m2, self.triangles, self.unit, self.up
        )
    }
}

impl Scene {
    pub(crate) fn mesh(&self) -> Option<&Mesh> {
        match self {
            Scene::Mesh(mesh) => Some(mesh),
            Scene::Box(_) | Scene::Voxels(_) => None,
        }
    }

    /// What kind of scene it is.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Scene::Mesh(_) => "mesh",
            Scene::Box(_) => "room",
            Scene::Voxels(_) => "map",
        }
    }
}
