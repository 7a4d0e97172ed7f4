//! The ways to compute coverage that are compared.

use rayon::prelude::*;
use sensors::SensorModel;

use super::cases::{Case, Place, Scored};
use crate::fidelity::{BoxLadder, Ladder, Ranking, Rules, SceneLadder, rank};
use crate::objective::Objective;
use crate::rig::Mount;
use crate::simulate::fan::BeamFan;
use crate::simulate::published::{
    Experiment, ExperimentError, PUBLISHED_SPREAD_DEG, Phase, Placement, Simulator,
};
use crate::study::StudyError;

/// A way to compute coverage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Model {
    /// Converged: what all are measured against.
    Reference { azimuths: usize, sub_poses: usize },
    /// Rays of a box experiment.
    Sampled { azimuths: usize, sub_poses: usize, phase: Phase },
    /// As published, with every ray off its direction.
    Spread,
    /// As published, with other voxels; scaled to the cells of the published ones.
    Voxel { voxel_m: f64 },
    /// As published, by the definition: every ray at every pose.
    Definition,
    /// As published, by the way for any poses.
    AnyPoses,
    /// Columns and scans per second in a mesh.
    Scans { columns: usize, rate_hz: f64 },
    /// As fine as each mount needs.
    Auto,
}

/// Rays of adaptive fidelity, for each mount on the mean: so many times those of the coarsest level.
pub(super) const AUTO_BUDGET: f64 = 10.0;
/// Share of the score that adaptive fidelity may lose by its choice.
const AUTO_TOLERANCE: f64 = 5e-4;

pub(super) fn models(case: &Case, quick: bool) -> Vec<Model> {
    use Phase::{Free, Locked};
    let sampled = |azimuths, sub_poses, phase| Model::Sampled { azimuths, sub_poses, phase };
    match (case.place, quick) {
        (Place::Box { .. }, true) => vec![
            Model::Reference { azimuths: 360, sub_poses: 8 },
            sampled(180, 1, Locked),
            sampled(180, 4, Free),
            Model::Auto,
        ],
        (Place::Box { .. }, false) => vec![
            Model::Reference { azimuths: 1800, sub_poses: 8 },
            sampled(180, 1, Locked),
            sampled(360, 1, Locked),
            sampled(720, 1, Locked),
            sampled(1800, 1, Locked),
            sampled(180, 4, Locked),
            sampled(180, 8, Locked),
            sampled(180, 1, Free),
            sampled(180, 2, Free),
            sampled(180, 4, Free),
            sampled(180, 8, Free),
            sampled(360, 1, Free),
            sampled(360, 8, Free),
            sampled(720, 8, Free),
            sampled(60, 8, Free),
            Model::Spread,
            Model::Voxel { voxel_m: 1.0 },
            Model::Voxel { voxel_m: 0.25 },
            Model::Definition,
            Model::AnyPoses,
            Model::Auto,
        ],
        (Place::Mesh { .. }, true) => {
            vec![
                Model::Scans { columns: 180, rate_hz: 5.0 },
                Model::Scans { columns: 45, rate_hz: 2.5 },
                Model::Auto,
            ]
        }
        (Place::Mesh { .. }, false) => [
            (1800, 10.0),
            (45, 1.25),
            (90, 1.25),
            (45, 5.0),
            (90, 2.5),
            (180, 2.5),
            (90, 5.0),
            (360, 2.5),
            (180, 5.0),
            (180, 10.0),
            (360, 10.0),
            (720, 10.0),
        ]
        .into_iter()
        .map(|(columns, rate_hz)| Model::Scans { columns, rate_hz })
        .chain([Model::Auto])
        .collect(),
    }
}

impl Model {
    pub fn name(&self) -> String {
        let phase = |phase: &Phase| if *phase == Phase::Locked { "locked" } else { "free" };
        match self {
            Self::Reference { azimuths, sub_poses } => format!("reference {azimuths} x {sub_poses} free"),
            Self::Sampled { azimuths, sub_poses, phase: p } => {
                format!("{azimuths} x {sub_poses} {}", phase(p))
            }
            Self::Spread => format!("180 x 1 locked, spread {PUBLISHED_SPREAD_DEG} deg"),
            Self::Voxel { voxel_m } => format!("180 x 1 locked, voxel {voxel_m} m"),
            Self::Definition => "180 x 1 locked, ray by ray".into(),
            Self::AnyPoses => "180 x 1 locked, pose by pose".into(),
            Self::Scans { columns, rate_hz } => format!("{columns} x {rate_hz} Hz"),
            Self::Auto => "auto".into(),
        }
    }

    /// Colour on the chart.
    pub fn group(name: &str) -> usize {
        match name {
            "auto" => 3,
            name if name.contains(',') => 4,
            name if name.contains("locked") => 2,
            _ => 1,
        }
    }
}

pub(super) fn box_scores(
    objective: &Objective,
    model: &Model,
    random: &[Vec<Placement>],
    line: &[Vec<Placement>],
) -> Result<Scored, StudyError> {
    if *model == Model::Auto {
        return auto(&BoxLadder::new(objective).map_err(StudyError::of)?, random, line);
    }
    let own = *objective.simulator().experiment();
    let experiment = match *model {
        Model::Reference { azimuths, sub_poses } => {
            Experiment { azimuths, sub_poses, phase: Phase::Free, ..own }
        }
        Model::Sampled { azimuths, sub_poses, phase } => Experiment { azimuths, sub_poses, phase, ..own },
        Model::Voxel { voxel_m } => Experiment { voxel_m, ..own },
        _ => own,
    };
    let objective = objective.with_simulator(Simulator::new(&experiment).map_err(StudyError::of)?);
    // a wall has the fewer cells, the larger they are
    let scale = (experiment.voxel_m / own.voxel_m).powi(2);
    let score = |sensors: &Vec<Placement>| {
        let simulator = objective.simulator();
        let mut counts = match model {
            Model::Spread => simulator.see_spread(sensors, PUBLISHED_SPREAD_DEG, 1)?.coverage.counts(),
            Model::Definition => simulator.coverage_by_definition(sensors)?.coverage.counts(),
            Model::AnyPoses => simulator.see_along(&simulator.walks(sensors))?.coverage.counts(),
            _ => simulator.count(sensors)?,
        };
        counts.union = (counts.union as f64 * scale).round() as u64;
        counts.overlap = (counts.overlap as f64 * scale).round() as u64;
        Ok(objective.terms(sensors, &counts, None).objective())
    };
    let scores = |mounts: &[Vec<Placement>]| -> Result<Vec<f64>, StudyError> {
        mounts.par_iter().map(score).collect::<Result<_, ExperimentError>>().map_err(StudyError::of)
    };
    Ok(Scored::plain(scores(random)?, scores(line)?, 2.0 * experiment.rays_per_sensor() as f64))
}

pub(super) fn scene_scores(
    ladder: &SceneLadder,
    sensor: &SensorModel,
    model: &Model,
    random: &[Vec<Mount>],
    line: &[Vec<Mount>],
) -> Result<Scored, StudyError> {
    let Model::Scans { columns, rate_hz } = *model else {
        return auto(ladder, random, line);
    };
    let fan = BeamFan::nominal(sensor, columns, rate_hz);
    let scores = |mounts: &[Vec<Mount>]| -> Vec<f64> {
        mounts.iter().map(|mounts| ladder.voxels(&fan, mounts) as f64).collect()
    };
    let rays = random.first().map_or(0, |mounts| ladder.rays_of(&fan, mounts));
    Ok(Scored::plain(scores(random), scores(line), rays as f64))
}

/// Both lists, each ranked by itself.
fn auto<L: Ladder>(ladder: &L, random: &[L::Candidate], line: &[L::Candidate]) -> Result<Scored, StudyError>
where
    L::Error: std::fmt::Display,
{
    let ranked = |candidates: &[L::Candidate]| {
        let coarse = candidates.first().map_or(0, |first| ladder.rays(0, first)) as f64;
        let rules = Rules { tolerance: AUTO_TOLERANCE, rays_per_candidate: AUTO_BUDGET * coarse };
        let ranking = rank(ladder, candidates, &rules).map_err(StudyError::of)?;
        ranking.ok_or_else(|| StudyError("no mounts to rank".into()))
    };
    let (scores, pitches) = (ranked(random)?, ranked(line)?);
    let values = |ranking: &Ranking| ranking.judged.iter().map(|judged| judged.value).collect();
    Ok(Scored {
        bounds: Some(scores.judged.iter().map(|judged| judged.bound).collect()),
        wall_ms_per_mount: 0.0,
        rays_per_mount: (scores.rays + pitches.rays) as f64 / (random.len() + line.len()) as f64,
        scores: values(&scores),
        chosen: scores.best,
        pitch_scores: values(&pitches),
        chosen_pitch: pitches.best,
    })
}
