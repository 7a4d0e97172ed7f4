//! How much of a mesh's surface ideal sensors cover: its part of the JSON document and of the report.

mod sections;

pub(crate) use sections::Pictures;

use serde::Serialize;

use crate::design::registration::PathRegistration;
use crate::simulate::baselines::Baselines;
use crate::simulate::ideal::{IdealCoverage, IdealSensors, SingleCoverage};
use crate::world::scene::{Mesh, MeshSummary};
use crate::world::surface::{ObservableSurface, SurfaceShares};

/// What of a mesh's surface is covered, within the document of what ideal sensors see.
#[derive(Serialize)]
pub(crate) struct SurfaceDocument {
    #[serde(flatten)]
    pub shares: SurfaceShares,
    /// x_m, y_m, z_m, pitch_deg, roll_deg.
    pub mounts: Vec<[f64; 5]>,
    pub observable_share: f64,
    /// Null where they were left out.
    pub baselines: Option<Baselines<SingleCoverage>>,
    /// Of the sensor with the most.
    pub columns: usize,
    pub min_range_m: f64,
    /// Of the sensor that reaches farthest.
    pub max_range_m: f64,
    pub samples: usize,
    pub mesh: MeshSummary,
    pub triangles: usize,
    pub triangles_without_area: usize,
    pub area_m2: f64,
    #[serde(flatten)]
    pub registration: PathRegistration,
    #[serde(flatten)]
    pub times: Times,
}

/// Seconds that the parts took.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Times {
    /// Tree and samples.
    pub prepare_s: f64,
    /// Voxels and the observable set.
    pub observable_s: f64,
    pub baselines_s: f64,
}

impl SurfaceDocument {
    pub(crate) fn new(
        sensors: &IdealSensors,
        mesh: MeshSummary,
        surface: &ObservableSurface,
        coverage: IdealCoverage,
        baselines: Option<Baselines<SingleCoverage>>,
        times: Times,
    ) -> Self {
        let fans = &sensors.fans;
        let triangles = sensors.scene.mesh();
        Self {
            shares: coverage.shares,
            mounts: coverage.mounts,
            observable_share: surface.observable_share(),
            baselines,
            columns: fans.iter().map(|fan| fan.columns()).max().unwrap_or(0),
            min_range_m: fans[0].min_range_m,
            max_range_m: fans.iter().map(|fan| fan.max_range_m).fold(0.0, f64::max),
            samples: surface.samples.len(),
            mesh,
            triangles: triangles.map_or(0, Mesh::triangles),
            triangles_without_area: triangles.map_or(0, Mesh::degenerate),
            area_m2: triangles.map_or(0.0, Mesh::area_m2),
            registration: PathRegistration::of_scanner(&sensors.scanner()),
            times,
        }
    }
}
