//! The method that knows the structure of the problem: cheap designs first, proofs before trials, a model for the
//! region, then a local search that does not trust the model with needles.
//!
//! 1. Seed points take the least count only: fewer sensors cost fewer rays, and a good score there often proves that
//!    larger counts cannot win ([`Space::that_can_exceed`]). Counts that stay possible get seed points in turn.
//! 2. Bayesian optimization over what is left, symmetries folded.
//! 3. Scouts: wide steps from any of the better points, so that hills the model has given up are looked at again.
//! 4. Local searches ([`Lines`]) from the best points that lie apart.

use serde::{Deserialize, Serialize};

use super::lines::{Lines, TYPICAL_LENGTH, vary};
use super::{Bayesian, Candidate, Optimizer, Settings, Space, Trial, generator};
use crate::base::rng::Rng;

const SEEDS_PER_COUNT: usize = 12;
/// Bayesian evaluations at most: beyond, the model costs more than the objective and says less.
const MODELLED_MAX: usize = 120;
/// Share of the evaluations after the model's that look for places worth a local search.
const SCOUT_SHARE: f64 = 0.25;
/// Scouts start from so many of the best points.
const SCOUTED: usize = 120;
const SCOUT_STEPS: (f64, f64) = (0.02, 0.5);
const SCOUTS_AT_ONCE: usize = 16;

/// Cheap first, then modelled, then local.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Staged {
    space: Space,
    settings: Settings,
    step: u64,
    /// Count for the next seed points.
    next_count: f64,
    trials: Vec<Trial>,
    model: Option<Bayesian>,
    /// Over which share of each variable's range the objective changes, as the model learned.
    lengths: Vec<f64>,
    lines: Option<Lines>,
}

impl Staged {
    /// Nothing evaluated yet.
    pub(crate) fn new(space: Space, settings: Settings) -> Self {
        let space = space.folded();
        let next_count = space.variables()[0].low;
        let lengths = vec![TYPICAL_LENGTH; space.len()];
        Self { space, settings, step: 0, next_count, trials: Vec::new(), model: None, lengths, lines: None }
    }

    fn rest(&self) -> Space {
        let best =
            self.trials.iter().filter(|t| t.violation == 0.0).map(|t| t.score).fold(f64::NAN, f64::max);
        if best.is_nan() { self.space.clone() } else { self.space.that_can_exceed(best) }
    }

    /// Seed points of the next count that can still win; none when all counts have had theirs.
    fn seeds(&mut self, rng: &mut Rng) -> Vec<Candidate> {
        let first = &self.space.variables()[0];
        // without a count there is nothing to begin small with
        let is_counted = first.integer && self.space.variables().iter().any(|v| v.active_from.is_some());
        if !is_counted {
            let points = if self.trials.is_empty() { SEEDS_PER_COUNT } else { 0 };
            return candidates(self.space.latin_hypercube(points, rng));
        }
        if self.next_count > self.rest().variables()[0].high {
            return Vec::new();
        }
        let mut points = self.space.latin_hypercube(SEEDS_PER_COUNT, rng);
        for point in &mut points {
            point[0] = self.next_count;
        }
        self.next_count += 1.0;
        candidates(points)
    }

    fn modelled(&self) -> usize {
        MODELLED_MAX.min(self.settings.budget)
    }

    /// Evaluations planned for scouts and local searches together.
    fn local(&self) -> usize {
        self.settings.budget.saturating_sub(self.modelled())
    }

    fn scouts(&mut self, rng: &mut Rng) -> Vec<Candidate> {
        let space = self.rest();
        let best = self.ranked();
        let best = &best[..best.len().min(SCOUTED)];
        let scout = |_| {
            let from = &best[rng.below(best.len() as u64) as usize].candidate.values;
            Candidate { values: vary(&space, from, SCOUT_STEPS, rng) }
        };
        (0..SCOUTS_AT_ONCE).map(scout).collect()
    }

    fn ranked(&self) -> Vec<&Trial> {
        let mut ranked: Vec<&Trial> = self.trials.iter().collect();
        ranked.sort_by(|a, b| a.order(b));
        ranked
    }
}

fn candidates(points: Vec<Vec<f64>>) -> Vec<Candidate> {
    points.into_iter().map(|values| Candidate { values }).collect()
}

impl Optimizer for Staged {
    fn ask(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.settings.seed, self.step);
        self.step += 1;
        if self.model.is_none() {
            let seeds = self.seeds(&mut rng);
            if !seeds.is_empty() {
                return seeds;
            }
        }
        if self.trials.len() < self.modelled() {
            if self.model.is_none() {
                let settings = Settings { early_stop: false, ..self.settings };
                self.model = Some(Bayesian::continued(self.space.clone(), settings, self.trials.clone()));
            }
            if let Some(model) = &mut self.model {
                return model.ask();
            }
        }
        if let Some(lengths) = self.model.take().and_then(|model| model.lengths()) {
            self.lengths = lengths;
        }
        let scouted = self.modelled() + (self.local() as f64 * SCOUT_SHARE) as usize;
        if self.lines.is_none() && self.trials.len() < scouted {
            return self.scouts(&mut rng);
        }
        let space = self.rest();
        let mut lines = self.lines.take().unwrap_or_else(|| {
            let left = self.settings.budget.saturating_sub(self.trials.len());
            Lines::begin(&self.space, &self.ranked(), &self.lengths, left)
        });
        let batch = lines.ask(&space, &mut rng);
        self.lines = Some(lines);
        batch
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.trials.extend_from_slice(trials);
        if let Some(model) = &mut self.model {
            model.tell(trials);
        }
        if let Some(lines) = &mut self.lines {
            lines.tell(trials);
        }
    }
}
