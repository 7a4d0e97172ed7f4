//! Mixed-integer genetic algorithm with Laplace crossover and power mutation.
//!
//! MI-LXPM (Deep, Singh, Kansal, Mohan 2009, doi:10.1016/j.amc.2009.02.044); its parameters are that paper's.

use serde::{Deserialize, Serialize};

use super::polished::{Polished, Population, first_members, is_long, local_share, members};
use super::{Candidate, Settings, Space, Trial, generator};
use crate::base::rng::Rng;

const POPULATION: usize = 80;
const GENERATIONS: u64 = 100;
const TOURNAMENT: u64 = 3;
const CROSSOVER_PROBABILITY: f64 = 0.8;
const MUTATION_PROBABILITY: f64 = 0.005;
const LAPLACE_REAL: f64 = 0.15;
const LAPLACE_INTEGER: f64 = 0.35;
const POWER_REAL: f64 = 10.0;
const POWER_INTEGER: f64 = 4.0;
/// One member in twenty survives unchanged.
const ELITE_SHARE: f64 = 0.05;
/// Spent when the best of the last 50 generations grew by less than this, relative.
const FUNCTION_TOLERANCE: f64 = 1e-4;
const STALL_GENERATIONS: usize = 50;
/// In a long search most evaluations go to the local ones, and classes of equal points are left unfolded, which keeps more
/// hills in the population.
const LOCAL_SHARE_WHEN_LONG: f64 = 0.75;

/// The genetic algorithm, then pattern search.
pub type Genetic = Polished<Genes>;

/// The population.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Genes {
    space: Space,
    seed: u64,
    restart: u64,
    size: usize,
    first_size: usize,
    generation: u64,
    /// Best first.
    members: Vec<Trial>,
    /// Best score after each generation.
    best_scores: Vec<f64>,
}

impl Genetic {
    /// Nothing evaluated yet.
    pub(crate) fn start(space: Space, settings: Settings) -> Self {
        let space = if is_long(settings) || settings.early_stop { space } else { space.folded() };
        let genes = Genes {
            space: space.clone(),
            seed: settings.seed,
            restart: 0,
            size: members(POPULATION, settings),
            first_size: first_members(POPULATION, settings),
            generation: 0,
            members: Vec::new(),
            best_scores: Vec::new(),
        };
        Polished::new(space, genes, settings, local_share(settings, LOCAL_SHARE_WHEN_LONG))
    }
}

impl Genes {
    fn elite(&self) -> usize {
        ((self.size as f64 * ELITE_SHARE).ceil() as usize).max(1)
    }

    fn parent(&self, rng: &mut Rng) -> &[f64] {
        // members are sorted: the least index is the fittest of the tournament
        let winner = (0..TOURNAMENT).map(|_| rng.below(self.members.len() as u64)).min().unwrap_or(0);
        &self.members[winner as usize].candidate.values
    }

    /// Two children on the line through their parents, as far as a Laplace number says.
    fn cross(&self, first: &[f64], second: &[f64], rng: &mut Rng) -> [Vec<f64>; 2] {
        let mut children = [first.to_vec(), second.to_vec()];
        for (index, variable) in self.space.variables().iter().enumerate() {
            let scale = if variable.integer { LAPLACE_INTEGER } else { LAPLACE_REAL };
            let magnitude = -scale * (1.0 - rng.uniform()).ln();
            let beta = if rng.uniform() < 0.5 { magnitude } else { -magnitude };
            let reach = beta * (first[index] - second[index]).abs();
            children[0][index] += reach;
            children[1][index] += reach;
        }
        children
    }

    fn mutate(&self, child: &mut [f64], rng: &mut Rng) {
        for (value, variable) in child.iter_mut().zip(self.space.variables()) {
            if rng.uniform() >= MUTATION_PROBABILITY || variable.low == variable.high {
                continue;
            }
            let power = if variable.integer { POWER_INTEGER } else { POWER_REAL };
            let size = rng.uniform().powf(power);
            let inside = value.clamp(variable.low, variable.high);
            let towards_low = (inside - variable.low) / (variable.high - variable.low) < rng.uniform();
            *value = if towards_low {
                inside - size * (inside - variable.low)
            } else {
                inside + size * (variable.high - inside)
            };
        }
    }

    /// Integers are truncated up or down at random; what leaves the bounds is drawn again, as MI-LXPM does.
    fn repair(&self, child: &mut [f64], rng: &mut Rng) {
        for (value, variable) in child.iter_mut().zip(self.space.variables()) {
            if variable.integer && value.fract() != 0.0 {
                *value = value.floor() + f64::from(u8::from(rng.uniform() < 0.5));
            }
            if *value < variable.low || *value > variable.high {
                *value = if variable.integer {
                    variable.low + rng.below((variable.high - variable.low) as u64 + 1) as f64
                } else {
                    rng.between(variable.low, variable.high)
                };
            }
        }
    }
}

impl Population for Genes {
    fn ask(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.seed, self.restart << 32 | self.generation);
        if self.members.is_empty() {
            let points = self.space.latin_hypercube(self.first_size, &mut rng);
            return points.into_iter().map(|values| Candidate { values }).collect();
        }
        let wanted = self.size.saturating_sub(self.elite()).max(1);
        let mut children = Vec::with_capacity(wanted + 1);
        while children.len() < wanted {
            let (first, second) = (self.parent(&mut rng), self.parent(&mut rng));
            let pair = if rng.uniform() < CROSSOVER_PROBABILITY {
                self.cross(first, second, &mut rng)
            } else {
                [first.to_vec(), second.to_vec()]
            };
            for mut values in pair {
                self.mutate(&mut values, &mut rng);
                self.repair(&mut values, &mut rng);
                // an unchanged copy has been evaluated already
                if self.members.iter().any(|member| member.candidate.values == values) {
                    let axis = rng.below(values.len() as u64) as usize;
                    values[axis] = self.space.sample(&mut rng)[axis];
                }
                children.push(Candidate { values });
            }
        }
        children.truncate(wanted);
        children
    }

    fn tell(&mut self, trials: &[Trial]) {
        let elite = self.elite();
        self.members.truncate(elite);
        self.members.extend_from_slice(trials);
        self.members.sort_by(Trial::order);
        self.members.truncate(self.size);
        self.best_scores.push(self.members[0].score);
        self.generation += 1;
    }

    fn best(&self) -> Option<&Trial> {
        self.members.first()
    }

    fn is_spent(&self) -> bool {
        let stalled = self.best_scores.len().checked_sub(STALL_GENERATIONS + 1).is_some_and(|from| {
            let (then, now) = (self.best_scores[from], self.best_scores[self.best_scores.len() - 1]);
            (now - then).abs() <= FUNCTION_TOLERANCE * now.abs().max(1.0)
        });
        stalled || self.generation >= GENERATIONS
    }

    fn restart(&mut self, restart: u64) {
        self.restart = restart;
        self.generation = 0;
        self.members.clear();
        self.best_scores.clear();
    }
}
