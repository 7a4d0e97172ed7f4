//! Instructions that a model takes for a mount, counted under valgrind: a figure that neither the load of a machine nor its
//! clock moves, on machines without a usable counter, too.
//!
//! Each model scores a few mounts in a process of its own, against one that makes ready and scores none; the difference is
//! the mounts'. Valgrind knows no AVX-512: kernels run as on a processor with AVX2.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use super::cases::Case;
use super::models::{AGAIN, models};
use super::{SpeedAccuracy, Task};
use crate::study::rows::{Row, number, row_of, text};
use crate::study::shard::Plan;
use crate::study::{Size, Study as _, StudyError};

const PART: &str = "instructions";
/// Mounts of the line that each model scores: its ends and its middle.
const MOUNTS: usize = 3;

/// Counts for all models of a case.
pub(super) fn task(case: &Case, size: &Size) -> Value {
    let of_all = models(case, size.quick).first().map(|model| row_of(&Task::new(case, model, size)));
    let mut task = of_all.unwrap_or_default();
    task.insert("part".into(), PART.into());
    Value::Object(task)
}

pub(super) fn is_mine(task: &Value) -> bool {
    task["part"] == PART
}

/// Whether a row is a count.
pub(super) fn is_of(row: &Row) -> bool {
    text(row, "part") == PART
}

/// Instructions per mount of a model, where they were counted.
pub(super) fn of(rows: &[&Row], model: &str) -> Option<f64> {
    let row = rows.iter().find(|row| is_of(row) && text(row, "model") == model)?;
    number(row, "instructions_per_mount")
}

pub(super) fn run(task: &Value) -> Result<Vec<Row>, StudyError> {
    let asked: Task = serde_json::from_value(task.clone()).map_err(StudyError::of)?;
    let case = Case::named(&asked.case)?;
    // adaptive fidelity has no cost of one mount, and converged models take too long
    let is_counted = |name: &String| name != "auto" && name != &asked.model && !name.starts_with(AGAIN);
    let names: Vec<String> =
        models(case, asked.quick).iter().map(super::Model::name).filter(is_counted).collect();
    let folder = tempfile::tempdir().map_err(StudyError::of)?;
    let mut tasks = Vec::new();
    for name in &names {
        for mounts in [0, MOUNTS] {
            let task = Task { model: name.clone(), mounts: Some(mounts), ..asked.clone() };
            tasks.push(Value::Object(row_of(&task)));
        }
    }
    let count = tasks.len();
    Plan::of_tasks(SpeedAccuracy.name(), tasks).write(folder.path())?;
    let counted = |index: usize| count_shard(folder.path(), index, count);
    let mut rows = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let (nothing, mounts) = (counted(2 * place + 1)?, counted(2 * place + 2)?);
        let mut row = task.as_object().cloned().unwrap_or_default();
        row.insert("model".into(), json!(name));
        let each = mounts.saturating_sub(nothing) as f64 / MOUNTS as f64;
        row.insert("instructions_per_mount".into(), json!(each));
        rows.push(row);
    }
    Ok(rows)
}

/// Runs one task of a plan under valgrind, on one thread. Returns its instructions.
fn count_shard(folder: &Path, index: usize, count: usize) -> Result<u64, StudyError> {
    let program = std::env::current_exe().map_err(StudyError::of)?;
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(program)
        .args(["study", "run", SpeedAccuracy.name(), "--shard", &format!("{index}/{count}"), "--out"])
        .arg(folder)
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .map_err(|error| {
            StudyError(format!(
                "valgrind: {error}: install it (Debian: apt install valgrind), or leave out --count-instructions"
            ))
        })?;
    let messages = String::from_utf8_lossy(&output.stderr);
    let collected = collected(&messages);
    collected.filter(|_| output.status.success()).ok_or_else(|| {
        let last = messages.lines().last().unwrap_or("no output").to_owned();
        StudyError(format!("counting under valgrind failed ({}): {last}", output.status))
    })
}

/// The total that callgrind prints at its end.
fn collected(output: &str) -> Option<u64> {
    let (_, total) = output.lines().rev().find_map(|line| line.split_once("Collected :"))?;
    total.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_is_read() {
        let output =
            "==7== Events    : Ir\n==7== Collected : 29472015\n==7== \n==7== I   refs:      29,472,015\n";
        assert_eq!(collected(output), Some(29_472_015));
        assert_eq!(collected("==7== Collected : many"), None);
        assert_eq!(collected("valgrind: no such tool"), None);
    }

    #[test]
    fn counts_are_found_by_model() {
        let size = Size { quick: true, count_instructions: true, ..Size::default() };
        let task = task(Case::named("vlp-16-lateral").unwrap(), &size);
        assert!(is_mine(&task) && task["case"] == "vlp-16-lateral");
        let mut row = task.as_object().cloned().unwrap();
        row.insert("model".into(), json!("180 x 1 locked"));
        row.insert("instructions_per_mount".into(), json!(12.5));
        assert_eq!(of(&[&row], "180 x 1 locked"), Some(12.5));
        assert_eq!(of(&[&row], "auto"), None);
    }
}
