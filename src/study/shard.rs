//! A study on disk: `plan.json`, one file per shard that appears whole or not at all, and what comes of them all.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::page::line;
use super::rows::FAILED;
use super::saved_rows::{SavedRows, sha256_of};
use super::{Findings, Row, Size, Study, StudyError, csv, findings_report, named};
use crate::base::files;
use crate::base::questions::first_difference;

const PLAN_FORMAT: &str = "outrigger-study-plan/1";
const SHARD_FORMAT: &str = "outrigger-study-shard/1";

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    format: String,
    /// Name of the study.
    pub study: String,
    /// What it was asked for.
    pub size: Size,
    /// Its tasks.
    pub tasks: Vec<Value>,
}

/// Part `index` of `count`, from 1: every `count`-th task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// Which, from 1.
    pub index: usize,
    /// Of how many.
    pub count: usize,
}

impl Shard {
    /// Numbers of its tasks, of so many in all.
    fn tasks(self, all: usize) -> impl Iterator<Item = usize> {
        (self.index.saturating_sub(1)..all).step_by(self.count.max(1))
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if 1 <= index && index <= count => Ok(Self { index, count }),
            _ => Err("give which shard of how many, such as 3/16".into()),
        }
    }
}

/// Tasks by number, each with its rows.
type Done = Vec<(usize, Vec<Row>)>;

#[derive(Serialize, Deserialize)]
struct ShardFile {
    format: String,
    /// Of the plan, so that rows of another plan are not mixed in.
    plan_sha256: String,
    shard: Shard,
    /// Of `done` as it is written, so that damage that leaves it readable is found.
    done_sha256: String,
    done: Done,
}

impl ShardFile {
    /// Whether some of its tasks failed: what was amiss may be mended by now.
    fn has_failed(&self) -> bool {
        self.done.iter().flat_map(|(_, rows)| rows).any(|row| row.contains_key(FAILED))
    }
}

/// What came of a shard that was to be run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ran {
    /// It was run, or lay there whole.
    Whole,
    /// A damaged file lay there, or one of tasks that failed; this is its fault, and it was run again.
    Again(String),
    /// Stopped before the end: nothing was written.
    Stopped,
}

/// A shard, or the fault of a damaged one.
type ReadShard = Result<ShardFile, String>;

/// Why the file of a shard cannot be used.
enum Unusable {
    /// No work is lost when it is done again.
    Damaged(String),
    /// Somebody else's, or not to be read at all.
    Foreign(StudyError),
}

impl Plan {
    /// Plans a study.
    pub(crate) fn new(study: &dyn Study, size: Size) -> Result<Self, StudyError> {
        let tasks = study.tasks(&size)?;
        Ok(Self { format: PLAN_FORMAT.into(), study: study.name().into(), size, tasks })
    }

    /// A plan of some tasks of a study.
    pub(super) fn of_tasks(study: &str, tasks: Vec<Value>) -> Self {
        Self { format: PLAN_FORMAT.into(), study: study.into(), size: Size::default(), tasks }
    }

    /// Writes `plan.json` into a folder, which is made. A plan that lies there already must be of the same study and size;
    /// where only tasks came or went, the results of the others stay; returns how many these are.
    pub(crate) fn write(&self, folder: &Path) -> Result<Option<usize>, StudyError> {
        std::fs::create_dir_all(folder).map_err(|error| StudyError::at(folder, error))?;
        let path = folder.join("plan.json");
        let mut done = None;
        if path.exists() {
            let there = Self::read(folder)?;
            if there == *self {
                return Ok(None);
            }
            if let Some(difference) = self.difference(&there) {
                let words =
                    format!("{} holds another plan, {difference}: give another folder", path.display());
                return Err(StudyError(words));
            }
            let saved = there.keep(folder)?;
            done = Some(self.tasks.iter().filter(|task| saved.of(task).is_some()).count());
            saved.write(folder)?;
            // only now, and before the plan: whatever ends this in between, the next call finds the saved rows
            for (path, _) in there.shards(folder)? {
                std::fs::remove_file(&path).map_err(|error| StudyError::at(&path, error))?;
            }
        }
        files::write_json(&path, self).map_err(|error| StudyError::at(&path, error))?;
        Ok(done)
    }

    /// In what another plan was asked for something else; nothing where at most its tasks are others.
    fn difference(&self, other: &Self) -> Option<String> {
        let question = |plan: &Self| json!({"study": plan.study, "size": plan.size});
        let found = first_difference(&question(other), &question(self), &["/study"])?;
        let name = found.place.trim_start_matches("/size").trim_start_matches('/').replace('_', "-");
        Some(format!("of {name} {}, asked for is {}", found.then, found.now))
    }

    /// Everything that was done of this plan and did not fail.
    fn keep(&self, folder: &Path) -> Result<SavedRows, StudyError> {
        let mut saved = SavedRows::read(folder)?;
        for (_, shard) in self.shards(folder)? {
            // a damaged one is done again
            for (task, rows) in shard.map_or(Vec::new(), |file| file.done) {
                if !rows.iter().any(|row| row.contains_key(FAILED)) {
                    saved.keep(&self.tasks[task], rows);
                }
            }
        }
        Ok(saved)
    }

    /// Reads `plan.json`.
    pub(crate) fn read(folder: &Path) -> Result<Self, StudyError> {
        let path = folder.join("plan.json");
        let text = crate::base::files::read_text(&path).map_err(|error| {
            StudyError(format!("{}: {error}; `outrigger study plan` makes it", path.display()))
        })?;
        let plan: Self = serde_json::from_str(&text).map_err(|error| StudyError::at(&path, error))?;
        if plan.format != PLAN_FORMAT {
            return Err(StudyError(format!(
                "{}: format is {:?}, this program reads {PLAN_FORMAT:?}",
                path.display(),
                plan.format
            )));
        }
        Ok(plan)
    }

    fn sha256(&self) -> String {
        sha256_of(self)
    }

    /// Runs one shard's tasks and writes its file; one that lies there whole is left as it is, a damaged one is replaced.
    /// `progress` gets the number of finished tasks.
    pub(crate) fn run_shard(
        &self,
        folder: &Path,
        shard: Shard,
        progress: impl Fn(usize) + Sync,
        stop: &AtomicBool,
    ) -> Result<Ran, StudyError> {
        let path = shard_path(folder, shard);
        let mut ran = Ran::Whole;
        if path.exists() {
            match self.read_shard(&path) {
                Ok(file) if file.has_failed() => {
                    ran = Ran::Again(format!("{}: some of it failed", path.display()))
                }
                Ok(_) => return Ok(Ran::Whole),
                Err(Unusable::Damaged(what)) => ran = Ran::Again(what),
                Err(Unusable::Foreign(error)) => return Err(error),
            }
        }
        let study = named(&self.study)?;
        let saved = SavedRows::read(folder)?;
        let mine: Vec<usize> = shard.tasks(self.tasks.len()).collect();
        let done = on_all_cores(&mine, progress, stop, |task| {
            let rows = saved
                .of(&self.tasks[task])
                .map_or_else(|| study.run(&self.tasks[task]), |rows| Ok(rows.clone()));
            rows.map_err(|error| StudyError(format!("task {task} ({}): {error}", self.tasks[task])))
        })?;
        let Some(done) = done else { return Ok(Ran::Stopped) };
        let file = ShardFile {
            format: SHARD_FORMAT.into(),
            plan_sha256: self.sha256(),
            shard,
            done_sha256: sha256_of(&done),
            done,
        };
        files::write_json(&path, &file).map_err(|error| StudyError::at(&path, error))?;
        Ok(ran)
    }

    fn read_shard(&self, path: &Path) -> Result<ShardFile, Unusable> {
        let text =
            crate::base::files::read(path).map_err(|error| Unusable::Foreign(StudyError::at(path, error)))?;
        let damaged = |what: String| Unusable::Damaged(format!("{}: {what}", path.display()));
        let file: ShardFile = serde_json::from_slice(&text).map_err(|error| damaged(error.to_string()))?;
        if file.format != SHARD_FORMAT || file.plan_sha256 != self.sha256() {
            let error = format!("{} belongs to another plan: remove it", path.display());
            return Err(Unusable::Foreign(StudyError(error)));
        }
        if sha256_of(&file.done) != file.done_sha256 {
            return Err(damaged("its rows are not those that were written (checksum)".into()));
        }
        let wanted = file.shard.tasks(self.tasks.len());
        if !file.done.iter().map(|(task, _)| *task).eq(wanted) {
            return Err(damaged(format!("it does not hold the tasks of shard {}", file.shard)));
        }
        Ok(file)
    }

    /// The shards that lie in a folder; in place of a damaged one its fault.
    fn shards(&self, folder: &Path) -> Result<Vec<(PathBuf, ReadShard)>, StudyError> {
        let entries = std::fs::read_dir(folder).map_err(|error| StudyError::at(folder, error))?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.retain(|path| {
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            name.starts_with("shard-") && name.ends_with(".json")
        });
        paths.sort();
        let read = |path: PathBuf| match self.read_shard(&path) {
            Ok(file) => Ok((path, Ok(file))),
            Err(Unusable::Damaged(what)) => Ok((path, Err(what))),
            Err(Unusable::Foreign(error)) => Err(error),
        };
        paths.into_iter().map(read).collect()
    }

    /// The rows of all shards that lie in the folder, in the order of the tasks.
    pub(crate) fn rows(&self, folder: &Path) -> Result<Vec<Row>, StudyError> {
        let mut by_task: Vec<Option<Vec<Row>>> = vec![None; self.tasks.len()];
        let shards = self.shards(folder)?;
        let count = shards.len();
        for (_, shard) in shards {
            let file = shard.map_err(|what| {
                StudyError(format!("{what}: nothing was merged; run that shard again, it is then replaced"))
            })?;
            for (task, rows) in file.done {
                // shards cut in different ways may overlap: the same task has the same rows
                if let Some(place) = by_task.get_mut(task) {
                    place.get_or_insert(rows);
                }
            }
        }
        let missing = by_task.iter().filter(|rows| rows.is_none()).count();
        if missing > 0 {
            return Err(StudyError(format!(
                "{missing} of {} tasks have no rows in {} ({} shard files): run the missing shards",
                self.tasks.len(),
                folder.display(),
                count
            )));
        }
        Ok(by_task.into_iter().flatten().flatten().collect())
    }

    /// Writes `rows.csv` (without times: the same bytes however the study was cut), `times.csv` where any was measured, a CSV per table,
    /// `findings.json` and `report.html`.
    pub(crate) fn merge(&self, folder: &Path) -> Result<Findings, StudyError> {
        let study = named(&self.study)?;
        let rows = self.rows(folder)?;
        let findings = study.findings(&rows).at_size(study, &self.size);
        let write = |name: &str, content: &str| {
            let path = folder.join(name);
            files::write_whole(&path, content.as_bytes()).map_err(|error| StudyError::at(&path, error))
        };
        let keep = |wanted: bool| -> Vec<Row> {
            let of_row =
                |row: &Row| row.clone().into_iter().filter(|(name, _)| name.starts_with("wall_") == wanted);
            rows.iter().map(|row| of_row(row).collect()).collect()
        };
        write("rows.csv", &csv(&keep(false)))?;
        let times = keep(true);
        if times.iter().any(|row| !row.is_empty()) {
            write("times.csv", &csv(&times))?;
        }
        for table in &findings.tables {
            let lines = std::iter::once(&table.columns).chain(&table.rows);
            let text: String = lines.map(|cells| line(cells.iter().cloned())).collect();
            write(&format!("{}.csv", table.name), &text)?;
        }
        if !findings.tables.iter().any(|table| table.name == FAILED) {
            // what failed before has not failed now
            let path = folder.join(format!("{FAILED}.csv"));
            let removed = std::fs::remove_file(&path);
            removed.or_else(ignore_absent).map_err(|error| StudyError::at(&path, error))?;
        }
        let document = json!({ "study": self.study, "size": self.size, "tasks": self.tasks.len(), "findings": findings });
        let path = folder.join("findings.json");
        files::write_json(&path, &document).map_err(|error| StudyError::at(&path, error))?;
        write("report.html", &findings_report(study.name(), study.about(), &findings).html(&self.command()))?;
        Ok(findings)
    }

    /// The command that does it all again.
    fn command(&self) -> String {
        let mut command = format!("outrigger study {} --seeds {}", self.study, self.size.seeds);
        if self.size.quick {
            command += " --quick";
        }
        if let Some(scene) = &self.size.scene {
            command += &format!(" --scene {}", scene.display());
        }
        if let Some(trajectory) = &self.size.trajectory {
            command += &format!(" --trajectory {}", trajectory.display());
        }
        if self.size.count_instructions {
            command += " --count-instructions";
        }
        command
    }
}

fn ignore_absent(error: std::io::Error) -> std::io::Result<()> {
    if error.kind() == std::io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

/// The rows of each task, in their order; none when stopped. A task has one thread to itself, so that its measured times are
/// its own.
fn on_all_cores(
    tasks: &[usize],
    progress: impl Fn(usize) + Sync,
    stop: &AtomicBool,
    run: impl Fn(usize) -> Result<Vec<Row>, StudyError> + Sync,
) -> Result<Option<Done>, StudyError> {
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let done = Mutex::new(Vec::new());
    let work = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(StudyError::of)?;
        while let Some(&task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let rows = pool.install(|| run(task))?;
            done.lock().unwrap_or_else(PoisonError::into_inner).push((task, rows));
            progress(finished.fetch_add(1, Ordering::Relaxed) + 1);
        }
        Ok(())
    };
    let threads = rayon::current_num_threads().min(tasks.len());
    let outcomes: Vec<Result<(), StudyError>> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, _>| {
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        workers.into_iter().map(join).collect()
    });
    outcomes.into_iter().collect::<Result<(), _>>()?;
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(task, _)| *task);
    Ok((done.len() == tasks.len()).then_some(done))
}

fn shard_path(folder: &Path, shard: Shard) -> PathBuf {
    folder.join(format!("shard-{:05}-of-{:05}.json", shard.index, shard.count))
}
