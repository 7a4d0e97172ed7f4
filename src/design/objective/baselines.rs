//! What a score is compared with: single sensors, and the same mounts with divergence.

use serde::Serialize;

use super::{ExperimentError, Objective};
use crate::rig::{MountDeg, Rig};
use crate::simulate::baselines::{Baselines, Single, best_pitch, level_mount};

/// Pitches tried for the best single sensor, degrees: 0 to this in steps of 1, as hall and walk are symmetric.
const MAX_PITCH_DEG: u32 = 90;
/// Rays of one sensor from which on every 5th pitch is tried first, and then those around the best.
const MANY_RAYS: u64 = 4_000_000;
const COARSE_DEG: u32 = 5;

/// What one sensor reaches.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SingleScore {
    pub objective: f64,
    pub unique_voxels: u64,
    /// Voxels that the mounts see beyond those of the single sensor.
    pub gain_voxels: i64,
}

/// One level sensor and the best single one, in the middle of the given ones; of a mixed rig both are of the type with
/// the single sensor that scores higher.
pub(crate) fn baselines(objective: &Objective, rig: &Rig) -> Result<Baselines<SingleScore>, ExperimentError> {
    let of_types = objective.simulator().experiment().models().into_iter().enumerate();
    let of_type = |(sensor_type, model)| one_type(objective, rig, sensor_type, model);
    let mut all = of_types.map(of_type).collect::<Result<Vec<_>, _>>()?.into_iter();
    let first = all.next().ok_or(ExperimentError::NoSensors)?;
    let better = |a: Baselines<SingleScore>, b: Baselines<SingleScore>| {
        if b.best_single.seen.objective > a.best_single.seen.objective { b } else { a }
    };
    Ok(all.fold(first, better))
}

fn one_type(
    objective: &Objective,
    rig: &Rig,
    sensor_type: usize,
    model: &str,
) -> Result<Baselines<SingleScore>, ExperimentError> {
    let mounts: Vec<_> = rig.sensors.iter().map(|sensor| sensor.mount).collect();
    let level = level_mount(&mounts);
    let at = |pitch_deg: f64| MountDeg {
        sensor_type,
        ..MountDeg::from([level.x_m, level.y_m, level.z_m, pitch_deg, 0.0])
    };
    let of_all = objective.evaluate_rig(rig)?.unique_voxels as i64;
    let alone = |pitch_deg: f64| {
        let evaluation = objective.evaluate_rig(&objective.mounted(&[at(pitch_deg)]))?;
        let gain_voxels = of_all - evaluation.unique_voxels as i64;
        let (objective, unique_voxels) = (evaluation.objective, evaluation.unique_voxels);
        let seen = SingleScore { objective, unique_voxels, gain_voxels };
        let single = Single::new(model, &at(pitch_deg).mount(), seen);
        // not through radians and back
        Ok::<_, ExperimentError>(Single { pitch_deg, ..single })
    };
    let level_single = alone(0.0)?;
    let many = objective.simulator().experiment().rays(&[at(0.0)]) > MANY_RAYS;
    let step = if many { COARSE_DEG as usize } else { 1 };
    let pitches_deg: Vec<f64> = (0..=MAX_PITCH_DEG).step_by(step).map(f64::from).collect();
    // a sensor at a position that was scored level fails nowhere else
    let score = |pitch_deg| alone(pitch_deg).map_or(f64::NEG_INFINITY, |single| single.seen.objective);
    let (mut best_deg, mut pitch_search) = best_pitch(&pitches_deg, score);
    if many {
        let reach = f64::from(COARSE_DEG - 1);
        let around = (0..=MAX_PITCH_DEG).map(f64::from).filter(|pitch| (pitch - best_deg).abs() <= reach);
        let (finer_deg, finer) = best_pitch(&around.collect::<Vec<_>>(), score);
        best_deg = finer_deg;
        pitch_search.retain(|[pitch_deg, _]| finer.iter().all(|[other, _]| other != pitch_deg));
        pitch_search.extend(finer);
        pitch_search.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    Ok(Baselines {
        level_single,
        best_single: alone(best_deg)?,
        first_single: None,
        pitch_search,
        search_by: "objective",
    })
}

/// Scores with every ray off its direction.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Rescored {
    /// Standard deviation of each component of a direction, degrees.
    divergence_deg: f64,
    seed: u64,
    /// J of each run.
    objectives: Vec<f64>,
    mean: f64,
    /// Of one run; 0 for a single one.
    sd: f64,
}

impl Rescored {
    /// In words.
    pub(crate) fn words(&self) -> String {
        format!(
            "J {:.1} ± {:.1} with {} degrees of divergence ({} runs)",
            self.mean,
            self.sd,
            self.divergence_deg,
            self.objectives.len()
        )
    }
}

/// The rig scored again, each run with a seed of its own.
pub(crate) fn rescore(
    objective: &Objective,
    rig: &Rig,
    runs: u32,
    divergence_deg: f64,
    seed: u64,
) -> Result<Rescored, ExperimentError> {
    let sensors = objective.simulator().sensors(rig);
    let run = |run: u32| {
        let seed = seed.wrapping_add(u64::from(run));
        let seen = objective.simulator().cover_spread(&sensors, divergence_deg, seed)?;
        Ok(objective.score_counts(rig, &seen.coverage.counts()).objective)
    };
    let objectives: Vec<f64> = (0..runs).map(run).collect::<Result<_, ExperimentError>>()?;
    let count = objectives.len() as f64;
    let mean = objectives.iter().sum::<f64>() / count;
    let squares = objectives.iter().map(|objective| (objective - mean).powi(2)).sum::<f64>();
    let sd = (squares / (count - 1.0).max(1.0)).sqrt();
    Ok(Rescored { divergence_deg, seed, objectives, mean, sd })
}
