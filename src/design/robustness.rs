//! What a score is worth when the rig is not built and spun exactly as planned: J over draws of mount errors and spin phases.
//!
//! Draws are fixed by a seed and the same for every mount that is judged (common random numbers), so that differences
//! between mounts are differences of the mounts.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::base::rng::Rng;
use crate::base::statistics::index_of_max;
use crate::design::objective::{ExperimentError, Objective};
use crate::rig::{Phase, Rig};

/// Of the draws that a search reckons with: the same in every search, so that scores compare.
pub(crate) const SEARCH_SEED: u64 = 1;

/// How far a built rig may be from the planned one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tolerance {
    /// Each coordinate of each sensor, uniform within plus and minus this, m.
    pub position_m: f64,
    /// Pitch and roll of each sensor, uniform within plus and minus this, degrees.
    pub angle_deg: f64,
    /// Whether the azimuth at which revolutions start is left to chance as well.
    pub free_phase: bool,
}

impl Tolerance {
    /// By how much one draw of a sensor is off: x, y, z, m, pitch and roll, degrees.
    fn errors(&self, seed: u64, draw: usize, sensor: usize) -> [f64; 5] {
        let Self { position_m, angle_deg, .. } = *self;
        let mut rng = Rng::new(seed, ((draw as u64) << 16) | sensor as u64);
        [position_m, position_m, position_m, angle_deg, angle_deg].map(|most| rng.between(-most, most))
    }

    /// A rig as it might be built, one draw.
    pub(crate) fn built(&self, rig: &Rig, seed: u64, draw: usize) -> Rig {
        let mut built = rig.clone();
        for (index, sensor) in built.sensors.iter_mut().enumerate() {
            let [x_m, y_m, z_m, pitch_deg, roll_deg] = self.errors(seed, draw, index);
            sensor.mount.x_m += x_m;
            sensor.mount.y_m += y_m;
            sensor.mount.z_m += z_m;
            sensor.mount.pitch_rad += pitch_deg.to_radians();
            sensor.mount.roll_rad += roll_deg.to_radians();
        }
        built
    }

    /// # Errors
    /// Below 0 or not finite, or no draws.
    pub(crate) fn check(&self, draws: usize) -> Result<(), RobustnessError> {
        let Self { position_m, angle_deg, .. } = *self;
        let is_length = |value: f64| value.is_finite() && value >= 0.0;
        match is_length(position_m) && is_length(angle_deg) && draws > 0 {
            true => Ok(()),
            false => Err(RobustnessError::Tolerance { position_m, angle_deg, draws }),
        }
    }
}

/// Which number of the draws counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// Their mean.
    Expected,
    /// The least.
    Worst,
}

/// J over draws.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation over the draws.
    pub deviation: f64,
    /// The least.
    pub worst: f64,
    /// Draws.
    pub draws: usize,
}

impl Spread {
    pub(crate) fn of(scores: &[f64]) -> Self {
        let count = scores.len() as f64;
        let mean = scores.iter().sum::<f64>() / count;
        let squares = scores.iter().map(|score| (score - mean).powi(2)).sum::<f64>();
        Self {
            mean,
            deviation: (squares / (count - 1.0).max(1.0)).sqrt(),
            worst: scores.iter().copied().fold(f64::INFINITY, f64::min),
            draws: scores.len(),
        }
    }

    /// The number that counts.
    pub(crate) fn counts(&self, criterion: Criterion) -> f64 {
        match criterion {
            Criterion::Expected => self.mean,
            Criterion::Worst => self.worst,
        }
    }
}

/// What came of judging several candidates.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Which one counts most.
    pub best: usize,
    /// What it is worth.
    pub chosen: Spread,
    /// What the first one is worth.
    pub favourite: Spread,
    /// Evaluations that this took.
    pub evaluations: usize,
    /// Rays cast for them.
    pub rays: u64,
}

/// One draw of so many is enough for a first look, and one candidate of so many worth all draws.
const FEW: usize = 4;

/// How far the pattern of a draw has turned, in steps of the azimuth: the same stratified phases for every seed, evenly spread over a
/// step.
pub(crate) fn phase_of(draw: usize, draws: usize) -> f64 {
    (draw as f64 + 0.5) / draws as f64
}

/// An objective and the draws it is judged by.
#[derive(Clone, Debug, Serialize)]
pub struct Robustness {
    tolerance: Tolerance,
    seed: u64,
    #[serde(skip)]
    /// One objective per draw; a single one where the phase is fixed.
    objectives: Vec<Objective>,
    draws: usize,
}

impl Robustness {
    /// Judges by so many draws (at least one) with the objective's own experiment, its phase freed where asked for.
    ///
    /// # Errors
    /// Tolerances below 0 or not finite, no draws, or an experiment that cannot be made.
    pub(crate) fn new(
        objective: &Objective,
        tolerance: Tolerance,
        draws: usize,
        seed: u64,
    ) -> Result<Self, RobustnessError> {
        tolerance.check(draws)?;
        let mut objectives = vec![objective.clone()];
        if tolerance.free_phase {
            objectives = (0..draws)
                .map(|draw| {
                    let phase_shift = phase_of(draw, draws);
                    objective.changed(|experiment| {
                        (experiment.phase, experiment.phase_shift) = (Phase::Free, phase_shift);
                    })
                })
                .collect::<Result<_, _>>()?;
        }
        Ok(Self { tolerance, seed, objectives, draws })
    }

    /// How many draws.
    pub(crate) fn draws(&self) -> usize {
        self.draws
    }

    /// J of each draw for this rig.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn scores(&self, rig: &Rig) -> Result<Vec<f64>, ExperimentError> {
        self.some_scores(rig, 1)
    }

    /// J of every `step`-th draw.
    fn some_scores(&self, rig: &Rig, step: usize) -> Result<Vec<f64>, ExperimentError> {
        (0..self.draws)
            .step_by(step)
            .map(|draw| {
                let objective = &self.objectives[draw % self.objectives.len()];
                objective.score(&self.tolerance.built(rig, self.seed, draw))
            })
            .collect()
    }

    /// Which of these rigs counts most: all by a few of the draws, the better ones and the first by all.
    /// None without candidates, and where `stop` came before the end.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn choose(
        &self,
        candidates: &[Rig],
        criterion: Criterion,
        stop: &AtomicBool,
    ) -> Result<Option<Choice>, ExperimentError> {
        if candidates.is_empty() {
            return Ok(None);
        }
        let unless_stopped = |look: &dyn Fn() -> Result<Spread, ExperimentError>| {
            (!stop.load(Ordering::Relaxed)).then(look).transpose()
        };
        let first_looks: Option<Vec<f64>> = candidates
            .par_iter()
            .map(|rig| {
                let spread = unless_stopped(&|| Ok(Spread::of(&self.some_scores(rig, FEW)?)))?;
                Ok(spread.map(|spread| spread.counts(criterion)))
            })
            .collect::<Result<_, ExperimentError>>()?;
        let Some(first_looks) = first_looks else { return Ok(None) };
        let mut finalists: Vec<usize> = (1..candidates.len()).collect();
        finalists.sort_by(|a, b| first_looks[*b].total_cmp(&first_looks[*a]).then(a.cmp(b)));
        finalists.truncate((candidates.len() / FEW).max(1));
        finalists.insert(0, 0);
        let spreads: Option<Vec<Spread>> = finalists
            .par_iter()
            .map(|&candidate| unless_stopped(&|| self.spread(&candidates[candidate])))
            .collect::<Result<_, ExperimentError>>()?;
        let Some(spreads) = spreads else { return Ok(None) };
        let counts: Vec<f64> = spreads.iter().map(|spread| spread.counts(criterion)).collect();
        let best = index_of_max(&counts);
        let few = self.draws.div_ceil(FEW);
        let view = self.objectives[0].simulator();
        let first_rays: u64 = candidates.iter().map(|rig| view.rays(rig)).sum();
        let rays: u64 = finalists.iter().map(|&at| view.rays(&candidates[at])).sum();
        Ok(Some(Choice {
            best: finalists[best],
            evaluations: candidates.len() * few + finalists.len() * self.draws,
            rays: first_rays * few as u64 + rays * self.draws as u64,
            chosen: spreads[best].clone(),
            favourite: spreads[0].clone(),
        }))
    }

    /// The number that counts.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn judge(&self, rig: &Rig, criterion: Criterion) -> Result<f64, ExperimentError> {
        Ok(self.spread(rig)?.counts(criterion))
    }

    /// Mean, deviation and least of the draws.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn spread(&self, rig: &Rig) -> Result<Spread, ExperimentError> {
        Ok(Spread::of(&self.scores(rig)?))
    }
}

/// Why mounts cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum RobustnessError {
    /// A tolerance or a number of draws that makes no sense.
    #[error(
        "tolerance {position_m} m, {angle_deg} degrees, {draws} draws: give finite numbers of 0 or more, draws from 1"
    )]
    Tolerance {
        /// As given.
        position_m: f64,
        /// As given.
        angle_deg: f64,
        /// As given.
        draws: usize,
    },
    /// The experiment cannot be made.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
}
