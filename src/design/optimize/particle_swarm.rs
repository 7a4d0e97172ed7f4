//! Particle swarm with an inertia weight.
//!
//! Kennedy, Eberhart 1995 (doi:10.1109/ICNN.1995.488968); inertia: Shi, Eberhart 1998 (doi:10.1109/ICEC.1998.699146). As
//! published, all particles are drawn to one leader. Otherwise each looks at its neighbours on a ring alone (Kennedy, Mendes
//! 2002, doi:10.1109/CEC.2002.1004493): one hill then does not win before another was climbed.

use serde::{Deserialize, Serialize};

use super::polished::{Polished, Population, first_members, local_share, members};
use super::{Candidate, Settings, Space, Trial, generator};
use crate::base::rng::Rng;

const PARTICLES: usize = 60;
const ITERATIONS: u64 = 80;
const INERTIA: f64 = 0.7;
const COGNITIVE: f64 = 1.4;
const SOCIAL: f64 = 1.4;
/// Neighbours on either side that a particle looks at on the ring.
const NEIGHBOURS: usize = 2;
/// Maximum speed at the start, as a share of the range.
const FIRST_SPEED: f64 = 0.5;
/// With fewer evaluations classes of equal points are folded into one; with more, a ring has leaders enough to follow several
/// of them.
const FEW: usize = 100;
/// Share of a long budget that is reserved for local searches: a ring gains longest by itself.
const LOCAL_SHARE_WHEN_LONG: f64 = 0.3;

/// The swarm, then pattern search.
pub type ParticleSwarm = Polished<Swarm>;

/// The particles. Positions are shares of the range; an integer is the rounded value.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Swarm {
    space: Space,
    seed: u64,
    restart: u64,
    size: usize,
    /// Points of the first generation; the better ones become the swarm.
    first_size: usize,
    /// Neighbours on either side that a particle looks at; all particles when none.
    neighbours: Option<usize>,
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
    pub(crate) fn start(space: Space, settings: Settings) -> Self {
        let space = if settings.budget < FEW && !settings.early_stop { space.folded() } else { space };
        let swarm = Swarm {
            space: space.clone(),
            seed: settings.seed,
            restart: 0,
            size: members(PARTICLES, settings),
            first_size: first_members(PARTICLES, settings),
            neighbours: (!settings.early_stop).then_some(NEIGHBOURS),
            iteration: 0,
            positions: Vec::new(),
            velocities: Vec::new(),
            bests: Vec::new(),
            leader: 0,
        };
        Polished::new(space, swarm, settings, local_share(settings, LOCAL_SHARE_WHEN_LONG))
    }
}

impl Swarm {
    /// The particle that draws another by its best.
    fn leader_of(&self, particle: usize) -> usize {
        let size = self.bests.len();
        match self.neighbours {
            Some(neighbours) if 2 * neighbours + 1 < size => {
                let ring = (0..=2 * neighbours).map(|step| (particle + size + step - neighbours) % size);
                ring.min_by(|a, b| self.bests[*a].1.order(&self.bests[*b].1)).unwrap_or(particle)
            }
            _ => self.leader,
        }
    }

    /// Latin hypercube, or independent points as published.
    fn first_positions(&self, rng: &mut Rng) -> Vec<Vec<f64>> {
        if self.neighbours.is_none() {
            return (0..self.first_size).map(|_| draw(self.space.len(), rng, 0.0, 1.0)).collect();
        }
        let points = self.space.latin_hypercube(self.first_size, rng);
        points.iter().map(|values| self.space.to_unit(values)).collect()
    }

    /// Leaves the better ones of the first generation.
    fn select(&mut self) {
        let mut order: Vec<usize> = (0..self.bests.len()).collect();
        order.sort_by(|a, b| self.bests[*a].1.order(&self.bests[*b].1));
        order.truncate(self.size);
        self.bests = order.iter().map(|&particle| self.bests[particle].clone()).collect();
        self.positions = order.iter().map(|&particle| self.positions[particle].clone()).collect();
        self.velocities = order.iter().map(|&particle| self.velocities[particle].clone()).collect();
        self.leader = 0;
    }

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
            self.positions = self.first_positions(&mut rng);
            let axes = self.space.len();
            self.velocities =
                self.positions.iter().map(|_| draw(axes, &mut rng, -FIRST_SPEED, FIRST_SPEED)).collect();
        } else {
            for particle in 0..self.bests.len() {
                let leader = self.leader_of(particle);
                for axis in 0..self.space.len() {
                    let here = self.positions[particle][axis];
                    let own = self.bests[particle].0[axis] - here;
                    let shared = self.bests[leader].0[axis] - here;
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
        if self.bests.len() > self.size {
            self.select();
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

fn draw(axes: usize, rng: &mut Rng, low: f64, high: f64) -> Vec<f64> {
    (0..axes).map(|_| rng.between(low, high)).collect()
}
