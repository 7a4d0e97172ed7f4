//! Cases of the integration binary and the data they need.

pub mod datagram;
mod document;
mod pulse;
pub mod walk;

use std::panic::{catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitCode};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use libtest_mimic::{Arguments, Trial};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

pub use document::document;

/// One test case.
#[derive(Clone, Copy)]
pub struct Case {
    pub name: &'static str,
    pub needs: Needs,
    pub run: fn(),
}

/// What a case cannot do without.
#[derive(Clone, Copy)]
pub enum Needs {
    /// Nothing but the project.
    Nothing,
    /// The folder of captures and reference numbers (`OUTRIGGER_SHARED`, default `../shared`).
    Shared,
    /// Something of the machine: its name, and whether it is there.
    Machine(&'static str, fn() -> bool),
}

impl Needs {
    /// What is missing, in words.
    fn missing(self) -> Option<&'static str> {
        match self {
            Needs::Nothing => None,
            Needs::Shared => shared_folder().is_none().then_some("OUTRIGGER_SHARED names no folder"),
            Needs::Machine(what, is_there) => (!is_there()).then_some(what),
        }
    }
}

/// A case that needs nothing but the project.
pub const fn case(name: &'static str, run: fn()) -> Case {
    Case { name, needs: Needs::Nothing, run }
}

/// A case that compares with captures or reference numbers outside the project.
pub const fn with_shared(name: &'static str, run: fn()) -> Case {
    Case { name, needs: Needs::Shared, run }
}

/// A case that needs something of the machine; `what` says what is missing.
pub const fn with_machine(name: &'static str, what: &'static str, is_there: fn() -> bool, run: fn()) -> Case {
    Case { name, needs: Needs::Machine(what, is_there), run }
}

/// The folder of captures and reference numbers, if it is there.
pub fn shared_folder() -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let folder = std::env::var_os("OUTRIGGER_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    // programs under test may run in a folder of their own
    folder.is_dir().then(|| folder.canonicalize().expect("a folder that is there"))
}

/// A path below that folder; only for cases made by [`with_shared`].
pub fn shared(path: &str) -> PathBuf {
    shared_folder().expect("the case is run only with the folder").join(path)
}

/// Deletes a folder while the child that writes into it stands still: what it wrote in between would stay behind.
pub fn delete_under(child: &Child, folder: &Path) {
    let pid = Pid::from_raw(child.id() as i32);
    kill(pid, Signal::SIGSTOP).unwrap();
    assert_eq!(waitpid(pid, Some(WaitPidFlag::WUNTRACED)), Ok(WaitStatus::Stopped(pid, Signal::SIGSTOP)));
    std::fs::remove_dir_all(folder).unwrap();
    kill(pid, Signal::SIGCONT).unwrap();
}

/// Modules whose cases talk to devices in real time.
const REAL_TIME: [&str; 10] = [
    "bought_servos",
    "cia402",
    "closed_loop",
    "daemon",
    "demo",
    "firmware",
    "rig",
    "rig_damage",
    "rig_stops",
    "rig_verbs",
];

/// Runs a case of such a module; one that failed while the machine stood still runs again, twice at most, and is named.
fn repeated_where_the_machine_stood_still(name: &str, run: fn()) {
    for repetition in 1..=2 {
        let start = Instant::now();
        let Err(panic) = catch_unwind(run) else { return };
        let Some(stood) = pulse::stood_still_since(start) else { resume_unwind(panic) };
        eprintln!(
            "REPEATED ({repetition}): {name} failed while the machine stood still for {} ms",
            stood.as_millis()
        );
    }
    run();
}

/// Runs every case; the closing lines are the runner's own. With `CASE_TIMES` set the seconds of each case follow on
/// stderr, longest first (a name that is none of the program's: reports tell what those hold).
pub fn run(modules: &[(&str, &[Case])]) -> ExitCode {
    let mut arguments = Arguments::from_args();
    let begun = Instant::now();
    pulse::watch();
    // a case waits for devices and for its child processes for a third of its time
    arguments.test_threads.get_or_insert(std::thread::available_parallelism().map_or(1, usize::from) + 1);
    let mut left_out = Vec::new();
    let mut trials = Vec::new();
    let times_s = Arc::new(Mutex::new(Vec::new()));
    for (module, cases) in modules {
        let is_real_time = REAL_TIME.contains(module);
        for (turn, case) in cases.iter().enumerate() {
            let name = format!("{module}::{}", case.name);
            let missing = case.needs.missing();
            if let Some(missing) = missing {
                left_out.push((name.clone(), missing));
            }
            let (run, times_s, timed) = (case.run, times_s.clone(), name.clone());
            let trial = Trial::test(name, move || {
                let start = Instant::now();
                match is_real_time {
                    true => repeated_where_the_machine_stood_still(&timed, run),
                    false => run(),
                }
                times_s.lock().expect("held for a push only").push((start.elapsed().as_secs_f64(), timed));
                Ok(())
            });
            trials.push((turn, trial.with_ignored_flag(missing.is_some())));
        }
    }
    // one of each module in turn: cases that compute run beside cases that wait
    trials.sort_by_key(|(turn, _)| *turn);
    let conclusion = libtest_mimic::run(&arguments, trials.into_iter().map(|(_, trial)| trial).collect());
    if let Some(stood) = pulse::stood_still_since(begun) {
        eprintln!("the machine stood still for up to {} ms", stood.as_millis());
    }
    if std::env::var_os("CASE_TIMES").is_some() {
        let mut times_s = times_s.lock().expect("every case has ended");
        times_s.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (time_s, name) in times_s.iter() {
            eprintln!("{time_s:8.2} s {name}");
        }
    }
    if !left_out.is_empty() && !arguments.list {
        eprintln!("LEFT OUT: {} comparisons:", left_out.len());
        for (name, missing) in left_out {
            eprintln!("LEFT OUT: {name}: {missing}");
        }
    }
    conclusion.exit_code()
}
