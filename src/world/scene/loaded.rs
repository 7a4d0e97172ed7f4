//! A scene as read from a file, with how it was read.

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use super::{LoadedMesh, MapSummary, Mesh, MeshFileError, MeshUnit, Scene, UpAxis, VoxelMap, load_mesh};

/// A mesh higher than this, m, whose unit is not stated may be in centimetres.
const HIGH_M: f64 = 100.0;

/// A scene and what is to be said of it.
pub(crate) struct LoadedScene {
    pub scene: Scene,
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
    /// Whether the user or the format states the unit.
    is_unit_stated: bool,
    /// Whether the user or the format states the axis.
    is_up_stated: bool,
    extent_m: [f64; 3],
}

/// A mesh as read.
pub(crate) struct MeshFile {
    pub mesh: Arc<Mesh>,
    pub summary: MeshSummary,
    pub warnings: Vec<String>,
}

impl From<Scene> for LoadedScene {
    /// A scene of no file.
    fn from(scene: Scene) -> Self {
        Self { scene, mesh: None, map: None, warnings: Vec::new() }
    }
}

impl From<MeshFile> for LoadedScene {
    fn from(MeshFile { mesh, summary, warnings }: MeshFile) -> Self {
        Self { scene: Scene::Mesh(mesh), mesh: Some(summary), map: None, warnings }
    }
}

impl MeshFile {
    /// Reads a mesh file; what neither the user nor the format states is metres, z up.
    ///
    /// # Errors
    /// Those of [`load_mesh`].
    pub(crate) fn read(
        path: &Path,
        unit: Option<MeshUnit>,
        up: Option<UpAxis>,
    ) -> Result<Self, MeshFileError> {
        let LoadedMesh { mesh, mut warnings } = load_mesh(path, unit, up)?;
        let is_gltf = ["gltf", "glb"].contains(&crate::base::files::ending(path).as_str());
        let extent = mesh.bounds_m()[1] - mesh.bounds_m()[0];
        if unit.is_none() && !is_gltf && extent.z > HIGH_M {
            warnings.push(format!(
                "{}: the mesh is {:.0} m high: if the file is in centimetres, pass --mesh-unit cm",
                path.display(),
                extent.z
            ));
        }
        let summary = MeshSummary {
            unit: match unit {
                None | Some(MeshUnit::Metre) => "m",
                Some(MeshUnit::Centimetre) => "cm",
                Some(MeshUnit::Millimetre) => "mm",
            },
            up: match up {
                None if is_gltf => "y",
                None | Some(UpAxis::Z) => "z",
                Some(UpAxis::Y) => "y",
            },
            is_unit_stated: is_gltf || unit.is_some(),
            is_up_stated: is_gltf || up.is_some(),
            extent_m: extent.to_array(),
        };
        Ok(Self { mesh: Arc::new(mesh), summary, warnings })
    }
}

impl LoadedScene {
    pub(crate) fn from_map(map: VoxelMap, summary: MapSummary, warnings: Vec<String>) -> Self {
        Self { scene: Scene::Voxels(Arc::new(map)), mesh: None, map: Some(summary), warnings }
    }
}

impl MeshSummary {
    /// One line of a summary.
    pub(crate) fn line(&self) -> String {
        format!("mesh           {}\n", self.words())
    }

    pub(crate) fn words(&self) -> String {
        let [x, y, z] = self.extent_m;
        let assumed = match (self.is_unit_stated, self.is_up_stated) {
            (true, true) => "",
            (false, true) => "; nobody stated the unit (--mesh-unit)",
            (true, false) => "; nobody stated the axis (--up)",
            (false, false) => "; nobody stated either (--mesh-unit, --up)",
        };
        format!("{x:.2} x {y:.2} x {z:.2} m, read in {}, {} up{assumed}", self.unit, self.up)
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
