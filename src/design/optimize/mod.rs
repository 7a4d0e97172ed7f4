//! Ask/tell search methods. Scores are maximised.
//!
//! A method proposes candidates and receives their scores; [`Search`] owns the loop, the budget and the history.
//! Methods draw random numbers from the seed and the number of the batch only, so that their whole state is plain data:
//! a search can be written to disk after any evaluation and goes on as if it had never stopped, on any number of threads.

use serde::{Deserialize, Serialize};

use crate::base::rng::Rng;

mod ascent;
mod bayesian;
mod busy;
mod certificate;
mod cma_es;
mod differential_evolution;
mod export;
mod final_look;
pub mod forward_substitution;
mod gaussian_process;
mod genetic;
mod lines;
mod method;
mod mounts;
mod normal;
mod particle_swarm;
mod pattern;
mod polished;
mod random;
mod refinement;
mod run;
mod search;
mod settings;
mod shortlist;
mod space;
mod staged;
pub(crate) mod state_file;

pub use bayesian::Bayesian;
pub use certificate::{Certificate, certify};
pub use cma_es::CmaEs;
pub use differential_evolution::DifferentialEvolution;
pub use final_look::FinalLook;
pub(crate) use final_look::JudgedShortlist;
pub use genetic::Genetic;
pub use method::{Kind, Method};
pub use mounts::{KeepApart, MountBounds, MountProblem, MountSearch, PUBLISHED_MASTERS_MAX};
pub use particle_swarm::ParticleSwarm;
pub use pattern::{Pattern, Poll};
pub use random::Random;
pub(crate) use refinement::{Refinement, Refiner};
pub(crate) use run::{RunEnd, SearchRun};
pub use search::{Measured, Search, SearchError, StoppedBy};
pub use settings::{Acquisition, Settings};
pub use space::{Mirror, Space, SpaceError, Variable};
pub use staged::Staged;

/// A point to evaluate: one value per variable of the space, integers as whole numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// In the order of `Space::variables`.
    pub values: Vec<f64>,
}

/// A candidate and what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Where.
    pub candidate: Candidate,
    /// Objective, maximised. Of an infeasible point it counts only among points of equal violation.
    pub score: f64,
    /// How far the point is from feasible, 0 when it is; in units of the caller's constraint.
    pub violation: f64,
}

impl Trial {
    /// Whether this one is better: feasible before infeasible, then less violation, then the higher score
    /// (Deb 2000, doi:10.1016/S0045-7825(99)00389-8). Not better than its equal.
    pub(crate) fn beats(&self, other: &Trial) -> bool {
        self.order(other) == std::cmp::Ordering::Less
    }

    /// Best first.
    pub(crate) fn order(&self, other: &Trial) -> std::cmp::Ordering {
        self.violation.total_cmp(&other.violation).then(other.score.total_cmp(&self.score))
    }
}

/// A search method: proposes, then learns. `tell` answers the last `ask`, whole and in its order.
pub trait Optimizer {
    /// The next batch, of the method's natural size; independent of threads and budget left. Empty when the method has
    /// converged.
    fn ask(&mut self) -> Vec<Candidate>;

    /// What the last batch was worth.
    fn tell(&mut self, trials: &[Trial]);
}

/// Independent random numbers for each step of a search (SplitMix64 finaliser, doi:10.1145/2660193.2660195, so that
/// neighbouring seeds and steps share nothing).
fn generator(seed: u64, step: u64) -> Rng {
    let mix = |mut z: u64| {
        z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    Rng::new(mix(seed ^ mix(step)), step)
}
