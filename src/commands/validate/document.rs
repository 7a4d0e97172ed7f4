//! What `validate` says.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::commands::baselines::Baselines;
use crate::commands::ground::MeshTaken;
use crate::commands::output;
use crate::commands::registration::Tied;
use crate::commands::surface::Covered;
use crate::design::registration::RegistrationQuality;
use crate::rig::{Clearance, Touching};

/// The document that `validate` prints.
#[derive(Serialize)]
pub struct Document {
    #[serde(flatten)]
    pub seen: Seen,
    pub observable_share: f64,
    /// Null where they were left out.
    pub baselines: Option<Baselines<Beside>>,
    pub sensors: usize,
    /// Of the sensor with the most.
    pub columns: usize,
    pub min_range_m: f64,
    /// Of the sensor that reaches farthest.
    pub max_range_m: f64,
    pub samples: usize,
    pub mesh: MeshTaken,
    pub triangles: usize,
    pub triangles_without_area: usize,
    pub area_m2: f64,
    pub trajectory_length_m: f64,
    #[serde(flatten)]
    pub tied: Tied,
    /// Pairs of housings that are not apart.
    pub violations: Vec<Clearance>,
    /// Pairs of housings that touch as they are tilted, far apart as their origins may be.
    pub touching: Vec<Touching>,
    pub warnings: Vec<String>,
    /// Reading of files, tree and samples.
    pub prepare_s: f64,
    /// Casting and counting for the mounts, and the observable set.
    pub wall_s: f64,
    /// Of that, the observable set.
    pub observable_s: f64,
    pub baselines_s: f64,
}

/// What a set of sensors sees.
#[derive(Clone, Debug, Serialize)]
pub struct Seen {
    #[serde(flatten)]
    pub covered: Covered,
    /// x_m, y_m, z_m, pitch_deg, roll_deg.
    pub mounts: Vec<[f64; 5]>,
    pub rays: u64,
}

/// A single sensor beside the mounts.
#[derive(Clone, Debug, Serialize)]
pub struct Beside {
    #[serde(flatten)]
    pub seen: Seen,
    /// Completeness of the mounts less that of the baseline, percentage points, by threshold.
    pub gain_points: BTreeMap<String, f64>,
}

impl Document {
    /// The result in words.
    pub fn summary(&self) -> String {
        let line = |name: &str, covered: &Covered| {
            let cells: Vec<_> = covered.percent().iter().map(|cell| format!("{cell:>8}")).collect();
            format!("{name:14}{}\n", cells.join(""))
        };
        let mut text = format!(
            "{} sensors of {} columns, {} samples on {:.1} m2, {:.2} m of way\n{}\
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
        text += &line("mounts", &self.seen.covered);
        for (name, single) in self.baselines.iter().flat_map(Baselines::named) {
            text += &line(name, &single.seen.seen.covered);
        }
        if let Some(baselines) = &self.baselines {
            let best = &baselines.best_single;
            text += &format!("best single is a {} at a pitch of {:.0} degrees\n", best.model, best.pitch_deg);
        }
        text += &self.tied.registration.as_ref().map_or(String::new(), RegistrationQuality::line);
        text += &output::cannot_be_built(&self.violations, &self.touching);
        let beside = match &self.baselines {
            Some(_) => format!("; the single sensors beside them {:.2} s (--no-baselines)", self.baselines_s),
            None => String::new(),
        };
        text + &format!("{} rays in {:.2} s{beside}\n", self.seen.rays, self.wall_s)
    }
}
