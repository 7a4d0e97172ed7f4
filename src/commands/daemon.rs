//! `outrigger daemon`: sensors, rig and recorder of a rig.toml, live, with a page.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;

use super::Verb;
use super::defaults::section;
use crate::live::config::Config;

#[cfg(feature = "daemon")]
mod logging;
pub(super) mod site;
#[cfg(feature = "daemon")]
mod serve;
#[cfg(feature = "daemon")]
mod service;
#[cfg(feature = "daemon")]
mod settings;
#[cfg(feature = "daemon")]
mod surroundings;

#[cfg(feature = "daemon")]
pub use serve::run;
use site::SiteArgs;

const AFTER: &str = "\
Sensors, the rig and the prediction come from the same rig.toml: [[sensor]], [rig] (port, limits_deg, ...), [record] \
(receive_buffer) and [predict] (mount, scene or room, trajectory). Prints the address of its page when everything runs. \
Exit codes: 0 ended on request; 3 ended on request, but packets were lost while recording, a session was moved or deleted meanwhile, or a recording ended \
by itself; \
1 it cannot start or go on: a port, the rig or the page's address is another program's; \
101 a defect: a part of it died, and it ended in order.";

/// Arguments of `daemon`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER)]
pub struct Args {
    /// Where the page listens; any address but loopback needs a token.
    #[arg(long, value_name = "ADDRESS:PORT", default_value_t = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8750))]
    listen: SocketAddr,
    /// File with the token that requests must know, at least 16 letters.
    #[arg(long, value_name = "FILE", conflicts_with = "token")]
    token_file: Option<PathBuf>,
    /// The token itself, from the environment: a command line can be read by every user of this machine.
    #[arg(long, env = "OUTRIGGER_DAEMON_TOKEN", hide = true, hide_env_values = true)]
    token: Option<String>,
    /// Name by which this machine is asked for (rover.lan), besides its addresses and localhost; once per name.
    #[arg(long, value_name = "NAME")]
    host_name: Vec<String>,
    /// Site with pages that may connect to /api/v1/foxglove and nothing else (https://app.foxglove.dev); once per site.
    #[arg(long, value_name = "URL")]
    foxglove_origin: Vec<String>,
    /// Folder in which each recording gets a folder.
    #[arg(long, value_name = "DIR", default_value = "sessions")]
    out: PathBuf,
    /// Record from the start on.
    #[arg(long)]
    record: bool,
    /// Go on in a new session when packets fill so many MiB.
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..))]
    rotate_mib: Option<u64>,
    /// Go on in a new session after so many minutes.
    #[arg(long, value_name = "MIN", value_parser = parse_minutes)]
    rotate_minutes: Option<Duration>,
    /// Warn when less is free where sessions go, MiB.
    #[arg(long, value_name = "MIB", default_value_t = 2048)]
    warn_below_mib: u64,
    /// End recording in good order when less is free, MiB.
    #[arg(long, value_name = "MIB", default_value_t = 256)]
    stop_below_mib: u64,
    /// Every write takes so many milliseconds more: a slow disk, to be tested with.
    #[arg(long, value_name = "MS", default_value_t = 0, hide = true)]
    hold_up_writes_ms: u64,
    /// The part of the daemon with this name panics after two seconds, to be tested with.
    #[arg(long, value_name = "COMPONENT", hide = true)]
    break_component: Option<String>,
    /// Disarm the rig when no command came for so many minutes.
    #[arg(long, value_name = "MIN", default_value = "10", value_parser = parse_minutes)]
    disarm_minutes: Duration,
    #[command(flatten)]
    site: SiteArgs,
    /// How the log is written to stderr.
    #[arg(long, value_name = "FORMAT", default_value = "text")]
    log_format: LogFormat,
    /// Least severe lines of the log: error, warn, info, debug or trace.
    #[arg(long, value_name = "LEVEL", default_value = "info", env = "OUTRIGGER_LOG")]
    log_level: tracing::level_filters::LevelFilter,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum LogFormat {
    Text,
    Json,
}

/// Whether a rig.toml's [daemon] can be read, and what it names of the site.
pub(super) fn check(config: &Config, context: super::Context) -> anyhow::Result<()> {
    let args: Args = section(config, &["daemon"], |verb| match verb {
        Verb::Daemon(args) => Some(args),
        _ => None,
    })?;
    #[cfg(feature = "daemon")]
    surroundings::read_site(&args.site, &super::rig_args::axes_of(config)?, context)?;
    drop((args, context));
    Ok(())
}

fn parse_minutes(text: &str) -> Result<Duration, String> {
    super::ranges::within(1e-6, 1e7)(text).map(|minutes| Duration::from_secs_f64(60.0 * minutes))
}

/// Says that the daemon was left out: its flags are known all the same, as one rig.toml serves every build.
#[cfg(not(feature = "daemon"))]
pub fn run(_: &Args, _: super::Context) -> anyhow::Result<super::Outcome> {
    anyhow::bail!("{}", crate::base::features::left_out("the daemon", "daemon"))
}
