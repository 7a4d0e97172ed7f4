//! `outrigger doctor`: what this machine and this rig lack, and what to do about it.

mod slots;

use std::path::PathBuf;

use super::defaults::section;
use super::{Context, Outcome, Verb, daemon, output, rig_args};
use crate::drive::Options;
use crate::live::config::Config;
use crate::report::readiness::report;
use crate::verify::readiness::{self, Check, CheckState, ConfiguredSensors, Readiness, Traffic, check_rig};
use slots::check_slots;

/// One pair of limits is for every axis of a rig, and these are their number.
const AXES: usize = 2;

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

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        (0.0..=60.0).contains(&args.listen_for),
        "--listen-for {}, expected 0 to 60 s",
        args.listen_for
    );
    let mut checks = vec![readiness::processors(), readiness::governor(), readiness::clock()];
    let mut sensors = context.config.map(ConfiguredSensors::of).unwrap_or_default();
    if let Some(config) = context.config {
        check_slots(&mut sensors, config);
        if let Err(error) = daemon::check(config, context) {
            sensors.bad("daemon", format!("{error:#}"), "`outrigger daemon` will not start with this");
        }
    }
    checks.extend(sensors.checks);
    let (buffer_mib, listen_for_s) = (args.receive_buffer, args.listen_for);
    let traffic = Traffic::probe(context.config, &sensors.metadata, buffer_mib, listen_for_s);
    checks.extend(traffic.checks);
    checks.extend(readiness::disk(&args.out, traffic.bytes_s, sensors.bytes_s)?);
    if let Some(port) = args.port.as_deref() {
        checks.extend(match context.config.map_or_else(|| Ok(Options::new_session()), options) {
            Ok(options) => check_rig(port, options, &sensors.pitches_deg),
            Err(error) => {
                let name = format!("rig {}", port.display());
                vec![Check::new(&name, CheckState::Bad, format!("{error:#}"), "mend [rig]")]
            }
        });
    }
    let document = Readiness::of(checks);
    output::print_result(context.json, &document, &report(&document), &[])?;
    Ok(if document.is_ready() { Outcome::Done } else { Outcome::DataLost })
}

/// The options of the rig by the section [rig].
fn options(config: &Config) -> anyhow::Result<Options> {
    let args: rig_args::Args = section(config, &["rig", "status"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    rig_args::options(&args, AXES)
}
