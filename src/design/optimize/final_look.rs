//! The best mounts of a search, judged again as they would be built.
//!
//! The highest of thousands of scores under one sampling is in part luck: a needle that neither a built rig nor a finer
//! sampling meets again. A few mounts that lie apart are therefore judged over mount errors in a model whose phases are
//! free, which orders mounts far better than the published pattern does.

use std::sync::atomic::AtomicBool;

use serde::Serialize;

use crate::design::fidelity::{BoxLadder, Ladder as _};
use crate::design::objective::Objective;
use crate::design::robustness::{Criterion, Robustness, RobustnessError, Spread, Tolerance};
use crate::simulate::published::Placement;

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
    pub fn at(
        objective: &Objective,
        mounts: &[Vec<Placement>],
        tolerance: Tolerance,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, RobustnessError> {
        let experiment = objective.simulator().experiment();
        let candidates: Vec<_> = mounts.iter().map(|masters| experiment.sensors(masters)).collect();
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
