//! `outrigger sensor`: live sensors over their web interfaces.

use clap::Subcommand;

use super::{Context, Outcome};

mod configure;
mod discover;
mod info;
mod settings;

/// Arguments of `sensor`.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand, Debug)]
enum Action {
    /// Which sensors are on the network.
    Discover(discover::Args),
    /// What a sensor is, how it is set, and its faults.
    Info(info::Args),
    /// Set a sensor up, read back what it took, save it.
    Configure(configure::Args),
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    match &args.action {
        Action::Discover(args) => discover::run(args, context),
        Action::Info(args) => info::run(args, context),
        Action::Configure(args) => configure::run(args, context),
    }
}
