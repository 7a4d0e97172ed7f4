//! A population method followed by a local search, as the published runs do (theirs is pattern search).

use serde::{Deserialize, Serialize};

use super::lines::{Lines, TYPICAL_LENGTH};
use super::pattern::Poll;
use super::{Candidate, Optimizer, Settings, Space, Trial, generator};

/// Mesh of the closing pattern search at its start, as a share of each variable's range.
const POLISH_STEP: f64 = 0.02;
/// Share of the budget reserved for local searches where the published rule does not end the population.
const LOCAL_SHARE: f64 = 0.5;
/// From so many evaluations on a search is long: its population finds its hills early.
const LONG: usize = 1000;
/// Evaluations that a local search after the first gets.
const LOCAL_AGAIN: usize = 100;
/// Trials remembered as starts of local searches.
const REMEMBERED: usize = 400;
/// Step of the generator that local searches draw from, apart from every generation's.
const LOCAL_STREAM: u64 = 1 << 63;

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

/// A population method, then a local search: stopped by the published rule, pattern search from the best point and the end;
/// otherwise [`Lines`] from the population's best points until the budget is spent, then the population again.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Polished<P> {
    space: Space,
    population: P,
    seed: u64,
    early_stop: bool,
    budget: usize,
    local_share: f64,
    evaluations: usize,
    restarts: u64,
    step: u64,
    poll: Option<Poll>,
    lines: Option<Lines>,
    /// The best trials of the population so far, best first.
    remembered: Vec<Trial>,
}

impl<P: Population> Polished<P> {
    pub(super) fn new(space: Space, population: P, settings: Settings, local_share: f64) -> Self {
        Self {
            space,
            population,
            seed: settings.seed,
            early_stop: settings.early_stop,
            budget: settings.budget,
            local_share,
            evaluations: 0,
            restarts: 0,
            step: 0,
            poll: None,
            lines: None,
            remembered: Vec::new(),
        }
    }

    fn ask_published(&mut self) -> Vec<Candidate> {
        if self.poll.is_none() && self.population.is_spent() {
            self.poll = self.population.best().map(|best| Poll::new(best.clone(), POLISH_STEP));
        }
        match &self.poll {
            Some(poll) => poll.ask(&self.space),
            None => self.population.ask(),
        }
    }

    fn is_local_due(&self) -> bool {
        let populations = self.budget as f64 * (1.0 - self.local_share);
        let reserved = self.restarts == 0 && self.evaluations as f64 >= populations;
        !self.remembered.is_empty() && (reserved || self.population.is_spent())
    }

    fn remember(&mut self, trials: &[Trial]) {
        self.remembered.extend_from_slice(trials);
        self.remembered.sort_by(Trial::order);
        self.remembered.truncate(REMEMBERED);
    }
}

impl<P: Population> Optimizer for Polished<P> {
    fn ask(&mut self) -> Vec<Candidate> {
        if self.early_stop {
            return self.ask_published();
        }
        if self.lines.is_none() && self.is_local_due() {
            let ranked: Vec<&Trial> = self.remembered.iter().collect();
            let left = self.budget.saturating_sub(self.evaluations).max(LOCAL_AGAIN);
            self.lines =
                Some(Lines::begin(&self.space, &ranked, &vec![TYPICAL_LENGTH; self.space.len()], left));
        }
        match &mut self.lines {
            Some(lines) if !lines.is_spent() => {
                self.step += 1;
                return lines.ask(&self.space, &mut generator(self.seed, LOCAL_STREAM | self.step));
            }
            Some(_) => {
                self.lines = None;
                self.remembered.clear();
                self.restarts += 1;
                self.population.restart(self.restarts);
            }
            None => (),
        }
        self.population.ask()
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.evaluations += trials.len();
        match (&mut self.poll, &mut self.lines) {
            (Some(poll), _) => poll.tell(trials),
            (None, Some(lines)) => lines.tell(trials),
            (None, None) => {
                self.population.tell(trials);
                if !self.early_stop {
                    self.remember(trials);
                }
            }
        }
    }
}

/// Whether a search that does not end by the published rule is long.
pub(super) fn is_long(settings: Settings) -> bool {
    settings.budget >= LONG && !settings.early_stop
}

/// Share of the budget reserved for local searches, where a method has one of its own for long searches.
pub(super) fn local_share(settings: Settings, when_long: f64) -> f64 {
    if is_long(settings) { when_long } else { LOCAL_SHARE }
}

/// Members of a population where the published number would leave fewer than ten generations.
pub(super) fn members(published: usize, settings: Settings) -> usize {
    if settings.early_stop { published } else { (settings.budget / 10).clamp(8.min(published), published) }
}

/// Points of the first generation: breeding a handful finds less than chance does, so a third of a small budget looks
/// around.
pub(super) fn first_members(published: usize, settings: Settings) -> usize {
    let size = members(published, settings);
    if settings.early_stop { size } else { (settings.budget / 3).clamp(size, published) }
}
