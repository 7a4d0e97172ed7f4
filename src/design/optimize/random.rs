//! Uniform random search: the yardstick every other method has to beat.

use serde::{Deserialize, Serialize};

use super::{Candidate, Optimizer, Settings, Space, Trial, generator};

const BATCH: usize = 32;

/// Uniform random search (Bergstra, Bengio 2012, <https://www.jmlr.org/papers/v13/bergstra12a.html>).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Random {
    space: Space,
    seed: u64,
    batches: u64,
}

impl Random {
    /// Nothing evaluated yet.
    pub(crate) fn new(space: Space, settings: Settings) -> Self {
        Self { space, seed: settings.seed, batches: 0 }
    }
}

impl Optimizer for Random {
    fn ask(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.seed, self.batches);
        self.batches += 1;
        (0..BATCH).map(|_| Candidate { values: self.space.sample(&mut rng) }).collect()
    }

    fn tell(&mut self, _trials: &[Trial]) {}
}
