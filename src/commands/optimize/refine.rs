//! A search under a cheap model, and its best mounts under ever finer ones until one is left.

use std::sync::Mutex;

use anyhow::bail;
use serde::Serialize;

use super::Args;
use crate::chart;
use crate::commands::evaluate::FidelityArg;
use crate::fidelity::{BoxLadder, Judged, Ladder as _, Rules, Stopped, rank};
use crate::objective::Objective;
use crate::optimize::{Measured, MountProblem};

/// Level of the ladder at which is searched: the published number of azimuths at four poses per metre whose phases
/// differ, which orders mounts far better than the published pattern does.
const SEARCH_LEVEL: usize = 2;
/// Scores this far below the best, as a share of it, may still be the best under a finer model.
const WORTH_A_LOOK: f64 = 0.02;
/// And so many mounts are looked at.
const MOST_MOUNTS: usize = 200;
/// Rays that each of them may cost on the mean, in evaluations of the search.
const EVALUATIONS_EACH: f64 = 4.0;

/// What came of looking again.
#[derive(Serialize)]
pub(super) struct Refined {
    /// Where the mount was found, in units of the search.
    #[serde(skip)]
    pub values: Vec<f64>,
    /// J without end refined.
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

/// Every feasible mount that a search looked at.
#[derive(Default)]
pub(super) struct Seen(Mutex<Vec<(f64, Vec<f64>)>>);

impl Seen {
    pub fn note(&self, values: &[f64], measured: &Measured) {
        if measured.violation <= 0.0 {
            self.0
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner)
                .push((measured.score, values.to_vec()));
        }
    }

    /// The best, each once, best first.
    fn best(self) -> Vec<Vec<f64>> {
        let mut all = self.0.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        all.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| compare(&a.1, &b.1)));
        all.dedup_by(|a, b| a.1 == b.1);
        let least = all.first().map_or(0.0, |best| best.0 - WORTH_A_LOOK * best.0.abs());
        all.into_iter()
            .take_while(|(score, _)| *score >= least)
            .take(MOST_MOUNTS)
            .map(|(_, values)| values)
            .collect()
    }
}

fn compare(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.total_cmp(b))
        .find(|order| order.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

/// The objective to search with.
pub(super) fn objective(args: &Args, given: Objective) -> anyhow::Result<Objective> {
    if args.fidelity == FidelityArg::Given {
        return Ok(given);
    }
    if args.robust.is_some() {
        bail!("--robust judges by draws of its own: leave out --fidelity auto");
    }
    if args.certify.is_some() {
        bail!("--certify proves something about one sampling: leave out --fidelity auto");
    }
    Ok(BoxLadder::new(&given)?.objective(SEARCH_LEVEL).clone())
}

/// Looks again at what a search liked; nothing where no mount was feasible. `given` is the experiment as asked for.
pub(super) fn refine(
    given: &Objective,
    problem: &MountProblem,
    seen: Seen,
    regret: f64,
) -> anyhow::Result<Option<Refined>> {
    let values = seen.best();
    let experiment = given.simulator().experiment();
    let candidates: Vec<_> =
        values.iter().map(|values| experiment.sensors(&problem.masters(values))).collect();
    let Some(first) = candidates.first() else { return Ok(None) };
    let ladder = BoxLadder::new(given)?;
    let rules = Rules {
        tolerance: regret,
        rays_per_candidate: EVALUATIONS_EACH * ladder.rays(SEARCH_LEVEL, first) as f64,
    };
    let Some(ranking) = rank(&ladder, &candidates, &rules)? else { return Ok(None) };
    let judged = ranking.judged[ranking.best];
    Ok(Some(Refined {
        values: values[ranking.best].clone(),
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

impl Refined {
    pub fn lines(&self) -> String {
        format!(
            "converged      J {} +- {} ({}); {} mounts looked at again, {} may be as good, {} rays\n\
             \x20              another might be {} better ({} % was allowed, {}); the search's own favourite has {}\n",
            chart::number(self.judged.value, 0),
            chart::number(self.judged.bound, 0),
            self.level_name,
            self.looked_at,
            self.undecided,
            chart::number(self.rays as f64, 0),
            chart::number(self.regret_bound, 0),
            chart::number(100.0 * self.regret_asked, 2),
            if self.regret_bound <= self.regret_asked * self.judged.value.abs() {
                "kept"
            } else {
                "not kept: rays or levels were used up"
            },
            chart::number(self.favourite.value, 0),
        )
    }
}
