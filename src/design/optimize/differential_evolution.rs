//! Differential evolution with success-history adaptation and a shrinking population (L-SHADE).
//!
//! Tanabe, Fukunaga 2014 (doi:10.1109/CEC.2014.6900380); archive and current-to-pbest mutation: Zhang, Sanderson 2009
//! (doi:10.1109/TEVC.2009.2014613). Works in the unit cube; an integer's values share its interval evenly.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::{Candidate, Optimizer, Settings, Space, Trial, generator};
use crate::base::rng::Rng;

const MEMORY: usize = 6;
const BEST_SHARE: f64 = 0.11;
const ARCHIVE_SHARE: f64 = 2.6;
const LEAST_MEMBERS: usize = 4;
/// Generations planned if the population stayed at its first size.
const GENERATIONS: usize = 20;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Member {
    unit: Vec<f64>,
    trial: Trial,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Proposal {
    unit: Vec<f64>,
    factor: f64,
    crossover: f64,
}

/// L-SHADE, sized for the planned budget.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DifferentialEvolution {
    space: Space,
    seed: u64,
    budget: usize,
    early_stop: bool,
    step: u64,
    evaluations: usize,
    /// Evaluations before the latest restart.
    restarted_at: usize,
    first_members: usize,
    members: Vec<Member>,
    archive: Vec<Vec<f64>>,
    proposals: Vec<Proposal>,
    memory_factor: Vec<f64>,
    memory_crossover: Vec<f64>,
    memory_at: usize,
}

impl DifferentialEvolution {
    /// Nothing evaluated yet.
    pub(crate) fn new(space: Space, settings: Settings) -> Self {
        let first_members = (settings.budget / GENERATIONS).clamp(12, 100);
        Self {
            space,
            seed: settings.seed,
            budget: settings.budget,
            early_stop: settings.early_stop,
            step: 0,
            evaluations: 0,
            restarted_at: 0,
            first_members,
            members: Vec::new(),
            archive: Vec::new(),
            proposals: Vec::new(),
            memory_factor: vec![0.5; MEMORY],
            memory_crossover: vec![0.5; MEMORY],
            memory_at: 0,
        }
    }

    fn is_converged(&self) -> bool {
        let Some(first) = self.members.first() else { return false };
        let same = |m: &Member| m.unit.iter().zip(&first.unit).all(|(a, b)| (a - b).abs() < 1e-9);
        self.members.iter().all(same)
    }

    fn propose(&self, index: usize, rng: &mut Rng) -> Proposal {
        let count = self.members.len() as u64;
        let slot = rng.below(MEMORY as u64) as usize;
        let crossover = (self.memory_crossover[slot] + 0.1 * rng.normal()).clamp(0.0, 1.0);
        let factor = loop {
            let cauchy = self.memory_factor[slot] + 0.1 * (PI * (rng.uniform() - 0.5)).tan();
            if cauchy > 0.0 {
                break cauchy.min(1.0);
            }
        };
        let bests = ((count as f64 * BEST_SHARE).round() as u64).clamp(2.min(count), count);
        let best = &self.members[rng.below(bests) as usize].unit;
        let other = |rng: &mut Rng, bound: u64, not: &[usize]| loop {
            let drawn = rng.below(bound) as usize;
            if !not.contains(&drawn) {
                break drawn;
            }
        };
        let first = other(rng, count, &[index]);
        let second = other(rng, count + self.archive.len() as u64, &[index, first]);
        let second = self
            .members
            .get(second)
            .map_or_else(|| &self.archive[second - self.members.len()], |member| &member.unit);
        let here = &self.members[index].unit;
        let memo = rng.below(here.len() as u64) as usize;
        let mut unit = here.clone();
        for axis in 0..here.len() {
            if axis == memo || rng.uniform() < crossover {
                let mutant = here[axis]
                    + factor * (best[axis] - here[axis])
                    + factor * (self.members[first].unit[axis] - second[axis]);
                unit[axis] = match mutant {
                    m if m < 0.0 => 0.5 * here[axis],
                    m if m > 1.0 => 0.5 * (here[axis] + 1.0),
                    m => m,
                };
            }
        }
        Proposal { unit, factor, crossover }
    }

    /// Weighted Lehmer means of what succeeded.
    fn learn(&mut self, successes: &[(f64, f64, f64)]) {
        let total: f64 = successes.iter().map(|s| s.0).sum();
        if total <= 0.0 {
            return;
        }
        let lehmer = |value: fn(&(f64, f64, f64)) -> f64| {
            let sum: f64 = successes.iter().map(|s| s.0 * value(s)).sum();
            let squares: f64 = successes.iter().map(|s| s.0 * value(s) * value(s)).sum();
            if sum > 0.0 { squares / sum } else { 0.0 }
        };
        self.memory_factor[self.memory_at] = lehmer(|s| s.1);
        self.memory_crossover[self.memory_at] = lehmer(|s| s.2);
        self.memory_at = (self.memory_at + 1) % MEMORY;
    }

    /// The population shrinks linearly with the evaluations of its run, the worst first.
    fn shrink(&mut self) {
        let planned = self.budget.saturating_sub(self.restarted_at).max(1);
        let used = (self.evaluations - self.restarted_at) as f64 / planned as f64;
        let span = self.first_members as f64 - LEAST_MEMBERS as f64;
        let wanted = self.first_members as f64 - span * used.min(1.0);
        self.members.truncate((wanted.round() as usize).max(LEAST_MEMBERS));
        let room = (self.members.len() as f64 * ARCHIVE_SHARE) as usize;
        let surplus = self.archive.len().saturating_sub(room);
        self.archive.drain(..surplus);
    }
}

impl Optimizer for DifferentialEvolution {
    fn ask(&mut self) -> Vec<Candidate> {
        if self.is_converged() {
            if self.early_stop {
                return Vec::new();
            }
            self.members.clear();
            self.archive.clear();
            self.restarted_at = self.evaluations;
        }
        let mut rng = generator(self.seed, self.step);
        self.step += 1;
        self.proposals = if self.members.is_empty() {
            let draw = |rng: &mut Rng| (0..self.space.len()).map(|_| rng.uniform()).collect();
            let first = (0..self.first_members).map(|_| Proposal {
                unit: draw(&mut rng),
                factor: 0.5,
                crossover: 0.5,
            });
            first.collect()
        } else {
            (0..self.members.len()).map(|index| self.propose(index, &mut rng)).collect()
        };
        self.proposals.iter().map(|p| Candidate { values: self.space.values_at(&p.unit) }).collect()
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.evaluations += trials.len();
        let proposals = std::mem::take(&mut self.proposals);
        let arrived = proposals.iter().zip(trials);
        if self.members.is_empty() {
            self.members = arrived.map(|(p, t)| Member { unit: p.unit.clone(), trial: t.clone() }).collect();
        } else {
            let mut successes = Vec::new();
            for (index, (proposal, trial)) in arrived.enumerate() {
                let old = &self.members[index];
                if old.trial.beats(trial) {
                    continue;
                }
                if trial.beats(&old.trial) {
                    let gain =
                        (trial.score - old.trial.score).abs() + (old.trial.violation - trial.violation);
                    successes.push((gain, proposal.factor, proposal.crossover));
                    self.archive.push(old.unit.clone());
                }
                self.members[index] = Member { unit: proposal.unit.clone(), trial: trial.clone() };
            }
            self.learn(&successes);
        }
        self.members.sort_by(|a, b| a.trial.order(&b.trial));
        self.shrink();
    }
}
