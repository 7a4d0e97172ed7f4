//! The method that knows the structure of the problem: cheap designs first, proofs before trials, a model for the
//! region, then a local search that does not trust the model with needles.
//!
//! 1. Seed points take the least count only: fewer sensors cost fewer rays, and a good score there often proves that
//!    larger counts cannot win ([`Space::that_can_exceed`]). Counts that stay possible get seed points in turn.
//! 2. Bayesian optimization over what is left, symmetries folded.
//! 3. Evolution around the best points, with steps of all sizes from the first to the last evaluation (log-uniform):
//!    the objective is a smooth hill under needles of every width, so no single step size is right. Parents narrow from
//!    many to one.

use serde::{Deserialize, Serialize};

use super::{Bayesian, Candidate, Optimizer, Settings, Space, Trial, generator};
use crate::rng::Rng;

const SEEDS_PER_COUNT: usize = 12;
/// Bayesian evaluations at most: beyond, the model costs more than the objective and says less.
const MODELLED_MAX: usize = 120;
/// Children between two looks at the ranking.
const GENERATION: usize = 12;
const PARENTS_FIRST: f64 = 30.0;
const STEP_MAX: f64 = 0.2;
const STEP_MIN: f64 = 1e-4;

/// Cheap first, then modelled, then local.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Staged {
    space: Space,
    settings: Settings,
    step: u64,
    /// Count whose seed points come next.
    next_count: f64,
    trials: Vec<Trial>,
    model: Option<Bayesian>,
    is_local: bool,
    /// Best first; all distinct trials that may be parents.
    parents: Vec<Trial>,
}

impl Staged {
    /// Nothing evaluated yet.
    pub fn new(space: Space, settings: Settings) -> Self {
        let space = space.folded();
        let next_count = space.variables()[0].low;
        Self {
            space,
            settings,
            step: 0,
            next_count,
            trials: Vec::new(),
            model: None,
            is_local: false,
            parents: Vec::new(),
        }
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

    fn children(&mut self, rng: &mut Rng) -> Vec<Candidate> {
        let space = self.rest();
        if self.parents.is_empty() {
            self.parents = self.trials.clone();
            self.parents.sort_by(Trial::order);
        }
        let planned = self.settings.budget.saturating_sub(self.modelled()).max(1) as f64;
        let used = (self.trials.len().saturating_sub(self.modelled()) as f64 / planned).min(1.0);
        let count = PARENTS_FIRST.powf(1.0 - used).round() as usize;
        let parents = self.parents.len().min(count.max(1));
        let child = |_| {
            let parent = &self.parents[rng.below(parents as u64) as usize].candidate.values;
            Candidate { values: vary(&space, parent, rng) }
        };
        (0..GENERATION).map(child).collect()
    }
}

/// A child: each free variable moves with even odds (at least one does), by a normal step of log-uniform size.
fn vary(space: &Space, parent: &[f64], rng: &mut Rng) -> Vec<f64> {
    let mut values = parent.to_vec();
    let free = space.free(parent);
    if free.is_empty() {
        return values;
    }
    let scale = STEP_MIN * (STEP_MAX / STEP_MIN).powf(rng.uniform());
    let sure = free[rng.below(free.len() as u64) as usize];
    for index in free {
        let variable = &space.variables()[index];
        if variable.integer {
            if index == sure || rng.uniform() < scale {
                values[index] += if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
            }
        } else if index == sure || rng.uniform() < 0.5 {
            values[index] += scale * (variable.high - variable.low) * rng.normal();
        }
    }
    space.clamp(&mut values);
    values
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
                self.model =
                    Some(Bayesian::continued(self.space.clone(), self.settings, self.trials.clone()));
            }
            if let Some(model) = &mut self.model {
                return model.ask();
            }
        }
        self.model = None;
        self.is_local = true;
        self.children(&mut rng)
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.trials.extend_from_slice(trials);
        if let Some(model) = &mut self.model {
            model.tell(trials);
        }
        if self.is_local {
            for trial in trials {
                let place = self.parents.partition_point(|known| !trial.beats(known));
                self.parents.insert(place, trial.clone());
            }
            self.parents.truncate(PARENTS_FIRST as usize);
        }
    }
}
