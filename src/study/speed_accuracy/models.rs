//! The ways to compute coverage that are compared.

use rayon::prelude::*;

use super::cases::{Case, Scored, Site};
use crate::design::fidelity::{BoxLadder, Ladder, Ranking, Rules, SceneLadder, rank};
use crate::design::objective::{ExperimentError, Objective, PUBLISHED_SPREAD_DEG};
use crate::rig::{Mount, Phase, Rig};
use crate::simulate::detection::Detection;
use crate::simulate::scan::SensorErrors;
use crate::simulate::view::Seen;
use crate::study::StudyError;

/// A method to compute coverage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Model {
    /// Converged: what all are measured against.
    Reference { azimuths: usize, sub_poses: usize },
    /// As converged, its phase started half a step further on: what the first one's best pitch is worth.
    Again { azimuths: usize, sub_poses: usize },
    /// Columns per revolution, revolutions per metre.
    Sampled { azimuths: usize, sub_poses: usize, phase: Phase },
    /// As published, with every ray off its direction.
    Spread,
    /// As published, with other voxels; scaled to the cells of the published ones.
    Voxel { voxel_m: f64 },
    /// As published, by the definition: every ray at every pose.
    Definition,
    /// As published, with the method for any poses.
    AnyPoses,
    /// A mesh at 180 azimuths and four poses per metre by the whole sensor model, with an effect.
    Sensed(Effect),
    /// As fine as each mount needs.
    Auto,
}

/// What the whole sensor model knows and a fan of ideal beams does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Effect {
    /// Offsets and firing times of the beams, nothing else.
    Beams,
    /// Also the housing of the other sensor.
    Housings,
    /// Also the beam's width: the median of rays spread over it.
    Divergence,
    /// Also surfaces that return nothing when they are seen more obliquely than this.
    Incidence,
    /// Also a dark surface everywhere, which is lost far off and at grazing angles.
    Dark,
}

/// Fineness at which effects are compared.
const SENSED: (usize, usize) = (180, 4);
const SUB_RAYS: u32 = 8;
const MAX_INCIDENCE_DEG: f64 = 75.0;
const REFLECTIVITY: f64 = 0.1;

impl Effect {
    fn words(self) -> String {
        match self {
            Self::Beams => "beam offsets".into(),
            Self::Housings => "housings".into(),
            Self::Divergence => format!("divergence, {SUB_RAYS} rays"),
            Self::Incidence => format!("incidence to {MAX_INCIDENCE_DEG} deg"),
            Self::Dark => format!("reflectivity {REFLECTIVITY}"),
        }
    }

    fn sensor_errors(self) -> SensorErrors {
        let nothing = SensorErrors::default();
        match self {
            Self::Beams | Self::Housings => nothing,
            Self::Divergence => SensorErrors { sub_rays: SUB_RAYS, ..nothing },
            Self::Incidence => {
                SensorErrors { max_incidence_rad: Some(MAX_INCIDENCE_DEG.to_radians()), ..nothing }
            }
            Self::Dark => {
                SensorErrors { detection: Some(Detection { reflectivity: REFLECTIVITY }), ..nothing }
            }
        }
    }
}

/// How the second converged model is called.
pub(super) const AGAIN: &str = "reference again";

/// Rays of adaptive fidelity, for each mount on the mean: so many times those of the published sampling.
pub(super) const AUTO_BUDGET: f64 = 10.0;
/// Share of the score that adaptive fidelity may lose by its choice.
pub(super) const AUTO_TOLERANCE: f64 = 5e-4;
/// Where the second converged model's phase starts.
const HALF_A_STEP: f64 = 0.5;

pub(super) fn models(case: &Case, quick: bool) -> Vec<Model> {
    use Phase::{Free, Locked};
    let sampled = |azimuths, sub_poses, phase| Model::Sampled { azimuths, sub_poses, phase };
    match (case.place, quick) {
        (Site::Box { .. }, true) => vec![
            Model::Reference { azimuths: 360, sub_poses: 8 },
            Model::Again { azimuths: 360, sub_poses: 8 },
            sampled(180, 1, Locked),
            sampled(180, 4, Free),
            Model::Auto,
        ],
        (Site::Box { .. }, false) => vec![
            Model::Reference { azimuths: 1800, sub_poses: 8 },
            Model::Again { azimuths: 1800, sub_poses: 8 },
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
        (Site::Mesh { .. }, true) => vec![
            Model::Reference { azimuths: 360, sub_poses: 8 },
            Model::Again { azimuths: 360, sub_poses: 8 },
            sampled(180, 1, Locked),
            sampled(180, 4, Free),
            Model::Auto,
        ],
        (Site::Mesh { .. }, false) => vec![
            Model::Reference { azimuths: 1800, sub_poses: 8 },
            Model::Again { azimuths: 1800, sub_poses: 8 },
            sampled(180, 1, Locked),
            sampled(720, 1, Locked),
            sampled(180, 4, Locked),
            sampled(180, 1, Free),
            sampled(180, 2, Free),
            sampled(180, 4, Free),
            sampled(180, 8, Free),
            sampled(360, 8, Free),
            sampled(720, 8, Free),
            sampled(60, 8, Free),
            Model::Voxel { voxel_m: 0.4 },
            Model::Voxel { voxel_m: 0.1 },
            Model::Sensed(Effect::Beams),
            Model::Sensed(Effect::Housings),
            Model::Sensed(Effect::Divergence),
            Model::Sensed(Effect::Incidence),
            Model::Sensed(Effect::Dark),
            Model::Auto,
        ],
    }
}

impl Model {
    pub(crate) fn name(&self) -> String {
        let phase = |phase: &Phase| if *phase == Phase::Locked { "locked" } else { "free" };
        match self {
            Self::Reference { azimuths, sub_poses } => format!("reference {azimuths} x {sub_poses} free"),
            Self::Again { azimuths, sub_poses } => format!("{AGAIN} {azimuths} x {sub_poses} free"),
            Self::Sampled { azimuths, sub_poses, phase: p } => {
                format!("{azimuths} x {sub_poses} {}", phase(p))
            }
            Self::Spread => format!("180 x 1 locked, spread {PUBLISHED_SPREAD_DEG} deg"),
            Self::Voxel { voxel_m } => format!("180 x 1 locked, voxel {voxel_m} m"),
            Self::Definition => "180 x 1 locked, ray by ray".into(),
            Self::AnyPoses => "180 x 1 locked, pose by pose".into(),
            Self::Sensed(effect) => format!("{} x {}, {}", SENSED.0, SENSED.1, effect.words()),
            Self::Auto => "auto".into(),
        }
    }

    /// Colour on the chart.
    pub(crate) fn group(name: &str) -> usize {
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
    random: &[Rig],
    line: &[Rig],
) -> Result<Scored, StudyError> {
    if *model == Model::Auto {
        let published = random.first().map_or(0, |rig| objective.simulator().rays(rig));
        return auto(&BoxLadder::new(objective).map_err(StudyError::of)?, published, random, line);
    }
    let published_m = objective.simulator().experiment().voxel_m;
    let changed = objective.changed(|experiment| match *model {
        Model::Reference { azimuths, sub_poses } | Model::Again { azimuths, sub_poses } => {
            (experiment.azimuths, experiment.sub_poses, experiment.phase) =
                (azimuths, sub_poses, Phase::Free);
            if matches!(model, Model::Again { .. }) {
                experiment.phase_shift = HALF_A_STEP;
            }
        }
        Model::Sampled { azimuths, sub_poses, phase } => {
            (experiment.azimuths, experiment.sub_poses, experiment.phase) = (azimuths, sub_poses, phase);
        }
        Model::Voxel { voxel_m } => experiment.voxel_m = voxel_m,
        _ => (),
    });
    let objective = changed.map_err(StudyError::of)?;
    let experiment = objective.simulator().experiment();
    // a wall has the fewer cells, the larger they are
    let scale = (experiment.voxel_m / published_m).powi(2);
    let score = |rig: &Rig| {
        let simulator = objective.simulator();
        let sensors = &simulator.sensors(rig);
        let mut counts = match model {
            Model::Spread => simulator.cover_spread(sensors, PUBLISHED_SPREAD_DEG, 1)?.coverage.counts(),
            Model::Definition => simulator.coverage_by_definition(sensors)?.coverage.counts(),
            Model::AnyPoses => simulator.cover_along(&simulator.walks(sensors))?.coverage.counts(),
            _ => simulator.count(sensors)?,
        };
        counts.union = (counts.union as f64 * scale).round() as u64;
        counts.overlap = (counts.overlap as f64 * scale).round() as u64;
        Ok(objective.terms(rig, &Seen::exact(&counts, 0), None).objective())
    };
    let scores = |mounts: &[Rig]| -> Result<Vec<f64>, StudyError> {
        mounts.par_iter().map(score).collect::<Result<_, ExperimentError>>().map_err(StudyError::of)
    };
    Ok(Scored::plain(scores(random)?, scores(line)?, 2.0 * experiment.rays_per_sensor() as f64))
}

pub(super) fn scene_scores(
    ladder: &SceneLadder,
    model: &Model,
    random: &[Vec<Mount>],
    line: &[Vec<Mount>],
) -> Result<Scored, StudyError> {
    let fan = match *model {
        Model::Reference { azimuths, sub_poses } => ladder.fan(azimuths, sub_poses as f64, Phase::Free),
        Model::Sampled { azimuths, sub_poses, phase } => ladder.fan(azimuths, sub_poses as f64, phase),
        Model::Again { azimuths, sub_poses } => {
            let mut fan = ladder.fan(azimuths, sub_poses as f64, Phase::Free);
            fan.phase_shift = HALF_A_STEP;
            fan
        }
        Model::Auto => {
            let published = ladder.fan(180, 1.0, Phase::Locked);
            let published = random.first().map_or(0, |mounts| ladder.rays_of(&published, mounts));
            return auto(ladder, published, random, line);
        }
        Model::Sensed(_) => ladder.fan(SENSED.0, SENSED.1 as f64, Phase::Locked),
        _ => ladder.fan(180, 1.0, Phase::Locked),
    };
    let coarse = match *model {
        Model::Voxel { voxel_m } => Some((ladder.with_voxels(voxel_m), (voxel_m / ladder.voxel_m()).powi(2))),
        _ => None,
    };
    let score = |mounts: &Vec<Mount>| match (model, &coarse) {
        // a surface has the fewer cells, the larger they are
        (_, Some((ladder, scale))) => ladder.voxels(&fan, mounts) as f64 * scale,
        (Model::Sensed(effect), None) => {
            ladder.voxels_sensed(&fan, mounts, effect.sensor_errors(), *effect == Effect::Housings) as f64
        }
        _ => ladder.voxels(&fan, mounts) as f64,
    };
    let scores = |mounts: &[Vec<Mount>]| -> Vec<f64> { mounts.iter().map(score).collect() };
    let each = match model {
        Model::Sensed(Effect::Divergence) => 1 + u64::from(SUB_RAYS),
        _ => 1,
    };
    let rays = each * random.first().or(line.first()).map_or(0, |mounts| ladder.rays_of(&fan, mounts));
    Ok(Scored::plain(scores(random), scores(line), rays as f64))
}

/// Both lists, each ranked by itself; `published` are the rays of the published sampling for each mount.
fn auto<L: Ladder>(
    ladder: &L,
    published: u64,
    random: &[L::Candidate],
    line: &[L::Candidate],
) -> Result<Scored, StudyError>
where
    L::Error: std::fmt::Display,
{
    let ranked = |candidates: &[L::Candidate]| {
        let rules = Rules { tolerance: AUTO_TOLERANCE, rays_per_candidate: AUTO_BUDGET * published as f64 };
        let ranking = rank(ladder, candidates, &rules).map_err(StudyError::of)?;
        ranking.ok_or_else(|| StudyError("no mounts to rank".into()))
    };
    let (scores, pitches) = (ranked(random)?, ranked(line)?);
    let values = |ranking: &Ranking| ranking.judged.iter().map(|judged| judged.value).collect();
    let least = (1.0 - AUTO_TOLERANCE) * pitches.judged[pitches.best].value;
    let alike = (0..line.len()).filter(|pitch| pitches.judged[*pitch].value >= least).collect();
    Ok(Scored {
        bounds: Some(scores.judged.iter().map(|judged| judged.bound).collect()),
        wall_ms_per_mount: 0.0,
        rays_per_mount: (scores.rays + pitches.rays) as f64 / (random.len() + line.len()) as f64,
        scores: values(&scores),
        chosen: scores.best,
        pitch_scores: values(&pitches),
        chosen_pitch: pitches.best,
        pitches_alike: Some(alike),
    })
}
