//! The method that knows the structure of the problem: cheap designs first, proofs before trials, a model for the
//! region, then a local search that does not trust the model with needles.
//!
//! 1. Seed points take the least count only: fewer sensors cost fewer rays, and a good score there often proves that
//!    larger counts cannot win ([`Space::that_can_exceed`]). Counts that stay possible get seed points in turn.
//! 2. Bayesian optimization over what is left, symmetries folded.
//! 3. Local searches around many of the best points, with steps of all sizes, log-uniform for each variable: the objective
//!    is a smooth hill under needles whose width differs from variable to variable, so no single step size is right. The
//!    worse half of the searches is given up in each round (sequential halving: Karnin, Koren, Somekh 2013,
//!    <https://proceedings.mlr.press/v28/karnin13.html>).

use serde::{Deserialize, Serialize};

use super::{Bayesian, Candidate, Optimizer, Settings, Space, Trial, generator};
use crate::rng::Rng;

const SEEDS_PER_COUNT: usize = 12;
/// Bayesian evaluations at most: beyond, the model costs more than the objective and says less.
const MODELLED_MAX: usize = 120;
/// Share of the local evaluations that look for places worth a local search.
const SCOUT_SHARE: f64 = 0.25;
/// Scouts start from so many of the best points.
const SCOUTED: usize = 30;
const SCOUT_STEPS: (f64, f64) = (0.01, 0.2);
const SCOUTS_AT_ONCE: usize = 16;
/// Local searches at first: one for so many local evaluations, within bounds.
const EVALUATIONS_PER_LINE: usize = 40;
const LINES: (usize, usize) = (2, 64);
const LINE_STEPS: (f64, f64) = (1e-5, 0.1);
/// Least distance between the starts of two local searches, as a share of some variable's range.
const APART: f64 = 2e-3;

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
    /// Best point of each local search, the best first at the start of each round; empty before the first.
    lines: Vec<Trial>,
    /// Local search that each candidate of the last batch belongs to.
    asked: Vec<usize>,
    /// Evaluations left of this round.
    round_left: usize,
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
            lines: Vec::new(),
            asked: Vec::new(),
            round_left: 0,
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

    /// The best points that lie apart from each other, one for each local search.
    fn begin_lines(&mut self) {
        let wanted = (self.local() / EVALUATIONS_PER_LINE).clamp(LINES.0, LINES.1);
        let mut lines: Vec<(Vec<f64>, Trial)> = Vec::new();
        for trial in self.ranked() {
            let unit = self.space.to_unit(&self.space.canonical(&trial.candidate.values));
            let is_apart = |other: &Vec<f64>| unit.iter().zip(other).any(|(a, b)| (a - b).abs() > APART);
            if lines.iter().all(|(other, _)| is_apart(other)) {
                lines.push((unit, trial.clone()));
            }
            if lines.len() == wanted {
                break;
            }
        }
        self.lines = lines.into_iter().map(|(_, trial)| trial).collect();
        self.round_left = self.round();
    }

    /// Evaluations of one round: the halvings left share what is left of the plan.
    fn round(&self) -> usize {
        let rounds = self.lines.len().max(1).ilog2() as usize + 1;
        (self.settings.budget.saturating_sub(self.trials.len()) / rounds).max(self.lines.len())
    }

    fn children(&mut self, rng: &mut Rng) -> Vec<Candidate> {
        if self.lines.is_empty() {
            self.begin_lines();
        }
        if self.round_left == 0 {
            self.lines.sort_by(Trial::order);
            self.lines.truncate(self.lines.len().div_ceil(2));
            self.round_left = self.round();
        }
        let space = self.rest();
        let count = if self.lines.len() < 8 { 8usize.div_ceil(self.lines.len()) } else { 1 };
        self.asked = (0..count).flat_map(|_| 0..self.lines.len()).collect();
        let child = |&line: &usize| Candidate {
            values: vary(&space, &self.lines[line].candidate.values, LINE_STEPS, rng),
        };
        self.asked.iter().map(child).collect()
    }
}

/// A point near another: each free variable moves with even odds (at least one does), by a normal step whose size is
/// log-uniform within `steps`, shares of its range; integers move by one.
fn vary(space: &Space, from: &[f64], steps: (f64, f64), rng: &mut Rng) -> Vec<f64> {
    let mut values = from.to_vec();
    let free = space.free(from);
    if free.is_empty() {
        return values;
    }
    let sure = free[rng.below(free.len() as u64) as usize];
    for index in free {
        let variable = &space.variables()[index];
        let scale = steps.0 * (steps.1 / steps.0).powf(rng.uniform());
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
                let settings = Settings { early_stop: false, ..self.settings };
                self.model = Some(Bayesian::continued(self.space.clone(), settings, self.trials.clone()));
            }
            if let Some(model) = &mut self.model {
                return model.ask();
            }
        }
        self.model = None;
        let scouted = self.modelled() + (self.local() as f64 * SCOUT_SHARE) as usize;
        if self.lines.is_empty() && self.trials.len() < scouted {
            self.scouts(&mut rng)
        } else {
            self.children(&mut rng)
        }
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.trials.extend_from_slice(trials);
        if let Some(model) = &mut self.model {
            model.tell(trials);
        }
        for (&line, trial) in std::mem::take(&mut self.asked).iter().zip(trials) {
            if trial.beats(&self.lines[line]) {
                self.lines[line] = trial.clone();
            }
            self.round_left = self.round_left.saturating_sub(1);
        }
    }
}
