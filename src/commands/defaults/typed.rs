//! What was typed, and which flags exclude each other.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

use super::long_name;
use crate::live::config::{Config, Setting};

/// Arguments of which one at most may be given.
pub(super) struct Choice {
    pub(super) group: clap::Id,
    pub(super) members: Vec<clap::Id>,
}

pub(super) fn choices(verb: &Command) -> Vec<Choice> {
    let mut built = verb.clone();
    built.build(); // until then a group does not know the arguments that name it
    let groups = built.get_groups().filter(|group| !(*group).clone().is_multiple());
    let choice = |group: &clap::ArgGroup| Choice {
        group: group.get_id().clone(),
        members: group.get_args().cloned().collect(),
    };
    groups.map(choice).collect()
}

/// Whether an argument is the user's own and not the file's.
pub(super) fn is_typed(matches: &ArgMatches, id: &str) -> bool {
    let source = matches.value_source(id);
    matches!(source, Some(ValueSource::CommandLine | ValueSource::EnvVariable))
}

/// What was typed after a verb.
pub(super) fn within<'a>(matches: &'a ArgMatches, verb: &[String]) -> Option<&'a ArgMatches> {
    verb.iter().try_fold(matches, |matches, name| {
        matches.subcommand().filter(|(named, _)| named == name).map(|(_, within)| within)
    })
}

/// Adds to an error about a value that the value stands in the file.
pub(crate) fn with_origin(mut error: clap::Error, config: &Config) -> clap::Error {
    let text = |kind: ContextKind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    if !matches!(error.kind(), ErrorKind::InvalidValue | ErrorKind::ValueValidation) {
        return error;
    }
    let (Some(arg), Some(value)) = (text(ContextKind::InvalidArg), text(ContextKind::InvalidValue)) else {
        return error;
    };
    let flag = |setting: &Setting| format!("--{}", long_name(&setting.key));
    let origin = config
        .sections
        .iter()
        .flat_map(|section| &section.settings)
        .find(|setting| setting.values.contains(&value) && arg.split(' ').next() == Some(&flag(setting)));
    if let Some(setting) = origin {
        let place = format!("{value}' of {}:{}, '{}", config.path.display(), setting.line, setting.key);
        error.insert(ContextKind::InvalidValue, ContextValue::String(place));
    }
    error
}
