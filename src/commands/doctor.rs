//! `outrigger doctor`: what this machine and this rig lack, and what to do about it.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::Context as _;
use serde::Serialize;

use super::defaults::section;
use super::{Context, Outcome, Verb, output};
use crate::drive::{LinkError, Options, Rig, RigError, RigStatus};
use crate::live::config::Config;
use crate::recording::free_bytes;

mod hearing;
mod named;

/// Written to see how fast the disk is.
const TRIED_BYTES: usize = 128 << 20;
const BLOCK_BYTES: usize = 4 << 20;
/// Two OS1-128 with two returns and a VLP-16 send 43 MB a second (the `daemon` bench).
const GREAT_RIG_MB_S: f64 = 43.0;
/// One pair of limits is for every axis of a rig, and these are their number.
const AXES: usize = 2;
/// What a disk must do for each byte that comes.
const SPARE: f64 = 1.2;

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
    let mut checks = vec![processors(), governor(), clock()];
    let named = context.config.map(|config| named::look(config, context)).unwrap_or_default();
    checks.extend(named.checks);
    let heard = hearing::look(args, context.config, &named.metadata);
    checks.extend(heard.checks);
    checks.extend(disk(&args.out, heard.bytes_s, named.bytes_s)?);
    if let Some(port) = args.port.as_deref() {
        checks.extend(rig(port, context.config, &named.pitches_deg));
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

fn processors() -> Check {
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    let state = if count > 1 { State::Ok } else { State::Warning };
    Check::new("processors", state, count.to_string(), "receiving and decoding want a core each")
}

fn governor() -> Check {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    match fs::read_to_string(path) {
        Ok(name) => {
            let state = if name.trim() == "powersave" { State::Warning } else { State::Ok };
            Check::new(
                "cpu governor",
                state,
                name.trim(),
                "`cpupower frequency-set -g performance` while recording",
            )
        }
        Err(_) => Check::new("cpu governor", State::Ok, "none", ""),
    }
}

/// Whether the host's own clock follows another; host times tell sensors and servos apart otherwise by chance.
fn clock() -> Check {
    let said = Command::new("timedatectl").args(["show", "-p", "NTPSynchronized", "--value"]).output();
    let said = said.ok().filter(|said| said.status.success());
    match said.as_ref().map(|said| said.stdout.trim_ascii()) {
        Some(b"yes") => Check::new("host clock", State::Ok, "follows NTP", ""),
        Some(b"no") => Check::new(
            "host clock",
            State::Warning,
            "follows nothing",
            "start systemd-timesyncd or chrony: sensors by PTP or GPS and this host then share one time",
        ),
        _ => Check::new("host clock", State::Unknown, "cannot tell: no timedatectl answers here", ""),
    }
}

/// Space and speed, for what comes now, or else what the configured sensors can send, or else a great rig.
fn disk(
    folder: &Path,
    heard_bytes_s: Option<f64>,
    configured_bytes_s: Option<f64>,
) -> anyhow::Result<Vec<Check>> {
    // recording makes the folder
    let there = folder.ancestors().find(|above| above.is_dir()).unwrap_or(Path::new("."));
    let free = free_bytes(there).with_context(|| there.display().to_string())?;
    let (mb_s, whose) = match (heard_bytes_s, configured_bytes_s) {
        (Some(bytes_s), _) => (bytes_s * 1e-6, "that come now"),
        (None, Some(bytes_s)) => (bytes_s * 1e-6, "that the sensors of the rig.toml can send"),
        (None, None) => (GREAT_RIG_MB_S, "of two OS1-128 with two returns"),
    };
    let hours = free as f64 / (mb_s * 1e6 * 3600.0);
    let state = if hours > 1.0 { State::Ok } else { State::Warning };
    let found = format!("{} GiB, {hours:.1} hours of the {mb_s:.1} MB/s {whose}", free >> 30);
    let room =
        Check::new("disk space", state, found, "the recorder warns when it runs low and keeps what it has");
    let place = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let place = place.display();
    let speed = match written_mb_s(there) {
        Ok(written_mb_s) => {
            let state = if written_mb_s > SPARE * mb_s { State::Ok } else { State::Bad };
            let made = if folder.is_dir() { "" } else { ", which recording will make" };
            let advice = format!("recording needs {mb_s:.0} MB/s and some to spare: take another disk");
            Check::new("disk speed", state, format!("{written_mb_s:.0} MB/s to {place}{made}"), &advice)
        }
        Err(error) => {
            let found = format!("{place}: {error}");
            Check::new("disk speed", State::Bad, found, "recordings cannot be written there")
        }
    };
    Ok(vec![room, speed])
}

/// Speed to the disk itself, not to memory.
fn written_mb_s(folder: &Path) -> std::io::Result<f64> {
    let mut file = tempfile_in(folder)?;
    // what a disk compresses would look faster than packets are
    let mut block = vec![0_u8; BLOCK_BYTES];
    let mut rng = crate::base::rng::Rng::new(1, 0);
    block.chunks_mut(8).for_each(|chunk| chunk.copy_from_slice(&rng.below(u64::MAX).to_le_bytes()));
    let start = Instant::now();
    for _ in 0..TRIED_BYTES / BLOCK_BYTES {
        file.1.write_all(&block)?;
    }
    file.1.sync_all()?;
    Ok(TRIED_BYTES as f64 * 1e-6 / start.elapsed().as_secs_f64())
}

/// A file that goes away with what is returned.
struct Gone(PathBuf);

impl Drop for Gone {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0); // it may never have been made
    }
}

fn tempfile_in(folder: &Path) -> std::io::Result<(Gone, fs::File)> {
    let path = folder.join(format!(".outrigger-doctor-{}", std::process::id()));
    let file = fs::File::create_new(&path)?;
    Ok((Gone(path), file))
}

/// The rig's state, and whether it can go where the mount file says.
fn rig(port: &Path, config: Option<&Config>, pitches_deg: &[f64]) -> Vec<Check> {
    let name = format!("rig {}", port.display());
    let options = match config.map_or_else(|| Ok(Options::new_session()), options) {
        Ok(options) => options,
        Err(error) => return vec![Check::new(&name, State::Bad, format!("{error:#}"), "mend [rig]")],
    };
    let connected = Rig::connect_with(port, options).and_then(|rig| Ok((rig.status()?, rig)));
    let (status, rig) = match connected {
        Ok(connected) => connected,
        Err(error @ RigError::Link(LinkError::InUse { .. })) => {
            let advice = "a daemon that runs has it, and its page shows the rig: end it to look from here";
            return vec![Check::new(&name, State::Warning, error.to_string(), advice)];
        }
        Err(error) => {
            let advice = "is it plugged in and powered; may you open it (group dialout, or the udev rule)?";
            return vec![Check::new(&name, State::Bad, error.to_string(), advice)];
        }
    };
    let mut checks = vec![of_state(&name, &status)];
    let pitches_rad: Vec<f64> = pitches_deg.iter().map(|pitch_deg| pitch_deg.to_radians()).collect();
    let axes = status.axes.len();
    if !pitches_rad.is_empty() && pitches_rad.len() != axes {
        let found = format!("{axes} axes, {} sensors of the mount file for them", pitches_rad.len());
        checks.push(Check::new(
            &name,
            State::Warning,
            found,
            "`sensors` under [rig.apply] says which are on axis 0, 1, ...",
        ));
    } else if !pitches_rad.is_empty()
        && let Err(error) = rig.check(&pitches_rad)
    {
        let found = format!("cannot go where the mount file says: {error}");
        checks.push(Check::new(&name, State::Bad, found, "loosen `limits_deg`, or take another mount"));
    }
    checks
}

fn options(config: &Config) -> anyhow::Result<Options> {
    let args: super::rig::Args = section(config, &["rig", "status"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    super::rig::options(&args, AXES)
}

fn of_state(name: &str, status: &RigStatus) -> Check {
    let faults: Vec<String> = status
        .axes
        .iter()
        .filter(|axis| !axis.faults.is_empty())
        .map(|axis| format!("axis {}: {}", axis.axis, axis.faults.join(", ")))
        .collect();
    let found = format!("{} axes, firmware {}", status.axes.len(), status.firmware);
    if !faults.is_empty() {
        let found = format!("{found}; {}", faults.join("; "));
        return Check::new(name, State::Bad, found, "mend the cause, then `outrigger rig clear`");
    }
    if status.axes.iter().any(|axis| !axis.homed) {
        return Check::new(
            name,
            State::Warning,
            format!("{found}, not homed"),
            "`outrigger rig home --arm` before the first move",
        );
    }
    Check::new(name, State::Ok, format!("{found}, homed"), "")
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    let width = document.checks.iter().map(|check| check.name.chars().count()).max().unwrap_or(0);
    for check in &document.checks {
        let state = match check.state {
            State::Ok => "ok",
            State::Warning => "LOOK",
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
