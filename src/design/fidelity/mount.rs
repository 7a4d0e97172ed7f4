//! What mounts are worth under the finest sampling, and what was left out of the model.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::Serialize;

use super::{BoxLadder, Ladder as _, Settled, settle};
use crate::base::numbers::{count, number};
use crate::design::objective::{ExperimentError, Objective, PUBLISHED_SPREAD_DEG};
use crate::rig::Rig;
use crate::simulate::occluder::Occluder;

/// The score under the finest sampling.
#[derive(Serialize)]
pub(crate) struct MountFidelity {
    #[serde(flatten)]
    settled: Settled,
    /// Asked for, share of the score.
    tolerance: f64,
    /// The finest level that was needed.
    level_name: String,
    /// What the model leaves out, and what that is worth.
    left_out: Vec<Omission>,
}

/// Something that the model leaves out.
#[derive(Serialize)]
struct Omission {
    what: String,
    /// Change of the score with it; null where it was not measured.
    worth: Option<f64>,
    /// Share of the rays that it touches; null where it was not measured.
    rays_touched: Option<f64>,
    why: String,
}

/// Seeds over which the spread of rays is measured: their mean is as good as is needed to leave it out.
const SPREAD_RUNS: u64 = 4;

impl MountFidelity {
    /// Samples ever more finely until the score is known within `tolerance`, a share of it.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn measure(objective: &Objective, rig: &Rig, tolerance: f64) -> Result<Self, ExperimentError> {
        let ladder = BoxLadder::new(objective)?;
        let settled = settle(&ladder, rig, tolerance)?;
        let level_name = ladder.name(settled.judged.level);
        let left_out = vec![spread(objective, rig)?, housings(objective, rig), others(objective)];
        Ok(Self { settled, tolerance, level_name, left_out })
    }

    /// In words, each with a title.
    pub(crate) fn verdicts(&self) -> Vec<(&'static str, String)> {
        let Settled { judged, within_tolerance, rays, .. } = &self.settled;
        let converged = format!(
            "J {} ± {} ({} % asked, {}), up to {}, {} rays",
            number(judged.value, 0),
            number(judged.bound, 0),
            number(100.0 * self.tolerance, 2),
            if *within_tolerance { "met" } else { "not met: the finest level is reached" },
            self.level_name,
            count(*rays),
        );
        let left_out = self.left_out.iter().map(|Omission { what, worth, why, .. }| {
            let worth = worth.map_or(String::new(), |worth| format!("worth {worth:+.0}; "));
            ("left out", format!("{what}: {worth}{why}"))
        });
        std::iter::once(("converged", converged)).chain(left_out).collect()
    }
}

/// The publication's own noise on directions, at the fineness that was given.
fn spread(objective: &Objective, rig: &Rig) -> Result<Omission, ExperimentError> {
    let simulator = objective.simulator();
    let sensors = &simulator.sensors(rig);
    let plain = objective.score(rig)?;
    let mut sum = 0.0;
    for seed in 0..SPREAD_RUNS {
        let counts = simulator.cover_spread(sensors, PUBLISHED_SPREAD_DEG, seed)?.coverage.counts();
        sum += objective.score_counts(rig, &counts).objective;
    }
    let worth = sum / SPREAD_RUNS as f64 - plain;
    let voxel_m = simulator.experiment().voxel_m;
    let range_m = simulator.experiment().preset.box_max_m[0];
    let footprint_m = range_m * PUBLISHED_SPREAD_DEG.to_radians();
    Ok(Omission {
        what: format!("rays off their direction by {PUBLISHED_SPREAD_DEG} degrees"),
        worth: Some(worth),
        rays_touched: None,
        why: format!(
            "{:.0} mm at {range_m} m, voxels of {voxel_m} m; at the sampling that was given it moves the pattern as much as \
             another phase would",
            1000.0 * footprint_m
        ),
    })
}

/// The other sensors' housings, which the published experiment looks through.
fn housings(objective: &Objective, rig: &Rig) -> Omission {
    let experiment = objective.simulator().experiment();
    let sensors = objective.simulator().sensors(rig);
    let (mut blocked, mut rays) = (0_u32, 0_u32);
    for (index, sensor) in rig.sensors.iter().enumerate() {
        let preset = experiment.preset_of(&sensors[index]);
        let beams = (preset.beams - 1) as f64;
        let occluders = Occluder::other_housings(rig, index);
        let body_from_sensor = sensor.mount.body_from_sensor();
        for azimuth in 0..preset.azimuths {
            let (sin, cos) = (TAU * azimuth as f64 / preset.azimuths as f64).sin_cos();
            for beam in 0..preset.beams {
                let elevation_deg = preset.field_of_view_deg * (beam as f64 / beams - 0.5);
                let (up, out) = elevation_deg.to_radians().sin_cos();
                let direction = body_from_sensor.rotate(DVec3::new(out * cos, out * sin, up));
                let meets = |occluder: &Occluder| {
                    occluder.distance_m(body_from_sensor.translation_m, direction).is_some()
                };
                blocked += u32::from(occluders.iter().any(meets));
                rays += 1;
            }
        }
    }
    let share = f64::from(blocked) / f64::from(rays.max(1));
    Omission {
        what: "housings of the other sensors".into(),
        worth: None,
        rays_touched: Some(share),
        why: format!("{:.1} % of the rays end at one; predict models them", 100.0 * share),
    }
}

fn others(objective: &Objective) -> Omission {
    Omission {
        what: "operator, motion within a revolution, range limits".into(),
        worth: None,
        rays_touched: None,
        why: format!(
            "{} is an empty box with a sensor at rest at each pose; predict models them",
            objective.simulator().experiment().name()
        ),
    }
}
