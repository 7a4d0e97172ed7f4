//! The best mounts of a search, judged again as they would be built.
//!
//! The highest of thousands of scores under one sampling is in part luck: a needle that neither a built rig nor a finer
//! sampling meets again. A few mounts that lie apart are therefore judged over mount errors in a model with free
//! phases, which orders mounts far better than the published pattern does.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde::Serialize;

use super::{MountProblem, Search};
use crate::base::numbers::{count, number};
use crate::design::fidelity::{BoxLadder, Ladder as _};
use crate::design::objective::Objective;
use crate::design::robustness::{Criterion, Robustness, RobustnessError, Spread, Tolerance};
use crate::rig::MountDeg;

/// Level of the ladder at which is judged: four poses per metre.
const LEVEL: usize = 2;
/// Draws of mount errors for the best ones.
const DRAWS: usize = 16;
/// Of the draws, apart from those that a robust search reckons with.
const SEED: u64 = 2;

/// What came of it.
#[derive(Clone, Debug, Serialize)]
pub struct FinalLook {
    /// Which of the mounts is best as built; the first is the search's own favourite.
    pub best: usize,
    /// The model in which mounts were judged.
    pub model: String,
    /// Mount errors that were reckoned with.
    pub tolerance: Tolerance,
    /// Mounts that were judged.
    pub looked_at: usize,
    /// J of the chosen one as built.
    pub chosen: Spread,
    /// J of the search's own favourite as built.
    pub favourite: Spread,
    /// Evaluations beyond those of the search.
    pub evaluations: usize,
    /// Rays of them.
    pub rays: u64,
}

impl FinalLook {
    /// Judges masters, the search's own favourite first, that were found in this objective's experiment. Phases are left
    /// to chance, whatever the tolerance says. None without mounts, and where `stop` came before all were judged.
    ///
    /// # Errors
    /// Those of [`Robustness::new`] and of the objective.
    pub(crate) fn at(
        objective: &Objective,
        mounts: &[Vec<MountDeg>],
        tolerance: Tolerance,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, RobustnessError> {
        let candidates: Vec<_> = mounts.iter().map(|masters| objective.rig(masters)).collect();
        let ladder = BoxLadder::new(objective)?;
        let tolerance = Tolerance { free_phase: true, ..tolerance };
        let robustness = Robustness::new(ladder.objective(LEVEL), tolerance, DRAWS, SEED)?;
        Ok(robustness.choose(&candidates, Criterion::Expected, stop)?.map(|choice| Self {
            best: choice.best,
            model: ladder.name(LEVEL),
            tolerance,
            looked_at: candidates.len(),
            chosen: choice.chosen,
            favourite: choice.favourite,
            evaluations: choice.evaluations,
            rays: choice.rays,
        }))
    }
}

/// The shortlist of a search, judged as it would be built.
#[derive(Serialize)]
pub(crate) struct JudgedShortlist {
    /// Where the chosen mount was found, in units of the search.
    #[serde(skip)]
    pub values: Vec<f64>,
    #[serde(flatten)]
    look: FinalLook,
    /// J of the search's own favourite as searched.
    favourite_as_searched: f64,
    wall_s: f64,
}

impl JudgedShortlist {
    /// None where no mount was feasible, or `stop` came.
    ///
    /// # Errors
    /// Those of [`FinalLook::at`].
    pub(crate) fn of_search(
        given: &Objective,
        problem: &MountProblem,
        search: &Search,
        tolerance: Tolerance,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, RobustnessError> {
        let start = Instant::now();
        let feasible: Vec<_> = search.shortlist().iter().filter(|trial| trial.violation == 0.0).collect();
        let mounts: Vec<_> = feasible.iter().map(|trial| problem.masters(&trial.candidate.values)).collect();
        Ok(FinalLook::at(given, &mounts, tolerance, stop)?.map(|look| Self {
            values: feasible[look.best].candidate.values.clone(),
            look,
            favourite_as_searched: feasible[0].score,
            wall_s: start.elapsed().as_secs_f64(),
        }))
    }

    pub(crate) fn verdicts(&self) -> [(&'static str, String); 2] {
        let FinalLook { model, tolerance, looked_at, chosen, favourite, rays, .. } = &self.look;
        let as_built = format!(
            "J {} on average with errors of {} m and {} degrees ({model}, phases free)",
            number(chosen.mean, 0),
            tolerance.position_m,
            tolerance.angle_deg
        );
        let others = format!(
            "the search's own favourite, {} as searched, comes to {}; {looked_at} mounts looked at again, {} rays in {:.3} s",
            number(self.favourite_as_searched, 0),
            number(favourite.mean, 0),
            count(*rays),
            self.wall_s
        );
        [("as built", as_built), ("", others)]
    }
}
