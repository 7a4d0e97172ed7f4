//! How much of a mesh's surface ideal sensors cover: the JSON document and its summary.

mod page;

pub(crate) use page::page;

use serde::Serialize;

use crate::design::registration::{PathRegistration, RegistrationQuality};
use crate::rig::Conflicts;
use crate::simulate::baselines::Baselines;
use crate::simulate::ideal::{IdealCoverage, IdealSensors, SingleCoverage};
use crate::world::scene::{Mesh, MeshSummary};
use crate::world::surface::{ObservableSurface, SurfaceShares};

/// The document of a completeness.
#[derive(Serialize)]
pub(crate) struct Document {
    #[serde(flatten)]
    pub coverage: IdealCoverage,
    pub observable_share: f64,
    /// Null where they were left out.
    pub baselines: Option<Baselines<SingleCoverage>>,
    pub sensors: usize,
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
    pub trajectory_length_m: f64,
    #[serde(flatten)]
    pub registration: PathRegistration,
    #[serde(flatten)]
    pub conflicts: Conflicts,
    pub warnings: Vec<String>,
    #[serde(flatten)]
    pub times: Times,
}

/// Seconds that the parts took.
#[derive(Clone, Copy, Default, Serialize)]
pub(crate) struct Times {
    /// Reading of files, tree and samples.
    pub prepare_s: f64,
    /// Casting and counting for the mounts, and the observable set.
    pub wall_s: f64,
    /// Of that, the observable set.
    pub observable_s: f64,
    pub baselines_s: f64,
}

impl Document {
    pub(crate) fn new(
        sensors: &IdealSensors,
        (mesh, summary): (&Mesh, MeshSummary),
        surface: &ObservableSurface,
        coverage: IdealCoverage,
        baselines: Option<Baselines<SingleCoverage>>,
    ) -> Self {
        let fans = &sensors.fans;
        Self {
            coverage,
            observable_share: surface.observable_share(),
            baselines,
            sensors: sensors.rig.sensors.len(),
            columns: fans.iter().map(|fan| fan.columns()).max().unwrap_or(0),
            min_range_m: fans[0].min_range_m,
            max_range_m: fans.iter().map(|fan| fan.max_range_m).fold(0.0, f64::max),
            samples: surface.samples.len(),
            mesh: summary,
            triangles: mesh.triangles(),
            triangles_without_area: mesh.degenerate(),
            area_m2: mesh.area_m2(),
            trajectory_length_m: sensors.trajectory.length_m(),
            registration: PathRegistration::of_scanner(&sensors.scanner()),
            conflicts: sensors.rig.conflicts(),
            warnings: Vec::new(),
            times: Times::default(),
        }
    }

    /// The result in words.
    pub(crate) fn summary(&self) -> String {
        let line = |name: &str, shares: &SurfaceShares| {
            let cells: Vec<_> = shares.percent().iter().map(|cell| format!("{cell:>8}")).collect();
            format!("{name:14}{}\n", cells.join(""))
        };
        let mut text = format!(
            "{} sensors of {} columns, {} samples on {:.1} m2, {:.2} m travelled\n{}\
             observable     {:.3} % of the samples\n\
             {:14}    2 cm    5 cm   10 cm  of observable at 5 cm (all in %)\n",
            self.sensors,
            self.columns,
            self.samples,
            self.area_m2,
            self.trajectory_length_m,
            self.mesh.line(),
            100.0 * self.observable_share,
            ""
        );
        text += &line("mounts", &self.coverage.shares);
        for (name, single) in self.baselines.iter().flat_map(Baselines::named) {
            text += &line(name, &single.seen.coverage.shares);
        }
        if let Some(baselines) = &self.baselines {
            let best = &baselines.best_single;
            text += &format!("best single is a {} at a pitch of {:.0} degrees\n", best.model, best.pitch_deg);
        }
        text += &self.registration.registration.as_ref().map_or(String::new(), RegistrationQuality::line);
        text += &self.conflicts.lines();
        let of_baselines = match &self.baselines {
            Some(_) => {
                format!("; single sensors {:.2} s (--no-baselines)", self.times.baselines_s)
            }
            None => String::new(),
        };
        text + &format!("{} rays in {:.2} s{of_baselines}\n", self.coverage.rays, self.times.wall_s)
    }
}
