//! `outrigger doctor`: what this machine and this rig lack, and what to do about it.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde::Serialize;

use super::{Context, Outcome, output};
use crate::config::{Config, SensorConfig};
use crate::receive::{Listen, Options, Receiver};
use crate::record::free_bytes;
use crate::servo::Rig;
use crate::setup::Sensor;

/// Written to see how fast the disk is.
const TRIED_BYTES: usize = 128 << 20;
const BLOCK_BYTES: usize = 4 << 20;
/// Two OS1-128 with two returns and a VLP-16 send 43 MB a second (the `daemon` bench).
const NEEDED_MB_S: f64 = 50.0;
/// An hour of them.
const NEEDED_FREE_BYTES: u64 = 160 << 30;

/// Arguments of `doctor`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Nothing moves and nothing is changed. With --config every sensor's port is opened and listened on, every `host` is\n\
                  asked how it is, and the rig's port is asked for its state.\n\
                  Exit codes: 0 ready, 1 failed, 3 something must be mended."
)]
pub struct Args {
    /// Where recordings will be written.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Kernel receive buffer that recording will ask for, per port, in MiB; that of [record] in the rig.toml when not given.
    #[arg(long, value_name = "MIB", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    receive_buffer: u16,
    /// How long to listen for the sensors' packets.
    #[arg(long, value_name = "S", default_value_t = 2.0)]
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
    checks.extend(disk(&args.out)?);
    checks.extend(receiving(args, context.config));
    checks.extend(context.config.iter().flat_map(|config| &config.sensors).flat_map(sensor));
    checks.extend(args.port.as_deref().map(rig));
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

fn disk(folder: &Path) -> anyhow::Result<Vec<Check>> {
    let free = free_bytes(folder).with_context(|| folder.display().to_string())?;
    let hours = free as f64 / (NEEDED_MB_S * 1e6 * 3600.0);
    let state = if free > NEEDED_FREE_BYTES { State::Ok } else { State::Warning };
    let found = format!("{} GiB, {hours:.1} hours of two OS1-128 with two returns", free >> 30);
    let room =
        Check::new("disk space", state, found, "the recorder warns when it runs low and keeps what it has");
    let speed = match written_mb_s(folder) {
        Ok(mb_s) => {
            let state = if mb_s > NEEDED_MB_S { State::Ok } else { State::Bad };
            let advice = "a recording of two OS1-128 with two returns needs 43 MB/s: take another disk";
            Check::new("disk speed", state, format!("{mb_s:.0} MB/s to {}", folder.display()), advice)
        }
        Err(error) => {
            Check::new("disk speed", State::Bad, error.to_string(), "recordings cannot be written there")
        }
    };
    Ok(vec![room, speed])
}

/// Speed to the disk itself, not to memory.
fn written_mb_s(folder: &Path) -> std::io::Result<f64> {
    let mut file = tempfile_in(folder)?;
    // what a disk compresses would look faster than packets are
    let mut block = vec![0_u8; BLOCK_BYTES];
    let mut rng = crate::rng::Rng::new(1, 0);
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

/// Opens what recording will open, and listens.
fn receiving(args: &Args, config: Option<&Config>) -> Vec<Check> {
    let configured: Vec<Listen> = config
        .iter()
        .flat_map(|config| &config.sensors)
        .flat_map(SensorConfig::streams)
        .map(|stream| stream.listen)
        .collect();
    let any = Listen { name: "any".into(), address: ([127, 0, 0, 1], 0).into(), source: None };
    let is_configured = !configured.is_empty();
    let listens = if is_configured { configured } else { vec![any] };
    let options =
        Options { receive_buffer_bytes: usize::from(args.receive_buffer) << 20, ..Options::default() };
    let receiver = match Receiver::start(&listens, options) {
        Ok(receiver) => receiver,
        Err(error) => {
            return vec![Check::new("ports", State::Bad, format!("{:#}", anyhow::Error::from(error)), "")];
        }
    };
    let mut checks = Vec::new();
    let warnings: Vec<String> =
        receiver.monitor().sockets().iter().filter_map(|socket| socket.buffer_warning()).collect();
    checks.push(match warnings.first() {
        None => Check::new("receive buffer", State::Ok, format!("{} MiB granted", args.receive_buffer), ""),
        Some(warning) => Check::new(
            "receive buffer",
            State::Bad,
            warning.clone(),
            "for good: a line in /etc/sysctl.d/, as the package brings",
        ),
    });
    if !is_configured {
        return checks;
    }
    std::thread::sleep(Duration::from_secs_f64(args.listen_for));
    for (listen, counters) in listens.iter().zip(receiver.monitor().sensors()) {
        let rate = counters.packets as f64 / args.listen_for.max(1e-3);
        let found = format!("{} packets in {} s ({rate:.0} a second)", counters.packets, args.listen_for);
        let state = if counters.packets > 0 { State::Ok } else { State::Warning };
        let advice = format!(
            "nothing came to {}: is it powered and told to send here (`outrigger sensor info HOST`), and does no firewall stand between?",
            listen.address
        );
        checks.push(Check::new(&format!("packets of {}", listen.name), state, found, &advice));
    }
    checks
}

/// What a sensor says of itself.
fn sensor(config: &SensorConfig) -> Vec<Check> {
    let Some(host) = &config.host else { return Vec::new() };
    let name = format!("sensor {}", config.name);
    let state = Sensor::at(host).and_then(|sensor| sensor.read());
    match state {
        Err(error) => {
            let advice = "`outrigger sensor discover` finds sensors on this network";
            vec![Check::new(&name, State::Bad, format!("{:#}", anyhow::Error::from(error)), advice)]
        }
        Ok(state) => {
            let found =
                format!("{} {} firmware {}, {}", state.model, state.serial, state.firmware, state.status);
            let mut checks = vec![Check::new(&name, State::Ok, found, "")];
            let ailing = |warning: crate::setup::Warning| {
                Check::new(
                    &name,
                    State::Warning,
                    warning.text,
                    "`outrigger sensor configure` sets what it can",
                )
            };
            checks.extend(state.warnings.into_iter().map(ailing));
            checks
        }
    }
}

fn rig(port: &Path) -> Check {
    let name = format!("rig {}", port.display());
    let status = match Rig::connect(port).and_then(|rig| rig.status()) {
        Ok(status) => status,
        Err(error) => {
            let advice = "is it plugged in and powered; may you open it (group dialout, or the udev rule)?";
            return Check::new(&name, State::Bad, format!("{:#}", anyhow::Error::from(error)), advice);
        }
    };
    let faults: Vec<String> = status
        .axes
        .iter()
        .filter(|axis| !axis.faults.is_empty())
        .map(|axis| format!("axis {}: {}", axis.axis, axis.faults.join(", ")))
        .collect();
    let found = format!("{} axes, firmware {}", status.axes.len(), status.firmware);
    if !faults.is_empty() {
        let found = format!("{found}; {}", faults.join("; "));
        return Check::new(&name, State::Bad, found, "mend the cause, then `outrigger rig clear`");
    }
    if status.axes.iter().any(|axis| !axis.homed) {
        return Check::new(
            &name,
            State::Warning,
            format!("{found}, not homed"),
            "`outrigger rig home --arm` before the first move",
        );
    }
    Check::new(&name, State::Ok, format!("{found}, homed"), "")
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
