//! `outrigger sensor info`: everything that a sensor says of itself.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use serde_json::json;

use crate::base::files;
use crate::commands::{Context, Outcome, ensure_consistent, output};
use crate::live::setup::{Sensor, SensorState, warnings};
use crate::live::watch::read_metadata;
use crate::report::Report;

/// Arguments of `sensor info`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Exit codes: 0 done; 3 the sensor is not as --meta says; 1 failed.")]
pub struct Args {
    /// Addresses of sensors; those of the rig.toml when not given.
    #[arg(value_name = "HOST[:PORT]")]
    hosts: Vec<String>,
    /// Write the metadata of an Ouster to this file.
    #[arg(long, value_name = "FILE")]
    save_metadata: Option<PathBuf>,
    /// Compare the sensor with these metadata, which a recording is, or was, made with: unit, format, mode, windows, beams.
    #[arg(long, value_name = "META.json")]
    meta: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let hosts = hosts(&args.hosts, context)?;
    let is_of_one = args.save_metadata.is_some() || args.meta.is_some();
    let words = format!("--save-metadata and --meta are for one sensor; {} were given", hosts.len());
    ensure_consistent([(hosts.len() > 1 && is_of_one, words)])?;
    let recorded = args.meta.as_deref().map(read_metadata).transpose()?;
    let mut agrees = None;
    let mut states = Vec::new();
    for host in &hosts {
        let mut state = Sensor::at(host)?.read()?;
        if let Some(recorded) = &recorded {
            let Some(metadata) = &state.metadata else { bail!("{host}: it has no metadata to compare with") };
            let differences = warnings::of_metadata(metadata, recorded)?;
            agrees = Some(differences.is_empty());
            state.warnings.extend(differences);
        }
        if let Some(path) = &args.save_metadata {
            let Some(metadata) = &state.metadata else { bail!("{host}: it has no metadata") };
            sensors::ouster::Metadata::parse(metadata, host)?;
            files::write_whole(path, metadata.as_bytes()).with_context(|| path.display().to_string())?;
        }
        states.push(state);
    }
    let mut report = Report::new("Sensors", "");
    states.iter().for_each(|state| append_to(&mut report, state));
    let verdict = if agrees == Some(true) { "agrees with" } else { "differs from" };
    report.figures(args.meta.iter().map(|path| (verdict, path.display().to_string())));
    report.figures(args.save_metadata.iter().map(|path| ("metadata in", path.display().to_string())));
    let document = json!({ "sensors": states, "agrees": agrees });
    output::print_result(context.json, &document, &report, &[])?;
    Ok(if agrees == Some(false) { Outcome::DataLost } else { Outcome::Done })
}

/// The hosts that were typed; otherwise those of the rig's file.
fn hosts(typed: &[String], context: Context) -> anyhow::Result<Vec<String>> {
    if !typed.is_empty() {
        return Ok(typed.to_vec());
    }
    let Some(config) = context.config else {
        refuse!("which sensor? give its address, or --config RIG.toml")
    };
    let hosts: Vec<String> = config.sensors.iter().filter_map(|sensor| sensor.host.clone()).collect();
    if hosts.is_empty() {
        bail!("{}: no [[sensor]] has a `host`", config.path.display());
    }
    Ok(hosts)
}

/// A section about a sensor.
pub(super) fn append_to(report: &mut Report, state: &SensorState) {
    let port = |port: Option<u16>| port.map_or("unsaid".to_owned(), |port| port.to_string());
    let to = &state.destination;
    let host = if to.host.is_empty() { "no host" } else { &to.host };
    let locked = match state.clock.locked {
        Some(true) => "locked",
        Some(false) => "NOT LOCKED",
        None => "nothing to lock to",
    };
    let warm = state.temperature_c.map_or(String::new(), |inside_c| format!(", {inside_c:.0} °C inside"));
    let SensorState { address, model, serial, firmware, status, clock, .. } = state;
    report.heading(&format!("{address}: {model} serial {serial}, firmware {firmware}"));
    report.figure("status", format!("{status}{warm}"));
    let (lidar, auxiliary) = (port(to.port), port(to.auxiliary_port));
    report.figure("sends to", format!("{host}, lidar port {lidar}, auxiliary port {auxiliary}"));
    report.figure("clock", format!("{} ({}), {locked}", clock.source, clock.detail));
    report.figures(
        state.warnings.iter().map(|warning| ("WARNING", format!("{}: {}", warning.kind, warning.text))),
    );
}

/// A time above zero, seconds.
pub(super) fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (0.01..=3600.0).contains(seconds));
    seconds.ok_or_else(|| format!("{text:?}: expected seconds, from 0.01 to 3600"))
}
