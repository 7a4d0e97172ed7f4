//! One file per verb: what was typed becomes what it means, errors end here.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Command, FromArgMatches as _, Parser, Subcommand};

use crate::live::config::Config;

/// Ends a verb with a senseless command line, in words as for `format!`: exit code 2.
macro_rules! refuse {
    ($($words:tt)*) => {
        return Err($crate::commands::wrong_usage(format!($($words)*)))
    };
}

mod boresight;
mod compare;
mod cut;
mod daemon;
mod decode;
mod defaults;
mod demo;
mod doctor;
mod experiment_args;
mod found_metadata;
pub mod help;
mod init;
mod inspect;
mod manual;
mod masters;
mod mock;
mod mount;
mod odometry;
mod optimize;
mod output;
mod part;
mod predict;
mod ranges;
mod record;
mod recorded;
mod recorded_odometry;
mod recording;
mod registered;
mod replay;
mod rig;
mod rig_args;
mod scene_args;
mod scene_file;
mod scene_placement;
mod sensor;
mod sensor_args;
mod sensor_ids;
mod sensor_metadata;
mod signals;
mod stage;
mod study;
mod assigned_file;
mod unread;
mod view;

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
    /// Print what the program is at, step by step, on stderr.
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

/// What every verb gets besides its own arguments.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// One JSON document on stdout.
    pub json: bool,
    /// The rig's file, where one is named; it lives as long as the program.
    pub config: Option<&'static Config>,
    typed: &'static ArgMatches,
}

impl Context {
    /// Whether an argument (named as its field is) was typed: a default, also one of the rig's file, was not.
    pub(crate) fn is_typed(&self, argument: &str) -> bool {
        let within = |matches: &&'static ArgMatches| matches.subcommand().map(|(_, within)| within);
        std::iter::successors(Some(self.typed), within).any(|matches| {
            matches.try_contains_id(argument).is_ok()
                && matches.value_source(argument) == Some(ValueSource::CommandLine)
        })
    }

    /// The same for every argument of a flattened structure.
    pub(crate) fn ensure_none_of<A: clap::Args>(&self, why: impl std::fmt::Display) -> anyhow::Result<()> {
        let arguments = A::augment_args(Command::new("arguments"));
        let names: Vec<&str> = arguments.get_arguments().map(|argument| argument.get_id().as_str()).collect();
        self.ensure_not_typed(&names, why)
    }

    /// Refuses arguments (named as their fields are) that were typed and are of no use: `why` goes on after their flag.
    pub(crate) fn ensure_not_typed(
        &self,
        arguments: &[&str],
        why: impl std::fmt::Display,
    ) -> anyhow::Result<()> {
        if let Some(argument) = arguments.iter().find(|argument| self.is_typed(argument)) {
            refuse!("--{} {why}", defaults::long_name(argument));
        }
        Ok(())
    }
}

/// What was typed cannot be meant: exit code 2.
pub(crate) fn wrong_usage(what: impl std::fmt::Display) -> anyhow::Error {
    clap::Error::raw(ErrorKind::ArgumentConflict, what).into()
}

/// The verb that was typed, as its help has it.
fn verb_of(mut typed: &ArgMatches) -> Command {
    let mut command = help::command();
    command.build();
    while let Some((name, within)) = typed.subcommand() {
        let Some(verb) = command.find_subcommand(name).cloned() else { break };
        (command, typed) = (verb, within);
    }
    command
}

/// Parses a command line, with the defaults of its `rig.toml`, and runs it.
pub fn run(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.collect();
    let mut command = help::command();
    let config = match defaults::file_named(&command, &arguments).map(|path| Config::read(&path)).transpose()
    {
        Ok(config) => config.map(|config| &*Box::leak(Box::new(config))),
        Err(error) => return fail(error),
    };
    if let Some(config) = config {
        command = match defaults::apply(command, config, &arguments) {
            Ok(command) => command,
            Err(error) => return fail(error),
        };
    }
    let parsed = command.try_get_matches_from(&arguments).and_then(|matches| {
        let cli = Cli::from_arg_matches(&matches)?;
        Ok((cli, &*Box::leak(Box::new(matches))))
    });
    match (parsed, config) {
        (Ok((cli, typed)), _) => cli.run(config, typed),
        (Err(error), None) => with_ours(error).exit(),
        (Err(error), Some(config)) => with_ours(defaults::with_origin(error, config)).exit(),
    }
}

/// Names the verb or the flag of ours where one of another program was typed.
fn with_ours(mut error: clap::Error) -> clap::Error {
    let (typed, suggestion) = match error.kind() {
        ErrorKind::InvalidSubcommand => (ContextKind::InvalidSubcommand, ContextKind::SuggestedSubcommand),
        ErrorKind::UnknownArgument => (ContextKind::InvalidArg, ContextKind::SuggestedArg),
        _ => return error,
    };
    let Some(ContextValue::String(name)) = error.get(typed) else { return error };
    if let Some(ours) = help::ours(name) {
        error.insert(suggestion, ContextValue::String(ours.into()));
    }
    error
}

fn fail(error: impl Into<anyhow::Error>) -> ExitCode {
    output::say_error(&error.into());
    ExitCode::FAILURE
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
            Err(error) => match error.downcast::<clap::Error>() {
                Ok(usage) => usage.format(&mut verb_of(typed)).exit(),
                Err(error) => fail(error),
            },
        }
    }
}
