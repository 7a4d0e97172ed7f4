//! One file per verb: what was typed becomes what it means, errors end here.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{ArgAction, ArgMatches, Parser, Subcommand};

use crate::live::config::Config;

/// Ends a verb with a senseless command line, in words as for `format!`: exit code 2.
macro_rules! refuse {
    ($($words:tt)*) => {
        return Err($crate::commands::wrong_usage(format!($($words)*)))
    };
}

mod boresight;
mod command_line;
mod compare;
mod context;
mod cut;
mod daemon;
mod decode;
mod defaults;
mod demo;
mod doctor;
mod experiment_args;
pub mod help;
mod init;
mod inspect;
mod manual;
mod mock;
mod mount;
mod odometry;
mod odometry_args;
mod optimize;
mod output;
mod part;
mod predict;
mod ranges;
mod record;
mod recorded_args;
mod replay;
mod rig;
mod rig_args;
mod scene_args;
mod scene_file;
mod sensor;
mod sensor_args;
mod signals;
mod stage;
mod study;
mod trajectory_args;
mod view;

pub use command_line::run_command_line;
use command_line::{fail, verb_of};
pub use context::Context;
use context::as_usage;
pub(crate) use context::{ensure_consistent, wrong_usage};

/// Design, drive and verify rigs of spinning LiDARs.
#[derive(Parser, Debug)]
#[command(
    name = "outrigger",
    version,
    about,
    disable_help_subcommand = true,
    disable_help_flag = true,
    after_help = "Begin with `outrigger demo`; `outrigger VERB --help` explains a verb."
)]
pub struct Cli {
    /// Print help.
    #[arg(short, long, global = true, action = ArgAction::HelpShort)]
    help: Option<bool>,
    /// Print help with every flag, those of experts too.
    #[arg(long, global = true, action = ArgAction::HelpLong)]
    help_all: Option<bool>,
    /// Print what the program is at, step by step, on stderr, and the details of a result.
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    verbose: bool,
    /// Print errors only on stderr: no progress, no notes.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Print one JSON document on stdout and nothing else there.
    #[arg(long, global = true, env = "OUTRIGGER_JSON", value_parser = clap::builder::FalseyValueParser::new())]
    json: bool,
    /// Sensors and defaults of every verb (`outrigger init` writes one); flags and environment win over it.
    #[arg(long, global = true, env = "OUTRIGGER_CONFIG", value_name = "RIG.toml")]
    config: Option<PathBuf>,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// The whole loop on mock devices: optimize, tilt, record over UDP, replay, compare, report.
    Demo(demo::Args),
    /// What this machine and this rig lack, and what to do about it.
    Doctor(doctor::Args),
    /// Write a commented rig.toml.
    Init(init::Args),
    /// Search the mounts that see the most.
    Optimize(Box<optimize::Args>),
    /// A mount one can build and a robot can read: drawing, URDF, tf, OpenSCAD; and extrinsics read back.
    Mount(mount::Args),
    /// What a given mount sees: voxels, surface and score, in a scene, a room or a published experiment.
    Predict(Box<predict::Args>),
    /// Whether a recording covers what was predicted, and how far the mounts are off.
    Compare(compare::Args),
    /// How the sensors sit to each other, from the recording alone: no model of the scene.
    Boresight(boresight::Args),
    /// Where the rig went, from the recording alone: a trajectory where no SLAM is at hand.
    Odometry(odometry::Args),
    /// Packets of a capture to points.
    Decode(decode::Args),
    /// Packets to packets: cut, join, from a bag to a capture and back.
    Cut(cut::Args),
    /// What is in a capture or session: sensors, formats, rates, every kind of loss, and why nothing decodes.
    Inspect(inspect::Args),
    /// Record raw packets of live sensors.
    Record(record::Args),
    /// Sensors, rig and recorder live, with a page to see and steer them by.
    Daemon(daemon::Args),
    /// Look at a recording in the browser.
    View(view::Args),
    /// Send a capture's packets again.
    Replay(replay::Args),
    /// Read and set the servo rig.
    Rig(rig::Args),
    /// Find live sensors, read and set them over their web interfaces.
    Sensor(sensor::Args),
    /// Many searches that together answer a question; the published tables among them.
    Study(study::Args),
    /// Devices to test against, on loopback and ptys.
    Mock(mock::Args),
    /// Print a completion script for a shell.
    #[command(hide = true)]
    Completions(manual::CompletionsArgs),
    /// Print a manual page: the program's, a verb's, or that of a verb within a verb.
    #[command(hide = true)]
    Man(manual::ManualArgs),
}

/// How a verb ended when it did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All done.
    Done,
    /// Finished, but data was lost: exit code 3.
    DataLost,
    /// Ended in order, but a part of the program panicked: exit code 101, as of a panic that nothing catches.
    Defect,
}

impl Cli {
    /// Runs the verb. Exit codes: 0 ok, 1 failed, 2 usage, 3 finished but data was lost.
    fn run(self, config: Option<&'static Config>, typed: &'static ArgMatches) -> ExitCode {
        output::set_loudness(self.verbose, self.quiet);
        let context = Context { json: self.json, config, typed };
        let outcome = match self.verb {
            Verb::Demo(args) => demo::run(&args, context),
            Verb::Doctor(args) => doctor::run(&args, context),
            Verb::Init(args) => init::run(&args, context),
            Verb::Optimize(args) => optimize::run(&args, context),
            Verb::Mount(args) => mount::run(&args, context),
            Verb::Predict(args) => predict::run(&args, context),
            Verb::Compare(args) => compare::run(&args, context),
            Verb::Boresight(args) => boresight::run(&args, context),
            Verb::Odometry(args) => odometry::run(&args, context),
            Verb::Decode(args) => decode::run(&args, context),
            Verb::Cut(args) => cut::run(&args, context),
            Verb::Inspect(args) => inspect::run(&args, context),
            Verb::Record(args) => record::run(&args, context),
            Verb::Daemon(args) => daemon::run(&args, context),
            Verb::View(args) => view::run(&args, context),
            Verb::Replay(args) => replay::run(&args, context),
            Verb::Rig(args) => rig::run(&args, context),
            Verb::Sensor(args) => sensor::run(&args, context),
            Verb::Study(args) => study::run(&args, context),
            Verb::Mock(args) => mock::run(&args, context),
            Verb::Completions(args) => manual::completions(&args),
            Verb::Man(args) => manual::manual(&args),
        };
        match outcome {
            Ok(Outcome::Done) => ExitCode::SUCCESS,
            Ok(Outcome::DataLost) => ExitCode::from(3),
            Ok(Outcome::Defect) => ExitCode::from(101),
            Err(error) => match as_usage(error).downcast::<clap::Error>() {
                Ok(usage) => usage.format(&mut verb_of(typed)).exit(),
                Err(error) => fail(error),
            },
        }
    }
}
