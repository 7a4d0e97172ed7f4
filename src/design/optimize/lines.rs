//! Local searches from many points at once, the worse half given up in each round.
//!
//! Objectives over mounts are a smooth hill under needles of a width that differs by variable: steps have all
//! sizes, log-uniform for each variable, so that none has to be right. Optima often lie on a border or on a plane of
//! symmetry (across which an objective has no slope), which steps alone never hit: some moves go there. Halving: Karnin,
//! Koren, Somekh 2013, <https://proceedings.mlr.press/v28/karnin13.html>; moves along the difference of two other
//! searches: Storn, Price 1997, doi:10.1023/A:1008202821328.

use serde::{Deserialize, Serialize};

use super::{Candidate, Space, Trial};
use crate::base::rng::Rng;

/// One search for so many evaluations, within bounds: with fewer each, the first rounds would judge starts, not searches.
const EVALUATIONS_PER_LINE: usize = 150;
const LINES: (usize, usize) = (2, 24);
/// Minimum and maximum step, shares of a variable's range.
const STEPS: (f64, f64) = (1e-4, 0.1);
/// Least distance between the starts of two searches, each variable in lengths over which the objective changes: with
/// less, all start on the widest hill, and a higher one that is narrow gets none.
const APART: f64 = 0.5;
/// That length where no model knows it, as a share of the variable's range.
pub const TYPICAL_LENGTH: f64 = 0.1;
/// Variables that move in addition to the sure one, on average; at most this share of them.
const MOVED: f64 = 1.2;
const MOVED_SHARE: f64 = 0.4;
/// Chance that a variable which moves goes to one of its bounds.
const TO_BOUND: f64 = 0.2;
/// Chance of a move along the difference of two other searches.
const DIFFERENCE: f64 = 0.2;
/// Chance of taking over an interchangeable group of variables (a sensor) from another search.
const EXCHANGE: f64 = 0.1;
/// Evaluations that one batch holds at least.
const BATCH: usize = 8;

/// Running searches.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lines {
    /// Best point of each search, the best first at the start of each round.
    bests: Vec<Trial>,
    /// Search that each candidate of the last batch belongs to.
    asked: Vec<usize>,
    /// Evaluations left in all, and of this round.
    left: usize,
    round_left: usize,
}

impl Lines {
    /// Starts from the best of these trials that lie apart, with about `evaluations` to spend. `lengths` says for each
    /// variable over which share of its range the objective changes.
    pub(crate) fn begin(space: &Space, ranked: &[&Trial], lengths: &[f64], evaluations: usize) -> Self {
        let wanted = (evaluations / EVALUATIONS_PER_LINE).clamp(LINES.0, LINES.1);
        let mut starts: Vec<(Vec<f64>, Trial)> = Vec::new();
        for trial in ranked {
            let unit = space.to_unit(&space.canonical(&trial.candidate.values));
            let is_apart = |other: &Vec<f64>| {
                let squares =
                    unit.iter().zip(other).zip(lengths).map(|((a, b), length)| ((a - b) / length).powi(2));
                squares.sum::<f64>() > APART * APART
            };
            if starts.iter().all(|(other, _)| is_apart(other)) {
                starts.push((unit, (*trial).clone()));
            }
            if starts.len() == wanted {
                break;
            }
        }
        let bests = starts.into_iter().map(|(_, trial)| trial).collect();
        let mut lines = Self { bests, asked: Vec::new(), left: evaluations, round_left: 0 };
        lines.round_left = lines.round();
        lines
    }

    /// Evaluations of one round: the halvings left share what is left.
    fn round(&self) -> usize {
        let rounds = self.bests.len().max(1).ilog2() as usize + 1;
        (self.left / rounds).max(self.bests.len())
    }

    /// Whether all planned evaluations are spent.
    pub(crate) fn is_spent(&self) -> bool {
        self.left == 0
    }

    /// One move of each search, several where there are few.
    pub(crate) fn ask(&mut self, space: &Space, rng: &mut Rng) -> Vec<Candidate> {
        if self.round_left == 0 {
            self.bests.sort_by(Trial::order);
            self.bests.truncate(self.bests.len().div_ceil(2));
            self.round_left = self.round();
        }
        let lines = self.bests.len();
        let turns = if lines < BATCH { BATCH.div_ceil(lines.max(1)) } else { 1 };
        self.asked = (0..turns).flat_map(|_| 0..lines).collect();
        let mut batch = Vec::with_capacity(self.asked.len());
        for &line in &self.asked {
            let from = &self.bests[line].candidate.values;
            let values = if lines > 1 && rng.uniform() < EXCHANGE {
                self.with_a_group_of_another(space, from, rng)
            } else if lines > 3 && rng.uniform() < DIFFERENCE {
                self.along_a_difference(space, from, rng)
            } else {
                vary(space, from, STEPS, rng)
            };
            batch.push(Candidate { values });
        }
        batch
    }

    fn along_a_difference(&self, space: &Space, from: &[f64], rng: &mut Rng) -> Vec<f64> {
        let mut other = || &self.bests[rng.below(self.bests.len() as u64) as usize].candidate.values;
        let (first, second) = (other(), other());
        let factor = rng.between(0.2, 0.9);
        let mut values = from.to_vec();
        for index in space.free(from) {
            if !space.variables()[index].integer && rng.uniform() < 0.7 {
                values[index] += factor * (first[index] - second[index]);
            }
        }
        space.clamp(&mut values);
        values
    }

    /// What is seen adds up over groups: what is good with one may be good with another. Where there is one group
    /// only, a step as any other.
    fn with_a_group_of_another(&self, space: &Space, from: &[f64], rng: &mut Rng) -> Vec<f64> {
        let other = &self.bests[rng.below(self.bests.len() as u64) as usize].candidate.values;
        let (mine, theirs) = (space.active_groups(from), space.active_groups(other));
        if mine.len() < 2 || theirs.is_empty() {
            return vary(space, from, STEPS, rng);
        }
        let into = mine[rng.below(mine.len() as u64) as usize];
        let removed = theirs[rng.below(theirs.len() as u64) as usize];
        let mut values = from.to_vec();
        for (&index, &source) in into.iter().zip(removed) {
            values[index] = other[source];
        }
        values
    }

    /// What the last batch was worth.
    pub(crate) fn tell(&mut self, trials: &[Trial]) {
        for (&line, trial) in std::mem::take(&mut self.asked).iter().zip(trials) {
            if trial.beats(&self.bests[line]) {
                self.bests[line] = trial.clone();
            }
            self.left = self.left.saturating_sub(1);
            self.round_left = self.round_left.saturating_sub(1);
        }
    }
}

/// A point near another: each free variable moves by chance (one does for certain), by a normal step with a size that is
/// log-uniform within `steps`, shares of its range, or to one of its bounds; integers move by one.
pub(crate) fn vary(space: &Space, from: &[f64], steps: (f64, f64), rng: &mut Rng) -> Vec<f64> {
    let mut values = from.to_vec();
    let free = space.free(from);
    if free.is_empty() {
        return values;
    }
    let moves = MOVED_SHARE.min(MOVED / free.len() as f64);
    let sure = free[rng.below(free.len() as u64) as usize];
    for index in free {
        let variable = &space.variables()[index];
        let scale = steps.0 * (steps.1 / steps.0).powf(rng.uniform());
        if variable.integer {
            if index == sure || rng.uniform() < scale {
                values[index] += if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
            }
        } else if index == sure || rng.uniform() < moves {
            values[index] = match rng.uniform() {
                u if u < 0.5 * TO_BOUND => variable.low,
                u if u < TO_BOUND => variable.high,
                _ => values[index] + scale * (variable.high - variable.low) * rng.normal(),
            };
        }
    }
    space.clamp(&mut values);
    values
}
