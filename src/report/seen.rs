//! What a rig of given beams sees, by every one of them: the JSON document and its summary.

use serde::Serialize;

use super::completeness::SurfaceDocument;
use super::prediction::GridDocument;
use crate::design::objective::Terms;
use crate::rig::{Conflicts, Rig};
use crate::simulate::quality::Quality;
use crate::world::coverage::{Counts, Coverage};
use crate::world::local_origin::LocalOrigin;

/// The document.
#[derive(Serialize)]
pub(crate) struct Document {
    /// J.
    pub objective: f64,
    pub unique_voxels: u64,
    /// Voxels that can be seen from the trajectory.
    pub reachable_voxels: u64,
    pub overlap_voxels: u64,
    pub overlap_ratio: f64,
    pub min_angle_deg: Option<f64>,
    pub sensors: Vec<SensorDocument>,
    pub per_sensor_voxels: Vec<u64>,
    pub unique_per_sensor: Vec<u64>,
    pub terms: Terms,
    feasible: bool,
    #[serde(flatten)]
    pub conflicts: Conflicts,
    /// Union bitmap.
    pub coverage_sha256: String,
    pub rays: u64,
    grid: GridDocument,
    pub trajectory_length_m: f64,
    /// Of a mesh.
    #[serde(flatten)]
    pub surface: Option<SurfaceDocument>,
    /// When a voxel counts, where that was asked for; `reachable_voxels` has its limits of range and angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    pub warnings: Vec<String>,
    pub wall_s: f64,
}

/// One sensor.
#[derive(Serialize)]
pub(crate) struct SensorDocument {
    pub name: String,
    pub model: String,
    pub columns: usize,
    /// Revolutions that were cast.
    pub scans: u64,
    pub voxels: u64,
    pub unique_voxels: u64,
}

/// What is counted elsewhere.
pub(crate) struct Scored {
    pub terms: Terms,
    pub reachable_voxels: u64,
    pub min_angle_deg: Option<f64>,
    pub rays: u64,
    /// Where the local frame of the grid begins.
    pub origin: LocalOrigin,
    pub trajectory_length_m: f64,
    pub quality: Option<Quality>,
    pub warnings: Vec<String>,
    pub wall_s: f64,
    /// Of a mesh.
    pub surface: Option<SurfaceDocument>,
}

impl Document {
    /// `spins` has columns and revolutions of each sensor.
    pub(crate) fn new(
        rig: &Rig,
        coverage: &Coverage,
        counts: &Counts,
        spins: &[(usize, u64)],
        scored: Scored,
    ) -> Self {
        let conflicts = rig.conflicts();
        let sensor = |(index, (columns, scans)): (usize, &(usize, u64))| SensorDocument {
            name: rig.sensors[index].name.clone(),
            model: rig.sensors[index].model.name.clone(),
            columns: *columns,
            scans: *scans,
            voxels: counts.per_sensor[index],
            unique_voxels: counts.unique_per_sensor[index],
        };
        Self {
            objective: scored.terms.objective(),
            unique_voxels: counts.union,
            reachable_voxels: scored.reachable_voxels,
            overlap_voxels: counts.overlap,
            overlap_ratio: counts.overlap_ratio(),
            min_angle_deg: scored.min_angle_deg,
            sensors: spins.iter().enumerate().map(sensor).collect(),
            per_sensor_voxels: counts.per_sensor.clone(),
            unique_per_sensor: counts.unique_per_sensor.clone(),
            terms: scored.terms,
            feasible: conflicts.violations.is_empty(),
            conflicts,
            coverage_sha256: coverage.union_sha256(),
            rays: scored.rays,
            grid: GridDocument::of(coverage.grid(), scored.origin),
            trajectory_length_m: scored.trajectory_length_m,
            surface: scored.surface,
            quality: scored.quality,
            warnings: scored.warnings,
            wall_s: scored.wall_s,
        }
    }

    /// The result in words.
    pub(crate) fn summary(&self) -> String {
        let share = 100.0 * self.unique_voxels as f64 / self.reachable_voxels.max(1) as f64;
        let mut text = format!(
            "{:.2} m travelled, {} rays of ideal sensors\n\
             voxels seen    {} of {} of {} m that can be seen ({share:.1} %), {:.2} % of them by two sensors or more\n\
             score          J {:.1}\n\
             sensor                 model      columns   scans   voxels    alone\n",
            self.trajectory_length_m,
            self.rays,
            self.unique_voxels,
            self.reachable_voxels,
            self.grid.voxel_m,
            100.0 * self.overlap_ratio,
            self.objective,
        );
        text += &self
            .quality
            .map_or(String::new(), |quality| format!("counted        {}\n", quality.words(true)));
        for sensor in &self.sensors {
            text += &format!(
                "{:22} {:10}{:8}{:8}{:9}{:9}\n",
                sensor.name, sensor.model, sensor.columns, sensor.scans, sensor.voxels, sensor.unique_voxels
            );
        }
        text += &self.surface.as_ref().map_or(String::new(), SurfaceDocument::lines);
        text += &self.conflicts.lines();
        text + &format!("{:.2} s\n", self.wall_s)
    }
}
