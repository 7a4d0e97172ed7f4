//! One search in a published experiment, as rows of several studies need it.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::rows::{Row, row_of};
use super::{StudyError, rows};
use crate::design::objective::{Objective, Weights};
use crate::design::optimize::{KeepApart, Kind, MountProblem, MountSearch, Search, Settings};
use crate::rig::{MountDeg, Path, Phase, Roll};

/// Price of an angle of 0 where a least one is asked for: above all voxels there are.
const DEAR: f64 = 1e6;

/// A search as data: what a task says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchTask {
    /// Part of the study it belongs to.
    pub part: String,
    pub preset: String,
    /// `lateral` or `forward`.
    pub path: String,
    /// Roll of every master, degrees; free when none.
    pub roll_deg: Option<f64>,
    /// Price of a sensor.
    pub lambda: f64,
    /// Min and max number of masters.
    pub masters: [u32; 2],
    /// Whether each has a mirror image.
    pub mirror: bool,
    /// Least angle between spin axes that counts, so dear that coverage cannot pay for less; as published when none.
    pub least_angle_deg: Option<f64>,
    pub method: Kind,
    pub evaluations: usize,
    /// Stop as published.
    pub as_published: bool,
    pub seed: u64,
}

/// What a search found.
pub struct Found {
    pub objective: Objective,
    /// The masters it ended with.
    pub masters: Vec<MountDeg>,
    /// The best masters that lie apart, best first.
    pub shortlist: Vec<Vec<MountDeg>>,
    /// The row: the task's fields, the evaluation's, history and times.
    pub row: Row,
}

/// An objective with so many columns and poses per metre, and a free phase.
pub(super) fn sampled(
    objective: &Objective,
    (azimuths, sub_poses): (usize, usize),
) -> Result<Objective, StudyError> {
    let sampled = objective.changed(|experiment| {
        (experiment.azimuths, experiment.sub_poses, experiment.phase) = (azimuths, sub_poses, Phase::Free);
    });
    sampled.map_err(StudyError::of)
}

impl SearchTask {
    /// The published setting: path lateral, roll 0, lambda 2000, 1 to 5 masters.
    pub(crate) fn published(part: &str, preset: &str, method: Kind, seed: u64) -> Self {
        Self {
            part: part.into(),
            preset: preset.into(),
            path: "lateral".into(),
            roll_deg: Some(0.0),
            lambda: Weights::default().sensor_cost,
            masters: [1, 5],
            mirror: true,
            least_angle_deg: None,
            method,
            evaluations: method.published_budget(),
            as_published: true,
            seed,
        }
    }

    /// The objective that is searched.
    pub(crate) fn objective(&self) -> Result<Objective, StudyError> {
        let path = match self.path.as_str() {
            "lateral" => Path::Lateral,
            "forward" => Path::Forward,
            other => return Err(StudyError(format!("path {other:?}: lateral or forward was expected"))),
        };
        let published = Objective::published(&self.preset, |experiment| {
            experiment.path = path;
            experiment.roll = self.roll_deg.map_or(Roll::Free, Roll::Fixed);
            experiment.mirror = self.mirror;
        });
        let mut weights = Weights { sensor_cost: self.lambda, ..Weights::default() };
        if let Some(angle_deg) = self.least_angle_deg {
            // an angle of nothing always stays
            (weights.angle_min_deg, weights.angle_penalty) = (angle_deg, DEAR);
        }
        Ok(published.map_err(StudyError::of)?.with_weights(weights))
    }

    /// Searches.
    pub(crate) fn run(&self) -> Result<Found, StudyError> {
        let objective = self.objective()?;
        let [masters_min, masters_max] = self.masters;
        let search = MountSearch { masters_min, ..MountSearch::of(&objective, masters_max) };
        let problem = MountProblem::with_search(objective.clone(), search, KeepApart::None);
        let settings =
            Settings { early_stop: self.as_published, ..Settings::new(self.seed, self.evaluations) };
        let mut search = Search::new(problem.space().map_err(StudyError::of)?, self.method, settings);
        let objective_ns = AtomicU64::new(0);
        let start = Instant::now();
        let measure = |values: &[f64]| {
            let start = Instant::now();
            let measured = problem.measure(values);
            objective_ns.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
            measured
        };
        // the rows of a study are many: one thread each
        search.run(self.evaluations, measure, |_| (), &AtomicBool::new(false)).map_err(StudyError::of)?;
        let wall_s = start.elapsed().as_secs_f64();
        let best = search.best().ok_or_else(|| StudyError("a search without an evaluation".into()))?;
        let masters = problem.masters(&best.candidate.values);
        let evaluation = objective.evaluate(&masters).map_err(StudyError::of)?;
        let mut row = rows::row_of(self);
        row.insert("used_evaluations".into(), json!(search.evaluations()));
        row.insert("rays".into(), json!(search.rays()));
        row.insert("best_at".into(), json!(search.best_at()));
        row.insert("j".into(), json!(evaluation.objective));
        row.insert("unique_voxels".into(), json!(evaluation.unique_voxels));
        row.insert("overlap_ratio".into(), json!(evaluation.overlap_ratio));
        row.insert("min_angle_deg".into(), json!(evaluation.min_angle_deg));
        row.insert("sensors".into(), json!(evaluation.sensors));
        row.insert("mounts".into(), json!(masters.iter().map(|m| <[f64; 5]>::from(*m)).collect::<Vec<_>>()));
        row.insert("history".into(), json!(improvements(&search)));
        row.insert("wall_s".into(), json!(wall_s));
        row.insert("wall_objective_s".into(), json!(objective_ns.into_inner() as f64 * 1e-9));
        let shortlist =
            search.shortlist().iter().map(|trial| problem.masters(&trial.candidate.values)).collect();
        Ok(Found { objective, masters, shortlist, row })
    }
}

/// The evaluations that found something better, with what they found.
fn improvements(search: &Search) -> Vec<(usize, f64)> {
    let last = Cell::new(f64::NEG_INFINITY);
    search
        .history()
        .filter_map(|(evaluation, best)| best.map(|best| (evaluation, best)))
        .filter(|(_, best)| *best > last.replace(last.get().max(*best)))
        .collect()
}

/// The best J after so many evaluations of a row's history.
pub(crate) fn best_after(row: &Row, evaluations: f64) -> Option<f64> {
    let history = row.get("history")?.as_array()?;
    let steps = history.iter().filter_map(|step| Some((step.get(0)?.as_f64()?, step.get(1)?.as_f64()?)));
    steps.take_while(|(evaluation, _)| *evaluation <= evaluations).last().map(|(_, best)| best)
}

/// Tasks as plain data.
pub(crate) fn values(tasks: &[SearchTask]) -> Vec<serde_json::Value> {
    tasks.iter().map(|task| serde_json::Value::Object(row_of(task))).collect()
}

/// A task of a search from plain data.
pub(crate) fn task(value: &serde_json::Value) -> Result<SearchTask, StudyError> {
    serde_json::from_value(value.clone())
        .map_err(|error| StudyError(format!("the task is no search: {error}")))
}
