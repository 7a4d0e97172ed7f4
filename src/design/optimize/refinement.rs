//! A search under a cheap model, and its best mounts under ever finer ones until one is left.

use std::sync::{Mutex, PoisonError};

use serde::Serialize;

use super::{Measured, MountProblem};
use crate::base::numbers::{count, number};
use crate::design::fidelity::{BoxLadder, Judged, Ladder as _, Rules, Stopped, rank};
use crate::design::objective::ExperimentError;
use crate::design::objective::Objective;

/// Level of the ladder for the search: the published number of azimuths at four poses per metre with phases that
/// differ, which orders mounts far better than the published pattern does.
const SEARCH_LEVEL: usize = 2;
/// Scores this far below the best, as a share of it, may still be the best under a finer model.
const WORTH_REFINING: f64 = 0.02;
/// And so many mounts are scored again.
const MAX_MOUNTS: usize = 200;
/// Rays that each of them may cost on the mean, in evaluations of the search.
const EVALUATIONS_EACH: f64 = 4.0;

/// The best mounts of a search under ever finer models.
#[derive(Serialize)]
pub(crate) struct Refinement {
    /// Where the mount was found, in units of the search.
    #[serde(skip)]
    pub values: Vec<f64>,
    /// J under the finest sampling.
    #[serde(flatten)]
    judged: Judged,
    /// The finest level at which it was looked at.
    level_name: String,
    /// The search's own favourite, judged likewise.
    favourite: Judged,
    /// Mounts that were looked at again, and those that may be as good.
    looked_at: usize,
    undecided: usize,
    /// J that may be lost by the choice.
    regret_bound: f64,
    /// Share of J that was allowed to be.
    regret_asked: f64,
    stopped: Stopped,
    /// Rays beyond those of the search.
    rays: u64,
}

/// An objective at every fineness, and the best mounts that a search by a cheap one scored.
pub(crate) struct Refiner {
    ladder: BoxLadder,
    /// Scores and mounts, in no order.
    seen: Mutex<Vec<(f64, Vec<f64>)>>,
}

impl Refiner {
    /// `given` is the experiment as asked for.
    ///
    /// # Errors
    /// Those of [`BoxLadder::new`].
    pub(crate) fn new(given: &Objective) -> Result<Self, ExperimentError> {
        Ok(Self { ladder: BoxLadder::new(given)?, seen: Mutex::default() })
    }

    /// The objective to search with.
    pub(crate) fn objective(&self) -> &Objective {
        self.ladder.objective(SEARCH_LEVEL)
    }

    /// Takes note of a mount that was scored, if it is allowed.
    pub(crate) fn note(&self, values: &[f64], measured: &Measured) {
        if measured.violation <= 0.0 {
            let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
            seen.push((measured.score, values.to_vec()));
            if seen.len() >= 8 * MAX_MOUNTS {
                keep_best(&mut seen);
            }
        }
    }

    /// Scores the search's best again; none where no mount was feasible.
    ///
    /// # Errors
    /// Those of the objective.
    pub(crate) fn refine(
        self,
        problem: &MountProblem,
        regret: f64,
    ) -> Result<Option<Refinement>, ExperimentError> {
        let Self { ladder, seen } = self;
        let mut seen = seen.into_inner().unwrap_or_else(PoisonError::into_inner);
        keep_best(&mut seen);
        let min_score = seen.first().map_or(0.0, |best| best.0 - WORTH_REFINING * best.0.abs());
        seen.retain(|(score, _)| *score >= min_score);
        let objective = ladder.objective(SEARCH_LEVEL);
        let candidates: Vec<_> =
            seen.iter().map(|(_, values)| objective.rig(&problem.masters(values))).collect();
        let Some(first) = candidates.first() else { return Ok(None) };
        let rules = Rules {
            tolerance: regret,
            rays_per_candidate: EVALUATIONS_EACH * ladder.rays(SEARCH_LEVEL, first) as f64,
        };
        let Some(ranking) = rank(&ladder, &candidates, &rules)? else { return Ok(None) };
        let judged = ranking.judged[ranking.best];
        Ok(Some(Refinement {
            values: seen[ranking.best].1.clone(),
            judged,
            level_name: ladder.name(judged.level),
            favourite: ranking.judged[0],
            looked_at: candidates.len(),
            undecided: ranking.undecided.len(),
            regret_bound: ranking.regret_bound,
            regret_asked: regret,
            stopped: ranking.stopped,
            rays: ranking.rays,
        }))
    }
}

/// The best that are worth refining, each once, best first.
fn keep_best(seen: &mut Vec<(f64, Vec<f64>)>) {
    seen.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| compare(&a.1, &b.1)));
    seen.dedup_by(|a, b| a.1 == b.1);
    seen.truncate(MAX_MOUNTS);
}

fn compare(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.total_cmp(b))
        .find(|order| order.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

impl Refinement {
    pub(crate) fn verdicts(&self) -> [(&'static str, String); 2] {
        let judged = format!(
            "J {} ± {} ({}); {} mounts looked at again, {} may be as good, {} rays",
            number(self.judged.value, 0),
            number(self.judged.bound, 0),
            self.level_name,
            self.looked_at,
            self.undecided,
            count(self.rays)
        );
        let others = format!(
            "another might be {} better ({} % was allowed, {}); the search's own favourite has {}",
            number(self.regret_bound, 0),
            number(100.0 * self.regret_asked, 2),
            if self.regret_bound <= self.regret_asked * self.judged.value.abs() {
                "met"
            } else {
                "not met: rays or levels were used up"
            },
            number(self.favourite.value, 0),
        );
        [("converged", judged), ("", others)]
    }
}
