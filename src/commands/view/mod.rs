//! `outrigger view`: a recording in the browser.

#[cfg(feature = "daemon")]
mod heading;
#[cfg(feature = "daemon")]
mod play;
#[cfg(feature = "daemon")]
mod reels;

use std::net::SocketAddr;
use std::path::PathBuf;

use super::scene_args::MeshArgs;
use super::scene_file::MapArgs;
use super::sensor_args::SensorArgs;

/// Arguments of `view`.
#[derive(clap::Args, Debug)]
#[command(after_help = "The page is served on loopback until Ctrl-C. `?` on it lists the keys.")]
pub struct Args {
    /// Capture (pcap or pcapng, plain or gzip), session folder, or - for standard input.
    recording: PathBuf,
    #[command(flatten)]
    sensors: SensorArgs,
    /// Where the sensors sit; without it the session's own.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Where the rig was (TUM): shows points in the world, each at its own time. Without it the session's own.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// What lies under the points in the world: a mesh, a cloud or an earlier session.
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Address to serve on.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", value_parser = loopback)]
    listen: SocketAddr,
    /// Print the address and do not start a browser.
    #[arg(long)]
    no_open: bool,
}

#[cfg(feature = "daemon")]
pub(crate) use play::run;

/// Says what this build lacks.
#[cfg(not(feature = "daemon"))]
pub(crate) fn run(_: &Args, _: super::Context) -> anyhow::Result<super::Outcome> {
    anyhow::bail!("{}", crate::base::features::left_out("the viewer", "daemon"))
}

fn loopback(text: &str) -> Result<SocketAddr, String> {
    match text.parse::<SocketAddr>() {
        Ok(address) if address.ip().is_loopback() => Ok(address),
        Ok(_) => Err("expected an address of this host (127.0.0.1): the page has no password".into()),
        Err(error) => Err(error.to_string()),
    }
}
