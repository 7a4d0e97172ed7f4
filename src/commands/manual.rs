//! `outrigger completions` and `outrigger man`: the command line described by itself.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Arg, ArgAction, Command, CommandFactory};

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
| `model` | text | `os1-64`, `vlp-16`, ...: `outrigger mock sensor --help` names them |
| `listen` | port or \"address:port\" | where its lidar packets arrive on this host |
| `listen_aside` | port or \"address:port\" | where its IMU packets (Ouster) or position packets (Velodyne) arrive |
| `source` | address | take packets from this address only; needed where two sensors share a port |
| `metadata` | path | of an Ouster, as its web interface gives it |
| `host` | host or \"host:port\" | its web interface; without `metadata`, recording asks it for them |

Every other section is a verb, and every key in it a flag of that verb with `_` for `-`. `[daemon]` takes the keys about the
place (`mount`, `scene`, `room`, `trajectory` and what belongs to them) from `[predict]` where it does not say otherwise.
";

/// Arguments of `completions`.
#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// Which shell.
    shell: clap_complete::Shell,
}

/// Prints a completion script.
pub fn completions(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    let mut script = Vec::new(); // what writes to stdout itself panics where its reader went away
    clap_complete::generate(args.shell, &mut Cli::command(), "outrigger", &mut script);
    output::print_text(&String::from_utf8(script)?)?;
    Ok(Outcome::Done)
}

/// Arguments of `man`.
#[derive(clap::Args, Debug)]
pub struct ManualArgs {
    /// The verb whose page it is; without one the page of the program.
    verb: Option<String>,
    /// Every key of rig.toml instead, as Markdown.
    #[arg(long, conflicts_with = "verb")]
    keys: bool,
    /// Write every page into this folder instead, one file each, for packages.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["verb", "keys"])]
    pages: Option<PathBuf>,
}

/// Prints a manual page in roff: outrigger(1), or outrigger-VERB(1).
pub fn manual(args: &ManualArgs) -> anyhow::Result<Outcome> {
    let mut program = Cli::command();
    if let Some(folder) = &args.pages {
        return pages(program, folder);
    }
    program.build(); // names verbs as they are called
    if args.keys {
        let mut page = OF_SENSORS.to_owned();
        program.get_subcommands().for_each(|verb| keys(verb, "", &mut page));
        output::print_text(&page)?;
        return Ok(Outcome::Done);
    }
    let page = match &args.verb {
        None => program,
        Some(verb) => {
            let verbs: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
            let found = program.find_subcommand(verb);
            found.with_context(|| format!("no verb {verb:?}: there are {}", verbs.join(", ")))?.clone()
        }
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(page).render(&mut text)?;
    output::print_text(&String::from_utf8(text)?)?;
    Ok(Outcome::Done)
}

/// outrigger.1, outrigger-VERB.1 and so on into a folder.
fn pages(program: Command, folder: &Path) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    clap_mangen::generate_to(program, folder)
        .with_context(|| format!("cannot write manual pages to {}", folder.display()))?;
    Ok(Outcome::Done)
}

/// The sections of a verb and of the verbs within it.
fn keys(verb: &Command, above: &str, page: &mut String) {
    let name = format!("{above}{}", verb.get_name());
    let own = |arg: &&Arg| arg.get_long().is_some() && !arg.is_global_set() && !is_meta(arg);
    let args: Vec<&Arg> = verb.get_arguments().filter(own).collect();
    if !args.is_empty() {
        let _ =
            write!(page, "\n## `[{name}]`\n\n| key | value | default | what it is |\n|---|---|---|---|\n");
        args.iter().for_each(|arg| row(arg, page));
    }
    verb.get_subcommands().for_each(|within| keys(within, &format!("{name}."), page));
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
