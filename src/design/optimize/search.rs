//! The loop around a method: budget, parallel evaluation, history, best point, stop and resume.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::shortlist::Shortlist;
use super::{Candidate, Kind, Method, Optimizer, Settings, Space, Trial};

/// Evaluations between two looks at the progress callback.
const CHUNK: usize = 16;

/// What the objective returns for one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Objective, maximised; finite.
    pub score: f64,
    /// How far from feasible, 0 when it is; finite, in units of the caller's constraint.
    pub violation: f64,
    /// Rays cast for it.
    pub rays: u64,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StoppedBy {
    /// All evaluations of the budget were used.
    Budget,
    /// The method's own stopping rule.
    Converged,
    /// The stop flag.
    Interrupted,
    /// All rays of the budget were cast; the stop flag was set for that.
    Rays,
}

/// Why a search cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum SearchError {
    /// A NaN or an infinity came back.
    #[error("the objective is {score} (violation {violation}) at {point}: a finite number was expected")]
    NotFinite {
        /// What came back.
        score: f64,
        /// The violation that came with it.
        violation: f64,
        /// The point, variable by variable.
        point: String,
    },
    /// The objective itself failed.
    #[error("the objective failed at {point}: {message}")]
    Objective {
        /// The point, variable by variable.
        point: String,
        /// Its error message.
        message: String,
    },
}

/// A running search: all of its state, as plain data.
///
/// ```
/// use outrigger::design::optimize::{Kind, Measured, Search, Settings, Space, Variable};
/// use std::sync::atomic::AtomicBool;
///
/// let pitch = Variable {
///     name: "pitch_deg".into(), low: -60.0, high: 60.0, integer: false, active_from: None, role: 0,
/// };
/// let mut search = Search::new(Space::new(vec![pitch])?, Kind::Bayesian, Settings::new(1, 30));
/// let score = |values: &[f64]| Ok::<_, String>(Measured { score: -(values[0] - 25.0).powi(2), violation: 0.0, rays: 0 });
/// search.run(15, score, |_| (), &AtomicBool::new(false))?;
///
/// // saved and loaded again, it goes on as if nothing had happened
/// let mut resumed: Search = serde_json::from_str(&serde_json::to_string(&search)?)?;
/// for search in [&mut search, &mut resumed] {
///     search.run(30, score, |_| (), &AtomicBool::new(false))?;
/// }
/// assert_eq!(search.best(), resumed.best());
/// assert!((search.best().unwrap().candidate.values[0] - 25.0).abs() < 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Search {
    space: Space,
    kind: Kind,
    settings: Settings,
    method: Method,
    /// Asked, not evaluated.
    pending: VecDeque<Candidate>,
    /// Evaluated, not yet passed to the method.
    evaluated: Vec<Trial>,
    evaluations: usize,
    rays: u64,
    best: Option<Trial>,
    best_at: usize,
    shortlist: Shortlist,
    /// Best feasible score after each evaluation.
    best_scores: Vec<Option<f64>>,
}

impl Search {
    /// Nothing evaluated yet.
    pub fn new(space: Space, kind: Kind, settings: Settings) -> Self {
        Self {
            method: kind.start(space.clone(), settings),
            space,
            kind,
            settings,
            pending: VecDeque::new(),
            evaluated: Vec::new(),
            evaluations: 0,
            rays: 0,
            best: None,
            best_at: 0,
            shortlist: Shortlist::default(),
            best_scores: Vec::new(),
        }
    }

    /// Goes on until `budget` evaluations are done in all, the method has converged, or `stop` is set.
    ///
    /// `objective` is called from several threads; results do not depend on how many. `progress` is called between
    /// chunks. After an interruption the state is whole: a later call goes on as if nothing had happened.
    ///
    /// # Errors
    /// The objective failed or was not finite; the state then stands before that evaluation.
    pub fn run<E: std::fmt::Display>(
        &mut self,
        budget: usize,
        objective: impl Fn(&[f64]) -> Result<Measured, E> + Sync,
        mut progress: impl FnMut(&Search),
        stop: &AtomicBool,
    ) -> Result<StoppedBy, SearchError> {
        while self.evaluations < budget {
            if stop.load(Ordering::Relaxed) {
                return Ok(StoppedBy::Interrupted);
            }
            if self.pending.is_empty() {
                if !self.evaluated.is_empty() {
                    self.method.tell(&std::mem::take(&mut self.evaluated));
                }
                self.pending.extend(self.method.ask());
                if self.pending.is_empty() {
                    return Ok(StoppedBy::Converged);
                }
            }
            let count = self.pending.len().min(budget - self.evaluations).min(CHUNK);
            let measured: Vec<Option<Result<Measured, SearchError>>> = {
                let chunk: Vec<&Candidate> = self.pending.iter().take(count).collect();
                let one = |candidate: &&Candidate| {
                    (!stop.load(Ordering::Relaxed)).then(|| self.measure(&candidate.values, &objective))
                };
                if count == 1 { chunk.iter().map(one).collect() } else { chunk.par_iter().map(one).collect() }
            };
            for result in measured {
                let Some(result) = result else { return Ok(StoppedBy::Interrupted) };
                self.record(result?);
            }
            progress(self);
        }
        Ok(StoppedBy::Budget)
    }

    /// Whether state that was read back hangs together; the methods trust it after that.
    ///
    /// # Errors
    /// What does not.
    pub fn check(&self) -> Result<(), String> {
        let dimensions = self.space.len();
        let candidates = self.pending.iter().chain(self.evaluated.iter().map(|trial| &trial.candidate));
        let candidates = candidates.chain(self.shortlist().iter().map(|trial| &trial.candidate));
        if candidates
            .chain(self.best.iter().map(|trial| &trial.candidate))
            .any(|c| c.values.len() != dimensions)
        {
            return Err(format!("a point has not the {dimensions} values of the space"));
        }
        if self.best_scores.len() != self.evaluations || self.best_at > self.evaluations {
            return Err(format!(
                "{} evaluations, but {} in the history",
                self.evaluations,
                self.best_scores.len()
            ));
        }
        Ok(())
    }

    /// The best trial so far, feasible or not.
    pub fn best(&self) -> Option<&Trial> {
        self.best.as_ref()
    }

    /// The best trials so far that are not each other's neighbours, best first; not all of them need be feasible.
    pub(crate) fn shortlist(&self) -> &[Trial] {
        self.shortlist.trials()
    }

    /// Which evaluation found it, counted from 1; 0 before the first.
    pub fn best_at(&self) -> usize {
        self.best_at
    }

    /// Evaluations done.
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }

    /// Rays cast by them.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// After each evaluation (counted from 1) the best feasible score so far; `None` while there is none.
    pub fn history(&self) -> impl ExactSizeIterator<Item = (usize, Option<f64>)> + '_ {
        self.best_scores.iter().enumerate().map(|(index, score)| (index + 1, *score))
    }

    /// Which method.
    pub(crate) fn kind(&self) -> Kind {
        self.kind
    }

    /// The settings of the method.
    pub(crate) fn settings(&self) -> Settings {
        self.settings
    }

    /// What is searched.
    pub(crate) fn space(&self) -> &Space {
        &self.space
    }

    fn measure<E: std::fmt::Display>(
        &self,
        values: &[f64],
        objective: impl Fn(&[f64]) -> Result<Measured, E>,
    ) -> Result<Measured, SearchError> {
        let measured = objective(values).map_err(|error| SearchError::Objective {
            point: self.describe(values),
            message: error.to_string(),
        })?;
        let Measured { score, violation, .. } = measured;
        if score.is_finite() && violation.is_finite() && violation >= 0.0 {
            Ok(measured)
        } else {
            Err(SearchError::NotFinite { score, violation, point: self.describe(values) })
        }
    }

    fn record(&mut self, measured: Measured) {
        let Some(candidate) = self.pending.pop_front() else { return };
        self.evaluations += 1;
        self.rays += measured.rays;
        let trial = Trial { candidate, score: measured.score, violation: measured.violation };
        if self.best.as_ref().is_none_or(|best| trial.beats(best)) {
            self.best = Some(trial.clone());
            self.best_at = self.evaluations;
        }
        self.shortlist.note(&self.space, &trial);
        self.best_scores.push(self.best.as_ref().filter(|best| best.violation == 0.0).map(|best| best.score));
        self.evaluated.push(trial);
    }

    fn describe(&self, values: &[f64]) -> String {
        let named = self.space.variables().iter().zip(values).enumerate();
        let active = named.filter(|(index, _)| self.space.is_active(values, *index));
        active
            .map(|(_, (variable, value))| format!("{} = {value}", variable.name))
            .collect::<Vec<_>>()
            .join(", ")
    }
}
