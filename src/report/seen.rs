//! What a rig of given beams sees, by every one of them: the JSON document and the report of it.

use serde::Serialize;

use super::Report;
use super::chart::count;
use super::completeness::{Pictures, SurfaceDocument};
use super::counted::Counted;
use super::prediction::GridDocument;
use crate::design::scene_search::WeightRule;
use crate::rig::{Conflicts, Rig};
use crate::simulate::quality::Quality;
use crate::world::coverage::{Counts, Coverage};
use crate::world::local_origin::LocalOrigin;

/// The document.
#[derive(Serialize)]
pub(crate) struct Document {
    #[serde(flatten)]
    counted: Counted,
    pub sensors: Vec<SensorDocument>,
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
pub(crate) struct Elsewhere {
    /// Voxels that can be seen from the trajectory.
    pub observable: u64,
    pub weights: WeightRule,
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
        elsewhere: Elsewhere,
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
            counted: Counted::new(rig, counts, elsewhere.observable, elsewhere.weights),
            sensors: spins.iter().enumerate().map(sensor).collect(),
            feasible: conflicts.violations.is_empty(),
            conflicts,
            coverage_sha256: coverage.union_sha256(),
            rays: elsewhere.rays,
            grid: GridDocument::of(coverage.grid(), elsewhere.origin),
            trajectory_length_m: elsewhere.trajectory_length_m,
            surface: elsewhere.surface,
            quality: elsewhere.quality,
            warnings: elsewhere.warnings,
            wall_s: elsewhere.wall_s,
        }
    }
}

/// What the rig sees; with pictures of the surface, for a page.
pub(crate) fn report(document: &Document, pictures: Option<&Pictures<'_>>) -> Report {
    let mut report = Report::new("What ideal sensors see", &document.sentence());
    report.notices(&document.warnings);
    report.figure("trajectory", format!("{:.2} m", document.trajectory_length_m));
    let rays = count(document.rays);
    report.figure("cast", format!("{rays} rays of ideal sensors in {:.2} s", document.wall_s));
    report.figures(document.quality.map(|quality| ("counted", quality.words(true))));
    report.figures(document.counted.figures());
    report.figures(document.conflicts.figures());
    let pictured = pictures.map(|pictures| (pictures, pictures.orbit_view(&mut report)));
    report.heading("The sensors");
    let row = |sensor: &SensorDocument| {
        let counts = [sensor.columns as u64, sensor.scans, sensor.voxels, sensor.unique_voxels];
        let named = [sensor.name.clone(), sensor.model.clone()];
        named.into_iter().chain(counts.map(count)).collect()
    };
    let rows = document.sensors.iter().map(row).collect();
    report.table(&["sensor", "model", "columns", "scans", "voxels", "alone"], rows);
    if let Some(surface) = &document.surface {
        surface.append_to(&mut report);
    }
    if let Some((pictures, spots)) = pictured {
        pictures.plans(&mut report, &spots);
    }
    report
}

impl Document {
    fn sentence(&self) -> String {
        let share = self.counted.percent();
        let surface = self.surface.as_ref().map_or(String::new(), |surface| {
            let gain = surface.baselines.as_ref().map_or(String::new(), |baselines| {
                let points = baselines.best_single.seen.gain_points["0.05"];
                format!(", {points:.2} points more than the best single sensor")
            });
            format!(" and cover {:.2} % of the surface within 5 cm{gain}", 100.0 * surface.shares.main())
        });
        format!(
            "{} sensors see {} of {} voxels of {} m that can be seen ({share:.1} %){surface}.",
            self.sensors.len(),
            count(self.counted.unique_voxels),
            count(self.counted.reachable_voxels),
            self.grid.voxel_m,
        )
    }
}
