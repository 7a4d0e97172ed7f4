//! Search methods: what they reach against what they cost.

use serde_json::{Value, json};

use crate::base::statistics::{quantile, sorted};
use crate::design::optimize::Kind;
use crate::report::chart::{self, NamedPoint, ScatterChart};
use crate::study::rows::{Row, chosen, number, numbers, text};
use crate::study::searches::{self, SearchTask};
use crate::study::{Figure, Findings, StudyError, Table};

const PART: &str = "optimizers";
const PRESET: &str = "paper-os1-64";
const BUDGETS: [usize; 2] = [56, 300];
/// Seeds of each, at most: medians of these place a method on the chart; the study `methods` tells close ones apart.
const MAX_SEEDS: u64 = 5;
/// Columns and poses per metre at which more change little.
const CONVERGED: (usize, usize) = (1800, 8);

pub(super) fn tasks(seeds: u64, quick: bool) -> Vec<Value> {
    let mut tasks = Vec::new();
    for evaluations in BUDGETS.into_iter().take(if quick { 1 } else { BUDGETS.len() }) {
        for &method in Kind::ALL {
            for seed in 1..=seeds.min(if quick { 1 } else { MAX_SEEDS }) {
                let task = SearchTask::published(PART, PRESET, method, seed);
                tasks.push(SearchTask { evaluations, as_published: false, ..task });
            }
        }
    }
    searches::values(&tasks)
}

pub(super) fn is_mine(task: &Value) -> bool {
    task["part"] == PART
}

pub(super) fn run(task: &Value) -> Result<Vec<Row>, StudyError> {
    let task = searches::task(task)?;
    let mut found = task.run()?;
    let converged = searches::sampled(&found.objective, CONVERGED)?;
    let converged = converged.score(&converged.rig(&found.masters)).map_err(StudyError::of)?;
    found.row.insert("j_converged".into(), json!(converged));
    Ok(vec![found.row])
}

/// A chart and a table of the medians over the seeds.
pub(super) fn add_findings(rows: &[Row], findings: &mut Findings) {
    let mine = chosen(rows, &[("part", PART)]);
    let best = numbers(&mine, "j_converged").into_iter().fold(f64::NEG_INFINITY, f64::max);
    if mine.is_empty() {
        return;
    }
    let mut table = Table::new(
        PART,
        &format!("Search methods in {PRESET}"),
        &format!(
            "Medians over the seeds. Converged: the mount found, judged again with {} azimuths, {} poses per metre and a free \
             phase. Below the best: of all mounts found here. Seconds, one thread each, are in times.csv.",
            CONVERGED.0, CONVERGED.1
        ),
        &["method", "evaluations", "rays", "J as searched", "J converged", "below the best %"],
    );
    let (mut of_rays, mut of_time) = (Vec::new(), Vec::new());
    for (group, budget) in BUDGETS.into_iter().enumerate() {
        for &method in Kind::ALL {
            let is_it = |row: &&&Row| {
                text(row, "method") == method.name() && number(row, "evaluations") == Some(budget as f64)
            };
            let here: Vec<&Row> = mine.iter().filter(is_it).copied().collect();
            if here.is_empty() {
                continue;
            }
            let median = |name: &str| quantile(&sorted(numbers(&here, name)), 0.5);
            let below = 100.0 * (best - median("j_converged")) / best;
            let point = |cost: f64| NamedPoint {
                name: format!("{} {budget}", method.name()),
                at: [cost, below],
                group: group + 1,
            };
            of_rays.push(point(median("rays")));
            of_time.push(point(median("wall_s")));
            table.rows.push(vec![
                method.name().into(),
                budget.to_string(),
                chart::number(median("rays"), 0),
                chart::number(median("j"), 1),
                chart::number(median("j_converged"), 1),
                chart::number(below, 3),
            ]);
        }
    }
    for (what, x_label, points) in
        [("rays", "rays of the search", of_rays), ("time", "time of the search on one thread, s", of_time)]
    {
        let chart = ScatterChart {
            title: format!("J lost against {what}: search methods"),
            x_label: x_label.into(),
            y_label: "converged J below the best found, %".into(),
            points,
        };
        findings.figures.push(Figure {
            svg: chart.svg(),
            caption: format!(
                "Search methods in {PRESET} with so many evaluations; filled ones lie on the front: none costs less and reaches more."
            ),
        });
    }
    findings.tables.push(table);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_placed_by_what_they_reach_and_cost() {
        let tasks = tasks(20, true);
        assert_eq!(tasks.len(), Kind::ALL.len());
        let few =
            tasks.iter().filter(|task| ["random", "staged"].contains(&task["method"].as_str().unwrap()));
        let rows: Vec<Row> = few.flat_map(|task| run(task).unwrap()).collect();
        let mut findings = Findings::default();
        add_findings(&rows, &mut findings);
        let [table] = &findings.tables[..] else { panic!() };
        assert!(table.rows.len() == rows.len() && !rows.is_empty(), "{table:?}");
        assert!(table.rows.iter().any(|row| row[5] == "0.000"), "one is the best: {table:?}");
        assert!(table.rows.iter().all(|row| row[2].len() > 6), "rays: {table:?}");
        assert_eq!(findings.figures.len(), 2);
    }
}
