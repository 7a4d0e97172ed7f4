//! Cost and error of each method to compute coverage.
//!
//! Every model scores the same mounts; all are measured against one that is converged as far as counts. Mounts come in
//! two lists: some at random, for errors, rank correlation and regret, and a line of pitches, for the error of the best.

mod cases;
mod decoders;
mod instructions;
mod measures;
mod models;
mod ranges;
mod score;
mod optimizers;
mod truth;

use serde_json::{Value, json};

use self::cases::{CASES, Case};
use self::measures::{Measures, charts, claims, table};
use self::models::{Model, models};
use self::truth::Truth;
use super::rows::{Row, row_of, text};
use super::{Findings, Size, Study, StudyError};

/// See the module.
#[derive(Debug)]
pub struct SpeedAccuracy;

/// One model in one case: what a task says.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
struct Task {
    case: String,
    model: String,
    scene: Option<std::path::PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trajectory: Option<std::path::PathBuf>,
    quick: bool,
    /// So many mounts of the line alone: what instructions are counted of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mounts: Option<usize>,
}

impl Task {
    fn new(case: &Case, model: &Model, size: &Size) -> Self {
        Self {
            case: case.name.into(),
            model: model.name(),
            scene: size.scene.clone().filter(|_| case.needs_scene()),
            trajectory: size.trajectory.clone().filter(|_| case.needs_scene()),
            quick: size.quick,
            mounts: None,
        }
    }

    /// The line of pitches, degrees.
    fn pitches_deg(&self) -> Vec<f64> {
        let all: Vec<f64> = (0..=90).step_by(if self.quick { 9 } else { 1 }).map(f64::from).collect();
        match self.mounts {
            Some(count) => (0..count).map(|n| all[n * (all.len() - 1) / (count - 1).max(1)]).collect(),
            None => all,
        }
    }

    /// Mounts at random, off the line.
    fn random(&self) -> usize {
        match (self.mounts, self.quick) {
            (Some(_), _) => 0,
            (None, true) => 12,
            (None, false) => 200,
        }
    }
}

impl Study for SpeedAccuracy {
    fn name(&self) -> &'static str {
        "speed-accuracy"
    }

    fn about(&self) -> &'static str {
        "What does each method to compute coverage cost, and what does it get wrong: the score, the order of mounts, the \
         mount that is chosen, the best pitch?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        if size.trajectory.is_some() && size.scene.is_none() {
            return Err(StudyError("a trajectory leads through a scene: give --scene MESH, too".into()));
        }
        let mut tasks = Vec::new();
        for case in CASES.iter().filter(|case| !case.needs_scene() || size.scene.is_some()) {
            for model in models(case, size.quick) {
                tasks.push(Value::Object(row_of(&Task::new(case, &model, size))));
            }
            if size.count_instructions {
                tasks.push(instructions::task(case, size));
            }
        }
        tasks.extend(decoders::tasks(size.quick));
        tasks.extend(optimizers::tasks(size.seeds, size.quick));
        Ok(tasks)
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        if decoders::is_mine(task) {
            return decoders::run(task);
        }
        if optimizers::is_mine(task) {
            return optimizers::run(task);
        }
        if instructions::is_mine(task) {
            return instructions::run(task);
        }
        let task: Task = serde_json::from_value(task.clone()).map_err(StudyError::of)?;
        let case = Case::named(&task.case)?;
        let model = models(case, task.quick).into_iter().find(|model| model.name() == task.model);
        let model: Model =
            model.ok_or_else(|| StudyError(format!("{} has no model {:?}", case.name, task.model)))?;
        let scored = case.score(&model, &task)?;
        let mut row = row_of(&task);
        for (name, value) in [
            ("rays_per_mount", json!(scored.rays_per_mount)),
            ("scores", json!(scored.scores)),
            ("bounds", json!(scored.bounds)),
            ("chosen", json!(scored.chosen)),
            ("chosen_pitch", json!(scored.chosen_pitch)),
            ("pitches_alike", json!(scored.pitches_alike)),
            ("pitch_scores", json!(scored.pitch_scores)),
            ("pitches_deg", json!(task.pitches_deg())),
            ("wall_ms_per_mount", json!(scored.wall_ms_per_mount)),
        ] {
            row.insert(name.into(), value);
        }
        Ok(vec![row])
    }

    fn rests_on_seeds(&self) -> bool {
        false
    }

    fn takes_a_scene(&self) -> bool {
        true
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut findings = Findings::default();
        for case in CASES {
            let here: Vec<&Row> = rows.iter().filter(|row| text(row, "case") == case.name).collect();
            let Some(truth) = Truth::of(&here) else { continue };
            let measures = Measures::of_all(&here, &truth);
            findings.figures.extend(charts(case, &measures));
            findings.tables.push(table(case, &measures, &truth));
            findings.claims.extend(claims(case, &measures, &truth));
        }
        let is_model = |row: &&Row| row.contains_key("model") && !instructions::is_of(row);
        let (models, cases) = (rows.iter().filter(is_model).count(), findings.tables.len());
        decoders::add_findings(rows, &mut findings);
        optimizers::add_findings(rows, &mut findings);
        let stand = findings.claims.iter().filter(|claim| claim.verdict == super::Verdict::Stands).count();
        findings.summary = format!(
            "{models} models in {cases} cases; adaptive fidelity keeps {stand} of {} promises.",
            findings.claims.len()
        );
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Verdict, number};

    #[test]
    fn a_case_is_run_and_read() {
        let size = Size { seeds: 1, quick: true, ..Size::default() };
        let tasks = SpeedAccuracy.tasks(&size).unwrap();
        let here = tasks.iter().filter(|task| task["case"] == "vlp-16-lateral");
        let rows: Vec<Row> = here.flat_map(|task| SpeedAccuracy.run(task).unwrap()).collect();
        assert_eq!(rows.len(), 5);
        let findings = SpeedAccuracy.findings(&rows);
        let [table] = &findings.tables[..] else { panic!("{:?}", findings.tables) };
        // the converged model is its own reference, the published one misses voxels
        assert_eq!(table.rows[0][2..6], ["-", "0.0", "0.0", "0.000"]);
        assert!(table.rows[1][3].starts_with("-3,"), "{:?}", table.rows[1]);
        let verdict =
            |words: &str| findings.claims.iter().find(|claim| claim.claim.contains(words)).unwrap().verdict;
        assert_eq!(verdict("loses less"), Verdict::Stands);
        assert_eq!(verdict("10 times"), Verdict::Stands);
        assert_eq!(findings.figures.len(), 2);
        assert!(findings.figures[0].svg.contains("180 x 4 free"));
        let auto = rows.iter().find(|row| text(row, "model") == "auto").unwrap();
        assert!(number(auto, "rays_per_mount").unwrap() < 10.0 * 236_160.0);
    }

    #[test]
    fn a_scene_is_asked_for_only_where_one_is_needed() {
        let tasks = |scene: Option<&str>| {
            SpeedAccuracy.tasks(&Size { seeds: 1, scene: scene.map(Into::into), ..Size::default() }).unwrap()
        };
        assert!(tasks(None).iter().all(|task| task.get("scene").is_none_or(serde_json::Value::is_null)));
        assert!(tasks(Some("house.ply")).len() > tasks(None).len());
        let walk = Size { trajectory: Some("house.tum".into()), ..Size::default() };
        assert!(SpeedAccuracy.tasks(&walk).unwrap_err().to_string().contains("--scene"));
        let error = SpeedAccuracy.run(&json!({"case": "x", "model": "y", "scene": null, "quick": true}));
        assert!(error.unwrap_err().to_string().contains("no case \"x\""));
    }
}
