//! Every method at equal budgets, on both sensors and both paths, and the mounts it found under a converged model and under
//! mount errors: which method's mounts are truly better.

use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::rows::{chosen, numbers};
use super::searches::{self, SearchTask, best_after};
use super::{Findings, Row, Size, Spread, Study, StudyError, Table};
use crate::design::objective::Objective;
use crate::design::optimize::{FinalLook, Kind};
use crate::design::robustness::{Robustness, Tolerance};
use crate::report::chart;
use crate::rig::{MountDeg, Rig};

const BUDGETS: [usize; 4] = [56, 80, 300, 3500];
const PLACES: [(&str, &str); 4] = [
    ("paper-os1-64", "lateral"),
    ("paper-os1-64", "forward"),
    ("paper-vlp-16", "lateral"),
    ("paper-vlp-16", "forward"),
];
/// Columns and poses per metre at which more change little.
const CONVERGED: (usize, usize) = (1800, 8);
/// And at which draws of mount errors are affordable.
const BUILT: (usize, usize) = (360, 4);
const BUILT_DRAWS: usize = 8;
/// What a search by the default method gives after its final look, as `optimize` does it.
const LOOKED: &str = "staged, final look";
/// The tolerance that the publication names.
const TOLERANCE: Tolerance = Tolerance { position_m: 0.01, angle_deg: 1.0, free_phase: true };
const DRAWS: usize = 64;

/// See the module.
#[derive(Debug)]
pub struct Methods;

impl Study for Methods {
    fn name(&self) -> &'static str {
        "methods"
    }

    fn about(&self) -> &'static str {
        "Which search method finds the best mounts in so many evaluations, and are its mounts better once sampling noise, \
         mount errors and spin phase are left out?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let mut tasks = Vec::new();
        for (preset, path) in PLACES {
            for evaluations in BUDGETS.into_iter().filter(|budget| !size.quick || *budget == 56) {
                for &method in Kind::ALL {
                    // beyond some hundred evaluations the process costs more than the objective
                    if method == Kind::Bayesian && evaluations > 300 {
                        continue;
                    }
                    for seed in 1..=size.seeds {
                        tasks.push(SearchTask {
                            path: path.into(),
                            evaluations,
                            as_published: false,
                            ..SearchTask::published("methods", preset, method, seed)
                        });
                    }
                }
            }
        }
        Ok(searches::values(&tasks))
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let task = searches::task(task)?;
        let found = task.run()?;
        let judges = Judges::new(&task, &found.objective)?;
        let judged = |mut row: Row, masters: &[MountDeg]| {
            judges.judge(&mut row, &found.objective.rig(masters))?;
            Ok::<_, StudyError>(row)
        };
        let mut rows = vec![judged(found.row.clone(), &found.masters)?];
        if task.method == Kind::Staged {
            let look = FinalLook::at(&found.objective, &found.shortlist, TOLERANCE, &AtomicBool::new(false))
                .map_err(StudyError::of)?;
            if let Some(look) = look {
                let masters = &found.shortlist[look.best];
                let mut row = found.row.clone();
                row.insert("method".into(), json!(LOOKED));
                row.insert("look_evaluations".into(), json!(look.evaluations));
                let evaluation = found.objective.evaluate(masters).map_err(StudyError::of)?;
                row.insert("j".into(), json!(evaluation.objective));
                rows.push(judged(row, masters)?);
            }
        }
        Ok(rows)
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut tables = Vec::new();
        let mut leaders = Vec::new();
        for (preset, path) in PLACES {
            let here = chosen(rows, &[("preset", preset), ("path", path)]);
            if here.is_empty() {
                continue;
            }
            tables.push(scores(&here, preset, path));
            let (table, leader) = truly(&here, preset, path);
            tables.push(table);
            leaders.push(leader);
        }
        Findings { summary: leaders.join(" "), tables, ..Findings::default() }
    }
}

/// What mounts are judged by besides the objective that was searched.
struct Judges {
    tolerance: Robustness,
    built: Robustness,
    converged: Objective,
}

impl Judges {
    fn new(task: &SearchTask, objective: &Objective) -> Result<Self, StudyError> {
        let sampled = |finer| searches::sampled(&task.objective()?, finer);
        let judge = |objective: &Objective, draws, seed| {
            Robustness::new(objective, TOLERANCE, draws, seed).map_err(StudyError::of)
        };
        Ok(Self {
            tolerance: judge(objective, DRAWS, 1)?,
            built: judge(&sampled(BUILT)?, BUILT_DRAWS, 3)?,
            converged: sampled(CONVERGED)?,
        })
    }

    fn judge(&self, row: &mut Row, rig: &Rig) -> Result<(), StudyError> {
        let spread = self.tolerance.spread(rig).map_err(StudyError::of)?;
        row.insert("j_tolerance_mean".into(), json!(spread.mean));
        row.insert("j_tolerance_sd".into(), json!(spread.deviation));
        row.insert("j_tolerance_worst".into(), json!(spread.worst));
        let built = self.built.spread(rig).map_err(StudyError::of)?;
        row.insert("j_built".into(), json!(built.mean));
        let converged = self.converged.score(rig).map_err(StudyError::of)?;
        row.insert("j_converged".into(), json!(converged));
        Ok(())
    }
}

fn budgets(rows: &[&Row]) -> Vec<usize> {
    let mut all: Vec<usize> = numbers(rows, "evaluations").into_iter().map(|n| n as usize).collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn of<'a>(rows: &[&'a Row], method: &str, budget: usize) -> Vec<&'a Row> {
    let is_it = |row: &&&Row| {
        super::text(row, "method") == method && super::number(row, "evaluations") == Some(budget as f64)
    };
    rows.iter().filter(is_it).copied().collect()
}

fn scores(rows: &[&Row], preset: &str, path: &str) -> Table {
    let mut table = Table::new(
        &format!("scores-{preset}-{path}"),
        &format!("Best J, {preset}, path {path}"),
        "Median over the seeds, in brackets the quartiles. Each budget is a search of its own.",
        &["method"],
    );
    let budgets = budgets(rows);
    table.columns.extend(budgets.iter().map(|budget| format!("{budget} evaluations")));
    for &method in Kind::ALL {
        let cell = |budget: &usize| {
            let values: Vec<f64> = of(rows, method.name(), *budget)
                .iter()
                .filter_map(|row| best_after(row, *budget as f64))
                .collect();
            Spread::of(&values).map_or(String::new(), |s| {
                format!(
                    "{} ({} to {})",
                    chart::number(s.median, 1),
                    chart::number(s.low, 1),
                    chart::number(s.high, 1)
                )
            })
        };
        table.rows.push(std::iter::once(method.name().to_owned()).chain(budgets.iter().map(cell)).collect());
    }
    table
}

/// The mounts under the converged model and under mount errors, at the max budget.
fn truly(rows: &[&Row], preset: &str, path: &str) -> (Table, String) {
    let mut table = Table::new(
        &format!("truth-{preset}-{path}"),
        &format!("The mounts found, judged again, {preset}, path {path}"),
        &format!(
            "Medians over the seeds with 95 % intervals (bootstrap). Converged: {} azimuths, {} poses per metre, free \
             phase. Tolerance: {DRAWS} draws of +-1 cm and +-1 degree for each sensor, free phase, published sampling. As \
             built: {BUILT_DRAWS} such draws with {} azimuths, {} poses per metre. After a final look the default method gives \
             the best as built of the mounts it liked, judged by other draws in a coarser model.",
            CONVERGED.0, CONVERGED.1, BUILT.0, BUILT.1
        ),
        &[
            "method",
            "evaluations",
            "J as searched",
            "J converged",
            "J tolerance, mean",
            "J tolerance, worst",
            "J as built",
        ],
    );
    let mut best: Vec<(f64, [f64; 2], &str)> = Vec::new();
    for method in Kind::ALL.iter().map(|kind| kind.name()).chain([LOOKED]) {
        let Some(budget) = budgets(rows).into_iter().rev().find(|b| !of(rows, method, *b).is_empty()) else {
            continue;
        };
        let of_method = of(rows, method, budget);
        let spread = |field: &str| Spread::of(&numbers(&of_method, field));
        let cell = |field: &str| {
            spread(field).map_or(String::new(), |s| {
                let [low, high] = s.interval.map(|value| chart::number(value, 0));
                format!("{} [{low}, {high}]", chart::number(s.median, 0))
            })
        };
        let mut cells = vec![method.to_owned(), budget.to_string()];
        cells.extend(["j", "j_converged", "j_tolerance_mean", "j_tolerance_worst", "j_built"].map(cell));
        table.rows.push(cells);
        if let Some(s) = spread("j_built") {
            best.push((s.median, s.interval, method));
        }
    }
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    let leader = best.first().map_or(String::new(), |(median, interval, name)| {
        let alike: Vec<&str> =
            best[1..].iter().filter(|other| other.1[1] >= interval[0]).map(|b| b.2).collect();
        let alike = if alike.is_empty() {
            "no other's interval reaches it".into()
        } else {
            format!("not distinguishable from it: {}", alike.join(", "))
        };
        format!(
            "{preset}, path {path}: as built the mounts of {name} score best, {}; {alike}.",
            chart::number(*median, 0)
        )
    });
    (table, leader)
}
