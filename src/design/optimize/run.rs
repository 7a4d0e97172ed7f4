//! A running search for mounts: budgets of evaluations and rays, the state file, the time of the objective.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::busy::Busy;
use super::state_file::{self, StateError};
use super::{MountProblem, Refiner, Search, SearchError, StoppedBy};
use crate::design::objective::ExperimentError;

/// Time between two writings of the state file.
const SAVE_EVERY: Duration = Duration::from_secs(10);

/// How far a search is to go, and what is written meanwhile.
pub(crate) struct SearchRun<'a> {
    pub problem: &'a MountProblem,
    /// Takes note of the mounts that are scored.
    pub refiner: Option<&'a Refiner>,
    pub budget: usize,
    /// The search ends when so many rays are cast.
    pub max_rays: Option<u64>,
    /// The state file and the question that it answers.
    pub state: Option<(&'a Path, &'a Value)>,
    /// Set by the user to stop.
    pub stop: &'a AtomicBool,
}

/// How a search ended.
pub(crate) struct RunEnd {
    pub stopped_by: StoppedBy,
    pub wall_s: f64,
    /// Part of it during which the objective was at work.
    pub objective_s: f64,
}

/// Why a search ended too early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RunError {
    #[error(transparent)]
    Search(#[from] SearchError),
    #[error(transparent)]
    State(#[from] StateError),
}

impl SearchRun<'_> {
    /// Searches, and writes the state file now and then and at the end.
    ///
    /// # Errors
    /// The objective failed, or the state file cannot be written; the search itself then has its results.
    pub(crate) fn run(
        &self,
        search: &mut Search,
        mut progress: impl FnMut(&Search),
    ) -> Result<RunEnd, RunError> {
        let start = Instant::now();
        let mut saved = Instant::now();
        let mut save_error = None;
        let busy = Busy::default();
        let mut are_rays_spent = false;
        let stopped_by = search.run(
            self.budget,
            |values| {
                let measured = busy.during(|| self.problem.measure(values))?;
                if let Some(refiner) = self.refiner {
                    refiner.note(values, &measured);
                }
                Ok::<_, ExperimentError>(measured)
            },
            |search| {
                let are_spent = self.max_rays.is_some_and(|most| search.rays() >= most);
                if are_spent && !self.stop.swap(true, Ordering::Relaxed) {
                    are_rays_spent = true;
                }
                progress(search);
                if let Some((path, question)) = self.state
                    && save_error.is_none()
                    && saved.elapsed() > SAVE_EVERY
                {
                    save_error = state_file::write(path, question, search).err();
                    saved = Instant::now();
                }
            },
            self.stop,
        )?;
        let wall_s = start.elapsed().as_secs_f64();
        if are_rays_spent {
            // by itself, not by the user: what follows is not to end
            self.stop.store(false, Ordering::Relaxed);
        }
        if let Some((path, question)) = self.state {
            save_error.map_or_else(|| state_file::write(path, question, search), Err)?;
        }
        let stopped_by = match stopped_by {
            StoppedBy::Interrupted if are_rays_spent => StoppedBy::Rays,
            other => other,
        };
        Ok(RunEnd { stopped_by, wall_s, objective_s: busy.seconds() })
    }
}
