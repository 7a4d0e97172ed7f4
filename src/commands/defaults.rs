//! What `--config rig.toml` says becomes the defaults of the command line: a flag or an environment variable wins.

mod inherit;
mod typed;

use std::any::TypeId;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::{Arg, ArgAction, Command, FromArgMatches as _};

use self::inherit::inherited;
pub(crate) use self::typed::with_origin;
use self::typed::{choices, is_typed, within};
use super::{Cli, Verb, help};
use crate::drive::is_no_path;
use crate::live::config::{Config, ConfigError, Section, Setting};
use crate::recording::assigned_file::AssignedFile;
use crate::recording::walk_text::WalkText;

/// The file that the command line or the environment names.
pub(crate) fn file_named(command: &Command, arguments: &[OsString]) -> Option<PathBuf> {
    // a command line that asks for help or is wrong is dealt with later, with the whole command
    let matches = command.clone().ignore_errors(true).try_get_matches_from(arguments).ok()?;
    let mut level = Some(&matches);
    let mut named = None;
    while let Some(matches) = level {
        named = matches.get_one::<PathBuf>("config").cloned().or(named);
        level = matches.subcommand().map(|(_, within)| within);
    }
    named
}

/// The command with the file's settings as defaults. Where one of several flags is needed, the file may name it, unless
/// another of them is among the arguments.
pub(crate) fn apply(
    mut command: Command,
    config: &Config,
    arguments: &[OsString],
) -> Result<Command, ConfigError> {
    let typed = command.clone().ignore_errors(true).try_get_matches_from(arguments).ok();
    for section in config.sections.iter().cloned().chain(inherited(config)) {
        let mut verb = &mut command;
        for name in &section.verb {
            let known = names(verb.get_subcommands().map(Command::get_name));
            verb = verb.find_subcommand_mut(name).ok_or_else(|| {
                let reason = format!("no verb is called `{}`; known are {known}", section.verb.join(" "));
                wrong(config, section.line, reason)
            })?;
        }
        let typed = typed.as_ref().and_then(|matches| within(matches, &section.verb));
        let choices = choices(verb);
        for setting in &section.settings {
            let id = find(verb, &section, setting, config)?;
            let mine = || choices.iter().filter(|choice| choice.members.contains(&id));
            let alternatives: Vec<&clap::Id> =
                mine().flat_map(|choice| &choice.members).filter(|other| **other != id).collect();
            if let Some(other) = section.settings.iter().find(|other| {
                other.line < setting.line
                    && find(verb, &section, other, config).is_ok_and(|other| alternatives.contains(&&other))
            }) {
                let reason = format!(
                    "`{}` and `{}` of line {} exclude each other",
                    setting.key, other.key, other.line
                );
                return Err(wrong(config, setting.line, reason));
            }
            if typed.is_some_and(|typed| alternatives.iter().any(|other| is_typed(typed, other.as_str()))) {
                continue;
            }
            for choice in mine() {
                let command = std::mem::take(verb);
                *verb = command.mut_group(&choice.group, |group| group.required(false));
            }
            let command = std::mem::take(verb);
            let folder = crate::base::files::folder_of(&config.path);
            *verb = command.mut_arg(id, |arg| with_default(arg, setting, folder));
        }
    }
    Ok(command)
}

/// The arguments of another verb as a file's section sets them: `words` are the verb and what it cannot do without.
pub(crate) fn section<T>(
    config: &Config,
    words: &[&str],
    of_verb: impl FnOnce(Verb) -> Option<T>,
) -> anyhow::Result<T> {
    let words_of: Vec<OsString> =
        std::iter::once("outrigger").chain(words.iter().copied()).map(OsString::from).collect();
    let command = apply(help::command(), config, &words_of)?;
    let matches = command.try_get_matches_from(&words_of);
    let parsed = matches.and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = parsed.map_err(|error| {
        let text = with_origin(error, config).to_string();
        let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
        anyhow::anyhow!("{}: [{}]: {first}", config.path.display(), words[0])
    })?;
    of_verb(cli.verb).ok_or_else(|| anyhow::anyhow!("[{}] is another verb", words[0]))
}

fn find(
    verb: &Command,
    section: &Section,
    setting: &Setting,
    config: &Config,
) -> Result<clap::Id, ConfigError> {
    let long = long_name(&setting.key);
    let settable = || verb.get_arguments().filter(|arg| arg.get_long().is_some() && arg.get_id() != "config");
    let Some(arg) = settable().find(|arg| arg.get_long() == Some(&long)) else {
        let known = names(settable().filter_map(Arg::get_long)).replace('-', "_");
        let known = if known.is_empty() { "it has none".to_owned() } else { format!("known are {known}") };
        let reason = format!("[{}] has no key `{}`; {known}", section.verb.join("."), setting.key);
        return Err(wrong(config, setting.line, reason));
    };
    let flag = matches!(arg.get_action(), ArgAction::SetTrue);
    if flag && !matches!(&setting.values[..], [value] if value == "true" || value == "false") {
        return Err(wrong(config, setting.line, format!("`{}` is true or false", setting.key)));
    }
    if setting.values.len() != 1 && !matches!(arg.get_action(), ArgAction::Append) {
        return Err(wrong(config, setting.line, format!("`{}` is one value, not an array", setting.key)));
    }
    Ok(arg.get_id().clone())
}

fn with_default(arg: Arg, setting: &Setting, folder: &Path) -> Arg {
    let of_type = arg.get_value_parser().type_id();
    let value = |text: &String| match () {
        () if of_type == TypeId::of::<AssignedFile>() => AssignedFile::text_in(text, folder),
        () if of_type == TypeId::of::<WalkText>() => WalkText::text_in(text, folder),
        // a rig's line may be no file: can:can0
        () if of_type == TypeId::of::<PathBuf>() && !is_no_path(text) => folder.join(text).into_os_string(),
        () => OsString::from(text),
    };
    arg.required(false).default_values(setting.values.iter().map(value))
}

/// The flag of an argument that is named as its field is, without dashes before it.
pub(crate) fn long_name(key: &str) -> String {
    key.replace('_', "-")
}

fn names<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let mut names: Vec<_> = names.collect();
    names.sort_unstable();
    names.join(", ")
}

fn wrong(config: &Config, line: usize, reason: String) -> ConfigError {
    ConfigError::Wrong { path: config.path.clone(), line, reason }
}
