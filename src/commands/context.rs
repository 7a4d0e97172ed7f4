//! What every verb knows of the command line as a whole.

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

use super::defaults;
use crate::design::scene_search::SceneStateError;
use crate::live::config::Config;
use crate::mock::replay::ReplayError;
use crate::recording::RecordingError;
use crate::recording::cutting::CuttingError;
use crate::recording::decoding::DecodingError;
use crate::recording::scene::SceneError;
use crate::verify::walk::WalkError;

/// What every verb gets besides its own arguments.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// One JSON document on stdout.
    pub json: bool,
    /// The rig's file, where one is named; it lives as long as the program.
    pub config: Option<&'static Config>,
    pub(super) typed: &'static ArgMatches,
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

/// An error of a library about what was asked for becomes one of the command line: exit code 2.
pub(super) fn as_usage(error: anyhow::Error) -> anyhow::Error {
    let is_usage = error.downcast_ref().is_some_and(RecordingError::is_usage)
        || error.downcast_ref().is_some_and(DecodingError::is_usage)
        || error.downcast_ref().is_some_and(SceneStateError::is_usage)
        || error.downcast_ref().is_some_and(ReplayError::is_usage)
        || error.downcast_ref().is_some_and(CuttingError::is_usage)
        || error.downcast_ref().is_some_and(WalkError::is_usage)
        || error.downcast_ref().is_some_and(SceneError::is_usage);
    if is_usage { wrong_usage(error) } else { error }
}

/// Refuses what was asked for where it contradicts itself, in the words of the first rule that is broken: exit code 2.
pub(crate) fn ensure_consistent<const N: usize>(rules: [(bool, String); N]) -> anyhow::Result<()> {
    let broken = rules.into_iter().find(|(is_broken, _)| *is_broken);
    broken.map_or(Ok(()), |(_, words)| Err(wrong_usage(words)))
}

/// What was typed cannot be meant: exit code 2.
pub(crate) fn wrong_usage(what: impl std::fmt::Display) -> anyhow::Error {
    clap::Error::raw(ErrorKind::ArgumentConflict, what).into()
}
