//! A population method followed by pattern search from its best point, as the published runs do.

use serde::{Deserialize, Serialize};

use super::pattern::Poll;
use super::{Candidate, Optimizer, Settings, Space, Trial};

/// Mesh of the closing pattern search at its start, as a share of each variable's range.
const POLISH_STEP: f64 = 0.02;
/// Share of the budget kept for it.
const POLISH_SHARE: f64 = 0.1;

/// Generations of candidates that end by their own rule.
pub trait Population {
    /// The next generation.
    fn ask(&mut self) -> Vec<Candidate>;
    /// What it was worth.
    fn tell(&mut self, trials: &[Trial]);
    /// The best trial of this population.
    fn best(&self) -> Option<&Trial>;
    /// Whether its own rule says that it has nothing more to give.
    fn is_spent(&self) -> bool;
    /// Forgets all but the settings; restart number `restart` draws other numbers.
    fn restart(&mut self, restart: u64);
}

/// A population method, then pattern search; then, unless the search stops by the published rule, again.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Polished<P> {
    space: Space,
    population: P,
    poll: Option<Poll>,
    early_stop: bool,
    /// Evaluations of the first population at which its polish starts.
    polish_from: usize,
    evaluations: usize,
    restarts: u64,
}

impl<P: Population> Polished<P> {
    pub(super) fn new(space: Space, population: P, settings: Settings) -> Self {
        let kept = (settings.budget as f64 * POLISH_SHARE) as usize;
        Self {
            space,
            population,
            poll: None,
            early_stop: settings.early_stop,
            polish_from: settings.budget - kept,
            evaluations: 0,
            restarts: 0,
        }
    }

    fn is_population_done(&self) -> bool {
        let reserved = !self.early_stop && self.restarts == 0 && self.evaluations >= self.polish_from;
        reserved || self.population.is_spent()
    }
}

impl<P: Population> Optimizer for Polished<P> {
    fn ask(&mut self) -> Vec<Candidate> {
        if self.poll.is_none() && self.is_population_done() {
            self.poll = self.population.best().map(|best| Poll::new(best.clone(), POLISH_STEP));
        }
        if let Some(poll) = &self.poll {
            let batch = poll.ask(&self.space);
            if !batch.is_empty() || self.early_stop {
                return batch;
            }
            self.poll = None;
            self.restarts += 1;
            self.population.restart(self.restarts);
        }
        self.population.ask()
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.evaluations += trials.len();
        match &mut self.poll {
            Some(poll) => poll.tell(trials),
            None => self.population.tell(trials),
        }
    }
}

/// Members of a population where the published number would leave fewer than ten generations.
pub(super) fn members(published: usize, settings: Settings) -> usize {
    if settings.early_stop { published } else { (settings.budget / 10).clamp(8.min(published), published) }
}
