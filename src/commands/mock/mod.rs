//! `outrigger mock`: devices to test against, on loopback and ptys.

use clap::Subcommand;

use super::{Context, Outcome};

mod rig;
mod sensor;
mod web;

/// Arguments of `mock`.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    device: Device,
}

#[derive(Subcommand, Debug)]
enum Device {
    /// A sensor that sends UDP packets; it keeps the pitch of its mount file, whatever a mock rig does.
    Sensor(Box<sensor::Args>),
    /// A servo rig behind a pseudo terminal.
    Rig(rig::Args),
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    match &args.device {
        Device::Sensor(args) => sensor::run(args, context),
        Device::Rig(args) => rig::run(args, context),
    }
}
