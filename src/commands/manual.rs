//! `outrigger completions` and `outrigger man`: the command line described by itself.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Arg, ArgAction, Command, CommandFactory};
use sensors::catalogue;

use super::{Cli, Outcome, output};

/// Before the keys of the verbs.
const OF_SENSORS: &str = "\
# Every key of rig.toml

Printed by `outrigger man --keys`. `outrigger init` writes a commented file to begin with; `--config rig.toml` or the
environment's `OUTRIGGER_CONFIG` names it. A flag on the command line wins over an environment variable, and that over the
file. Paths are relative to the file. A key that is not known here is an error that names its line.

`format = \"outrigger-rig/1\"` comes first.

## `[[sensor]]`

Once per LiDAR.

| key | value | what it is |
|---|---|---|
| `name` | text | letters, digits, `.`, `_`, `-`; unique |
| `model` | text | one of {models} |
| `listen` | port or \"address:port\" | where its lidar packets arrive on this host |
| `listen_aside` | port or \"address:port\" | where its IMU packets (Ouster) or position packets (Velodyne) arrive |
| `source` | address | take packets from this address only; needed where two sensors share a port |
| `metadata` | path | of an Ouster, as its web interface gives it |
| `host` | host or \"host:port\" | its web interface; without `metadata`, recording asks it for them |

Every other section is a verb, and every key in it a flag of that verb with `_` for `-`. An array gives a flag several times:
`limits_deg = [[-50, 50], [-30, 30]]` is `--limits-deg=-50,50 --limits-deg=-30,30`. `[daemon]` takes the keys about the
place (`mount`, `scene`, `room`, `trajectory` and what belongs to them) from `[predict]` where it does not say otherwise,
everything about servos from `[rig]`, and from `[rig.apply]` which `sensors` sit on axis 0, 1, ...
";

/// Arguments of `completions`.
#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// Which shell.
    shell: clap_complete::Shell,
}

/// Prints a completion script.
pub(crate) fn completions(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    let mut script = Vec::new(); // what writes to stdout itself panics where its reader went away
    clap_complete::generate(args.shell, &mut Cli::command(), "outrigger", &mut script);
    output::print_text(&String::from_utf8(script)?)?;
    Ok(Outcome::Done)
}

/// Arguments of `man`.
#[derive(clap::Args, Debug)]
pub struct ManualArgs {
    /// The verb whose page it is, a verb within a verb behind it (`rig apply`, or `rig-apply`); without one the page of the
    /// program.
    #[arg(value_name = "VERB")]
    verbs: Vec<String>,
    /// Every key of rig.toml instead, as Markdown.
    #[arg(long, conflicts_with = "verbs")]
    keys: bool,
    /// Write every page into this folder instead, one file each, for packages.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["verbs", "keys"])]
    pages: Option<PathBuf>,
}

/// Prints a manual page in roff: outrigger(1), or outrigger-VERB(1).
pub(crate) fn manual(args: &ManualArgs) -> anyhow::Result<Outcome> {
    let mut program = Cli::command();
    if let Some(folder) = &args.pages {
        return pages(program, folder);
    }
    program.build(); // names verbs as they are called
    if args.keys {
        let models: Vec<String> = catalogue::names().iter().map(|name| format!("`{name}`")).collect();
        let mut page = OF_SENSORS.replace("{models}", &models.join(", "));
        program.get_subcommands().for_each(|verb| keys(verb, "", &[], &mut page));
        output::print_text(&page)?;
        return Ok(Outcome::Done);
    }
    let page = page_of(&program, &args.verbs.join("-").replace(' ', "-"))?.clone();
    let mut text = Vec::new();
    clap_mangen::Man::new(page).render(&mut text)?;
    output::print_text(&String::from_utf8(text)?)?;
    Ok(Outcome::Done)
}

/// The verb of a page; a page names those of the verbs within a verb with a dash: outrigger-rig-apply(1).
fn page_of<'a>(above: &'a Command, name: &str) -> anyhow::Result<&'a Command> {
    if name.is_empty() {
        return Ok(above);
    }
    let within = above.get_subcommands().find_map(|verb| match name.strip_prefix(verb.get_name())? {
        "" => Some((verb, "")),
        rest => Some((verb, rest.strip_prefix('-')?)),
    });
    let (verb, rest) = within.ok_or_else(|| {
        let known: Vec<&str> = above.get_subcommands().map(Command::get_name).collect();
        crate::commands::wrong_usage(match &known[..] {
            [] => format!("no verb {name:?} within {}: it has none", above.get_name()),
            known => format!("no verb {name:?}: there are {}", known.join(", ")),
        })
    })?;
    page_of(verb, rest)
}

/// outrigger.1, outrigger-VERB.1 and so on into a folder.
fn pages(program: Command, folder: &Path) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    clap_mangen::generate_to(program, folder)
        .with_context(|| format!("cannot write manual pages to {}", folder.display()))?;
    Ok(Outcome::Done)
}

/// The sections of a verb and of the verbs within it, to which the keys of those above are handed down.
fn keys(verb: &Command, above: &str, handed_down: &[&str], page: &mut String) {
    let name = format!("{above}{}", verb.get_name());
    let own = |arg: &&Arg| {
        arg.get_long().is_some() && !is_meta(arg) && !handed_down.contains(&arg.get_id().as_str())
    };
    let args: Vec<&Arg> = verb.get_arguments().filter(own).collect();
    if !args.is_empty() {
        let _ =
            write!(page, "\n## `[{name}]`\n\n| key | value | default | what it is |\n|---|---|---|---|\n");
        args.iter().for_each(|arg| row(arg, page));
    }
    let global = args.iter().filter(|arg| arg.is_global_set()).map(|arg| arg.get_id().as_str());
    let handed_down: Vec<&str> = handed_down.iter().copied().chain(global).collect();
    verb.get_subcommands().for_each(|within| keys(within, &format!("{name}."), &handed_down, page));
}

fn is_meta(arg: &Arg) -> bool {
    matches!(
        arg.get_action(),
        ArgAction::Help | ArgAction::Version | ArgAction::HelpLong | ArgAction::HelpShort
    ) || ["help", "config", "json"].contains(&arg.get_id().as_str())
}

fn row(arg: &Arg, page: &mut String) {
    let plain = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|");
    let key = arg.get_long().unwrap_or_default().replace('-', "_");
    let possible: Vec<String> = arg
        .get_possible_values()
        .iter()
        .filter(|value| !value.is_hide_set())
        .map(|value| value.get_name().to_owned())
        .collect();
    let value = match arg.get_action() {
        ArgAction::SetTrue => "true, false".to_owned(),
        _ if !possible.is_empty() => possible.join(", "),
        _ => arg
            .get_value_names()
            .unwrap_or_default()
            .iter()
            .map(|name| name.to_string())
            .collect::<Vec<_>>()
            .join(" "),
    };
    let value = if matches!(arg.get_action(), ArgAction::Append) {
        format!("{value}, or an array of them")
    } else {
        value
    };
    let default: Vec<String> =
        arg.get_default_values().iter().map(|value| format!("`{}`", value.to_string_lossy())).collect();
    let default =
        if matches!(arg.get_action(), ArgAction::SetTrue) { String::new() } else { default.join(", ") };
    let help = arg.get_help().map(|help| plain(&help.to_string())).unwrap_or_default();
    let _ = writeln!(page, "| `{key}` | {} | {} | {help} |", plain(&value), plain(&default));
}
