//! `outrigger doctor`: what this machine and this rig lack, and what to do about it.

mod traffic;
mod machine;
mod named;
mod servos;
mod slots;

use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use super::{Context, Outcome, output};

/// Arguments of `doctor`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Nothing moves and nothing is changed. With --config every file that it names is read, every sensor's port is opened \
                  and its first packets are held against `model` and `metadata`, every `host` is asked how it is, and the rig's \
                  port for its state.\n\
                  Exit codes: 0 ready, 1 failed, 3 something must be mended."
)]
pub struct Args {
    /// Where recordings will be written; that of [daemon] in the rig.toml when not given.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Kernel receive buffer that recording will ask for, per port, in MiB; that of [record] in the rig.toml when not given.
    #[arg(long, value_name = "MIB", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    receive_buffer: u16,
    /// How long to listen for the sensors' packets.
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = crate::commands::ranges::within(0.0, 3600.0))]
    listen_for: f64,
    /// The servo rig, as `rig --port` has it; that of [rig] in the rig.toml when not given.
    #[arg(long, env = "OUTRIGGER_RIG_PORT", value_name = "PATH")]
    port: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Ok,
    Warning,
    Bad,
    /// Not known here.
    Unknown,
}

/// One look.
#[derive(Debug, Serialize)]
struct Check {
    name: String,
    state: State,
    found: String,
    /// What to do.
    advice: Option<String>,
}

/// The document that `doctor` prints.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    verdict: &'static str,
    checks: Vec<Check>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        (0.0..=60.0).contains(&args.listen_for),
        "--listen-for {}, expected 0 to 60 s",
        args.listen_for
    );
    let mut checks = vec![machine::processors(), machine::governor(), machine::clock()];
    let named = context.config.map(|config| named::check(config, context)).unwrap_or_default();
    checks.extend(named.checks);
    let traffic = traffic::probe(args, context.config, &named.metadata);
    checks.extend(traffic.checks);
    checks.extend(machine::disk(&args.out, traffic.bytes_s, named.bytes_s)?);
    if let Some(port) = args.port.as_deref() {
        checks.extend(servos::rig(port, context.config, &named.pitches_deg));
    }
    let is_ready = checks.iter().all(|check| check.state != State::Bad);
    let verdict = if is_ready { "ready" } else { "mend" };
    let document = Document { format: "outrigger-doctor/1", verdict, checks };
    output::print_result(context.json, &document, || text(&document), &[])?;
    Ok(if is_ready { Outcome::Done } else { Outcome::DataLost })
}

impl Check {
    fn new(name: &str, state: State, found: impl Into<String>, advice: &str) -> Self {
        let advice = (state != State::Ok && !advice.is_empty()).then(|| advice.to_owned());
        Self { name: name.into(), state, found: found.into(), advice }
    }
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    let width = document.checks.iter().map(|check| check.name.chars().count()).max().unwrap_or(0);
    for check in &document.checks {
        let state = match check.state {
            State::Ok => "ok",
            State::Warning => "WARN",
            State::Bad => "MEND",
            State::Unknown => "?",
        };
        let _ = writeln!(text, "{state:<5} {:<width$} {}", check.name, check.found);
        if let Some(advice) = &check.advice {
            let _ = writeln!(text, "{:indent$} -> {advice}", "", indent = width + 6);
        }
    }
    let count = |state: State| document.checks.iter().filter(|check| check.state == state).count();
    let _ = match document.verdict {
        "ready" => writeln!(text, "ready; {} to look at", count(State::Warning)),
        _ => writeln!(text, "{} to mend, {} to look at", count(State::Bad), count(State::Warning)),
    };
    text
}
