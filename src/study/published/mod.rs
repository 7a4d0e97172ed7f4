//! The published tables and ours: Table 3, Table 4, Figure 10, the price of a sensor +-20 %, Table 8.
//!
//! Methods run as published: their own populations, rules of stopping and closing searches. Next to the roll and price rows
//! stands the converged answer of this program's default method. The published J of Table 3 are of a re-score with noisy
//! rays; both numbers are given.

mod claims;
mod data;
mod tables;

use serde_json::{Value, json};

use super::searches::{self, Found, SearchTask};
use super::{Findings, Row, Size, Study, StudyError};
use crate::design::optimize::Kind;
use crate::simulate::published::PUBLISHED_SPREAD_DEG;

/// Evaluations of the default method where an answer close to the best is wanted.
const CONVERGED_EVALUATIONS: usize = 1500;
/// Beyond the seed points of every method, so that each takes its own steps.
const QUICK_EVALUATIONS: usize = 15;

/// See the module.
#[derive(Debug)]
pub struct Published;

impl Study for Published {
    fn name(&self) -> &'static str {
        "published"
    }

    fn about(&self) -> &'static str {
        "Do the published tables come out again, with which spread over seeds, and do the claims made from them stand?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let mut tasks = Vec::new();
        for seed in 1..=size.seeds {
            for row in &data::TABLE_3 {
                tasks.push(SearchTask::published("table 3", row.preset, row.method, seed));
            }
            for row in &data::TABLE_8 {
                tasks.push(SearchTask {
                    roll_deg: row.roll_deg,
                    ..SearchTask::published("table 8", row.preset, Kind::Bayesian, seed)
                });
                tasks.push(SearchTask {
                    roll_deg: row.roll_deg,
                    ..converged("table 8, converged", row.preset, seed)
                });
            }
            for preset in ["paper-os1-64", "paper-vlp-16"] {
                for lambda in data::LAMBDAS {
                    tasks.push(SearchTask {
                        lambda,
                        ..SearchTask::published("lambda", preset, Kind::Bayesian, seed)
                    });
                    tasks.push(SearchTask { lambda, ..converged("lambda, converged", preset, seed) });
                }
                tasks.push(SearchTask { path: "forward".into(), ..converged("path forward", preset, seed) });
            }
        }
        if size.quick {
            for task in &mut tasks {
                task.evaluations = task.evaluations.min(QUICK_EVALUATIONS);
            }
        }
        Ok(searches::values(&tasks))
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let task = searches::task(task)?;
        let mut found = task.run()?;
        if task.part == "table 3" {
            rescore(&mut found, task.seed)?;
        }
        Ok(vec![found.row])
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let claims = claims::claims(rows);
        let count = |verdict| claims.iter().filter(|claim| claim.verdict == verdict).count();
        let summary = format!(
            "{} claims examined: {} stand, {} do not, {} cannot be distinguished from chance.",
            claims.len(),
            count(super::Verdict::Stands),
            count(super::Verdict::DoesNotStand),
            count(super::Verdict::CannotTell)
        );
        let tables = vec![
            tables::table_3(rows),
            tables::table_4(rows),
            tables::figure_10(rows),
            tables::lambda(rows),
            tables::table_8(rows),
        ];
        Findings { summary, claims, tables, figures: tables::convergence(rows), ..Findings::default() }
    }
}

fn converged(part: &str, preset: &str, seed: u64) -> SearchTask {
    SearchTask {
        evaluations: CONVERGED_EVALUATIONS,
        as_published: false,
        ..SearchTask::published(part, preset, Kind::Staged, seed)
    }
}

/// The published re-score with noisy rays.
fn rescore(found: &mut Found, seed: u64) -> Result<(), StudyError> {
    let view = found.objective.simulator();
    let sensors = view.experiment().sensors(&found.masters);
    let seen = view.cover_spread(&sensors, PUBLISHED_SPREAD_DEG, seed).map_err(StudyError::of)?;
    let noisy = found.objective.score_counts(&found.objective.mounted(&sensors), &seen.coverage.counts());
    found.row.insert("j_noisy".into(), json!(noisy.objective));
    found.row.insert("unique_voxels_noisy".into(), json!(noisy.unique_voxels));
    found.row.insert("overlap_ratio_noisy".into(), json!(noisy.overlap_ratio));
    Ok(())
}
