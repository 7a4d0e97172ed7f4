//! From a command line to a verb that runs.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, Command, FromArgMatches as _};

use super::{Cli, defaults, help, output};
use crate::live::config::Config;

/// The verb that was typed, as its help has it.
pub(super) fn verb_of(mut typed: &ArgMatches) -> Command {
    let mut command = help::command();
    command.build();
    while let Some((name, within)) = typed.subcommand() {
        let Some(verb) = command.find_subcommand(name).cloned() else { break };
        (command, typed) = (verb, within);
    }
    command
}

/// Parses a command line, with the defaults of its `rig.toml`, and runs it.
pub fn run_command_line(arguments: impl Iterator<Item = OsString>) -> ExitCode {
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

pub(super) fn fail(error: impl Into<anyhow::Error>) -> ExitCode {
    output::say_error(&error.into());
    ExitCode::FAILURE
}
