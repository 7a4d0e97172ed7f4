//! Files of others, changed where it hurts: the program reads each in a process of its own, with 1 GiB of memory and 10 s
//! of processor. It may refuse and it may answer; it does not panic, abort, run on, or leave half a file behind.
//!
//! `MUTANTS` says how many there are of each format, `MUTANTS_OF` of which one alone. One that fails is kept under `target/mutants`; made small it belongs
//! into `tests/mutants/regressions/FORMAT`, from where it is read on every run.

mod bag_seeds;
mod flags;
mod mutate;
mod scene_seeds;
mod seeds;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Instant;

use seeds::{FORMATS, Format, Kit};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("meshes", || feed_all("mesh")),
    case("clouds", || feed_all("cloud")),
    case("captures", || feed_all("capture")),
    case("bags", || feed_all("bag")),
    case("documents", || feed_all("document")),
    case("sessions", || feed_all("session")),
    case("flags", flags::feed),
    case("a_panic_is_noticed", a_judge_that_sees_nothing_is_none),
];

/// Of each format, where `MUTANTS` does not say.
const MUTANTS: u64 = 12;
/// Memory that a process may ask for, KiB.
const MEMORY_KIB: u64 = 1 << 20;
/// Time on a processor, s.
const PROCESSOR_S: u64 = 10;

fn feed_all(group: &str) {
    let kit = Kit::new();
    let only = std::env::var("MUTANTS_OF").ok();
    let outcomes: Vec<String> = FORMATS
        .iter()
        .filter(|format| format.group == group && only.as_ref().is_none_or(|only| only == format.name))
        .filter_map(|format| feed(&kit, format))
        .collect();
    assert!(outcomes.is_empty(), "{}", outcomes.join("\n"));
}

/// Mutants of each format that are asked for.
fn wanted() -> u64 {
    std::env::var("MUTANTS").ok().and_then(|count| count.parse().ok()).unwrap_or(MUTANTS)
}

/// Reads the whole seed, the regressions and the mutants of a format; what went wrong.
fn feed(kit: &Kit, format: &Format) -> Option<String> {
    let start = Instant::now();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let kept = root.join("target/mutants").join(format.name);
    let wanted = wanted();
    let seeds = (format.seeds)(kit);
    let mut faults = Vec::new();
    for (at, seed) in seeds.iter().enumerate() {
        let output = read(kit, format, seed, 0);
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 3)), "{} {at} as it should be: {output:?}", format.name);
    }
    let mut judge = |bytes: &[u8], number: u64, name: &str| {
        let output = read(kit, format, bytes, number);
        if let Err(fault) = verdict(kit, &output) {
            std::fs::create_dir_all(&kept).unwrap();
            let path = kept.join(name);
            std::fs::write(&path, bytes).unwrap();
            faults.push(format!("{} {}: {fault}", format.name, path.display()));
        }
        matches!(output.status.code(), Some(0 | 3))
    };
    let mut accepted = 0;
    for number in 0..wanted {
        let seed = &seeds[(number % seeds.len() as u64) as usize];
        accepted += u64::from(judge(&mutate::mutant(seed, number), number, &number.to_string()));
    }
    let regressions = root.join("tests/mutants/regressions").join(format.name);
    for entry in std::fs::read_dir(regressions).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        for number in 0..format.commands as u64 {
            judge(&std::fs::read(&path).unwrap(), number, &name);
        }
    }
    std::fs::write(kit.path(format.file), &seeds[0]).unwrap();
    let failed = faults.len();
    let seconds = start.elapsed().as_secs_f64();
    println!("mutants {}: {wanted}, {accepted} accepted, {failed} failed, {seconds:.0} s", format.name);
    (failed > 0).then(|| faults.join("\n"))
}

/// Runs the program on these bytes.
fn read(kit: &Kit, format: &Format, bytes: &[u8], number: u64) -> Output {
    let path = kit.path(format.file);
    std::fs::write(&path, bytes).unwrap();
    kit.empty_out();
    run(&(format.command)(kit, &path, number as usize % format.commands), 60)
}

/// Runs the program under limits; after `wait_s` it is told to end, which what waits by its nature does.
fn run(arguments: &[String], wait_s: u64) -> Output {
    let limits = format!(
        "ulimit -v {MEMORY_KIB}; ulimit -t {PROCESSOR_S}; ulimit -c 0; \
         exec timeout --preserve-status -k {PROCESSOR_S} -s INT {wait_s} \"$@\""
    );
    Command::new("sh")
        .args(["-c", &limits, "sh", env!("CARGO_BIN_EXE_outrigger")])
        .args(arguments)
        // each thread's heap reserves what the limit counts
        .envs([("RAYON_NUM_THREADS", "2"), ("MALLOC_ARENA_MAX", "2"), ("RUST_BACKTRACE", "0")])
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn verdict(kit: &Kit, output: &Output) -> Result<(), String> {
    let message = String::from_utf8_lossy(&output.stderr);
    let last = message.lines().rev().take(3).collect::<Vec<_>>().join(" | ");
    // told to end, as a shell says it
    let code = output.status.code().map(|code| if code == 130 { 0 } else { code });
    let Some(code) = code else { return Err(format!("{}: {last}", output.status)) };
    if !(0..=3).contains(&code) || message.contains("panicked") {
        return Err(format!("exit code {code}: {message}"));
    }
    if code != 0 && message.trim().is_empty() && output.stdout.is_empty() {
        return Err(format!("exit code {code} without a word"));
    }
    let left: Vec<PathBuf> =
        std::fs::read_dir(kit.out()).unwrap().map(|entry| entry.unwrap().path()).collect();
    match code {
        1 | 2 if !left.is_empty() => Err(format!("exit code {code}, and {left:?} lies there: {last}")),
        _ => Ok(()),
    }
}

fn a_judge_that_sees_nothing_is_none() {
    let kit = Kit::new();
    kit.empty_out();
    let sh = |script: &str| Command::new("sh").args(["-c", script]).output().unwrap();
    assert!(verdict(&kit, &sh("exit 0")).is_ok());
    assert!(verdict(&kit, &sh("echo no >&2; exit 1")).is_ok());
    for script in ["exit 1", "exit 101", "kill -ABRT $$", "echo thread panicked >&2; exit 1"] {
        assert!(verdict(&kit, &sh(script)).is_err(), "{script}");
    }
    std::fs::write(kit.out().join("half"), "").unwrap();
    assert!(verdict(&kit, &sh("echo no >&2; exit 1")).is_err());
    let greedy = run(&["--version".into()], 60);
    assert!(verdict(&kit, &greedy).is_ok(), "the limits let it begin: {greedy:?}");
}
