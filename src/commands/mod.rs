//! One file per verb: what was typed becomes what it means, errors end here.

use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod compare;
mod decode;
mod demo;
mod evaluate;
mod inspect;
mod manual;
mod mock;
mod optimize;
mod output;
mod predict;
mod record;
mod recording;
mod replay;
mod rig;
mod sensor_ids;
mod signals;
mod unread;
mod validate;

/// Design, drive and verify rigs of spinning LiDARs.
#[derive(Parser, Debug)]
#[command(name = "outrigger", version, about, disable_help_subcommand = true)]
pub struct Cli {
    /// Print one JSON document on stdout and nothing else there.
    #[arg(long, global = true, env = "OUTRIGGER_JSON")]
    json: bool,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// The whole loop on mock devices: optimize, tilt, record over UDP, replay, compare, report.
    Demo(demo::Args),
    /// Search the mounts that see the most.
    Optimize(optimize::Args),
    /// Score given mounts.
    Evaluate(evaluate::Args),
    /// What a mount will cover along a trajectory through a scene.
    Predict(predict::Args),
    /// Whether a recording covers what was promised, and how far the mounts are off.
    Compare(compare::Args),
    /// Packets of a capture to points.
    Decode(decode::Args),
    /// What is in a capture or session: sensors, formats, rates, every kind of loss, and why nothing decodes.
    Inspect(inspect::Args),
    /// Record raw packets of live sensors.
    Record(record::Args),
    /// Send a capture's packets again.
    Replay(replay::Args),
    /// How much of a mesh's surface the sensors see along a trajectory.
    Validate(validate::Args),
    /// Read and set the servo rig.
    Rig(rig::Args),
    /// Devices to test against, on loopback and ptys.
    Mock(mock::Args),
    /// Print a completion script for a shell.
    Completions(manual::CompletionsArgs),
    /// Print the manual page.
    Man,
}

/// How a verb ended when it did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All done.
    Done,
    /// Finished, but data was lost: exit code 3.
    DataLost,
}

/// What every verb is told beside its own arguments.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// One JSON document on stdout.
    pub json: bool,
}

impl Cli {
    /// Runs the verb. Exit codes: 0 ok, 1 failed, 2 usage (by the argument parser), 3 finished but data was lost.
    pub fn run(self) -> ExitCode {
        let context = Context { json: self.json };
        let outcome = match self.verb {
            Verb::Demo(args) => demo::run(&args, context),
            Verb::Optimize(args) => optimize::run(&args, context),
            Verb::Evaluate(args) => evaluate::run(&args, context),
            Verb::Predict(args) => predict::run(&args, context),
            Verb::Compare(args) => compare::run(&args, context),
            Verb::Decode(args) => decode::run(&args, context),
            Verb::Inspect(args) => inspect::run(&args, context),
            Verb::Record(args) => record::run(&args, context),
            Verb::Replay(args) => replay::run(&args, context),
            Verb::Validate(args) => validate::run(&args, context),
            Verb::Rig(args) => rig::run(&args, context),
            Verb::Mock(args) => mock::run(&args, context),
            Verb::Completions(args) => manual::completions(&args),
            Verb::Man => manual::manual(),
        };
        match outcome {
            Ok(Outcome::Done) => ExitCode::SUCCESS,
            Ok(Outcome::DataLost) => ExitCode::from(3),
            Err(error) => {
                output::say_error(&error);
                ExitCode::FAILURE
            }
        }
    }
}
