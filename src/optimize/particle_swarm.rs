//! Particle swarm with an inertia weight.
//!
//! Kennedy, Eberhart 1995 (doi:10.1109/ICNN.1995.488968); inertia: Shi, Eberhart 1998 (doi:10.1109/ICEC.1998.699146).

use serde::{Deserialize, Serialize};

use super::polished::{Polished, Population, members, searched};
use super::{Candidate, Settings, Space, Trial, generator};

const PARTICLES: usize = 60;
const ITERATIONS: u64 = 80;
const INERTIA: f64 = 0.7;
const COGNITIVE: f64 = 1.4;
const SOCIAL: f64 = 1.4;
/// Greatest speed at the start, as a share of the range.
const FIRST_SPEED: f64 = 0.5;

/// The swarm, then pattern search.
pub type ParticleSwarm = Polished<Swarm>;

/// The particles. Positions are shares of the range; an integer is the rounded value.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Swarm {
    space: Space,
    seed: u64,
    restart: u64,
    size: usize,
    iteration: u64,
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
    /// Where each particle found its best, and what it was worth.
    bests: Vec<(Vec<f64>, Trial)>,
    /// Which particle's best is the swarm's.
    leader: usize,
}

impl ParticleSwarm {
    /// Nothing evaluated yet.
    pub fn start(space: Space, settings: Settings) -> Self {
        let space = searched(space, settings);
        let swarm = Swarm {
            space: space.clone(),
            seed: settings.seed,
            restart: 0,
            size: members(PARTICLES, settings),
            iteration: 0,
            positions: Vec::new(),
            velocities: Vec::new(),
            bests: Vec::new(),
            leader: 0,
        };
        Polished::new(space, swarm, settings)
    }
}

impl Swarm {
    fn values(&self, position: &[f64]) -> Vec<f64> {
        let share = |(&u, v): (&f64, &super::Variable)| v.low + u * (v.high - v.low);
        let mut values: Vec<f64> = position.iter().zip(self.space.variables()).map(share).collect();
        self.space.clamp(&mut values);
        values
    }
}

impl Population for Swarm {
    fn ask(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.seed, self.restart << 32 | self.iteration);
        if self.iteration == 0 {
            let draw = |rng: &mut crate::rng::Rng, low, high| -> Vec<f64> {
                (0..self.space.len()).map(|_| rng.between(low, high)).collect()
            };
            self.positions = (0..self.size).map(|_| draw(&mut rng, 0.0, 1.0)).collect();
            self.velocities = (0..self.size).map(|_| draw(&mut rng, -FIRST_SPEED, FIRST_SPEED)).collect();
        } else {
            for particle in 0..self.size {
                for axis in 0..self.space.len() {
                    let here = self.positions[particle][axis];
                    let own = self.bests[particle].0[axis] - here;
                    let shared = self.bests[self.leader].0[axis] - here;
                    let speed = INERTIA * self.velocities[particle][axis]
                        + COGNITIVE * rng.uniform() * own
                        + SOCIAL * rng.uniform() * shared;
                    let there = here + speed;
                    let inside = there.clamp(0.0, 1.0);
                    self.positions[particle][axis] = inside;
                    self.velocities[particle][axis] = if inside == there { speed } else { 0.0 };
                }
            }
        }
        self.positions.iter().map(|position| Candidate { values: self.values(position) }).collect()
    }

    fn tell(&mut self, trials: &[Trial]) {
        for (particle, trial) in trials.iter().enumerate() {
            let place = || (self.positions[particle].clone(), trial.clone());
            match self.bests.get(particle) {
                None => {
                    let place = place();
                    self.bests.push(place);
                }
                Some((_, best)) if trial.beats(best) => {
                    let place = place();
                    self.bests[particle] = place;
                }
                Some(_) => (),
            }
        }
        for particle in 0..self.bests.len() {
            if self.bests[particle].1.beats(&self.bests[self.leader].1) {
                self.leader = particle;
            }
        }
        self.iteration += 1;
    }

    fn best(&self) -> Option<&Trial> {
        self.bests.get(self.leader).map(|(_, trial)| trial)
    }

    fn is_spent(&self) -> bool {
        self.iteration >= ITERATIONS
    }

    fn restart(&mut self, restart: u64) {
        self.restart = restart;
        self.iteration = 0;
        self.bests.clear();
        self.leader = 0;
    }
}
