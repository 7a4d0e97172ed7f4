//! Every key of rig.toml, from the flags of the verbs.

use std::fmt::Write as _;

use clap::{Arg, ArgAction, Command};
use sensors::catalogue;

/// Before the keys of the verbs.
const OF_SENSORS: &str = "\
# Every key of rig.toml

Printed by `outrigger man --keys`. `outrigger init` writes a commented file, `outrigger init --from RECORDING` one with the sensors of
a recording. `--config rig.toml` or `OUTRIGGER_CONFIG` names the file. A flag overrides the environment, which overrides the file.
Paths are relative to the file. An unknown key is an error. `format = \"outrigger-rig/1\"` comes first.

## `[[sensor]]`

Once per LiDAR.

- `name`: letters, digits, `.`, `_`, `-`; unique
- `model`: one of {models}
- `listen`: port or \"address:port\" where its lidar packets arrive on this host
- `listen_aside`: the same for IMU packets (Ouster) or position packets (Velodyne)
- `source`: take packets from this address only; needed where two sensors share a port
- `metadata`: metadata file of an Ouster, as its web interface gives it
- `host`: host or \"host:port\" of its web interface; without `metadata`, recording asks it for them

## Sections of verbs

Every other section is a verb, and every key in it a flag of that verb with `_` for `-`. An array gives a flag several times:
`limits_deg = [[-50, 50], [-30, 30]]` is `--limits-deg=-50,50 --limits-deg=-30,30`. `outrigger VERB --help` explains the flags,
`outrigger VERB --help-all` those of experts, which are keys, too. `[daemon]` inherits `mount`, `scene`, `room`, `trajectory` and their
settings from `[predict]`, everything about servos from `[rig]`, and the order of `sensors` from `[rig.apply]`.
";

/// Sections that describe a rig rather than a run: their keys are explained on the page.
const OF_A_RIG: [&str; 4] = ["record", "daemon", "rig", "rig.apply"];

pub(super) fn page(program: &Command) -> String {
    let models: Vec<String> = catalogue::decoded_names().iter().map(|name| format!("`{name}`")).collect();
    let mut page = OF_SENSORS.replace("{models}", &models.join(", "));
    let (mut explained, mut named) = (String::new(), String::new());
    for verb in program.get_subcommands().filter(|verb| !verb.is_hide_set()) {
        keys(verb, "", &[], (&mut explained, &mut named));
    }
    page += &explained;
    page += "\n## Other sections\n\n";
    page + &named
}

/// The sections of a verb and of the verbs within it, to which the keys of those above are handed down.
fn keys(verb: &Command, above: &str, handed_down: &[&str], (explained, named): (&mut String, &mut String)) {
    let name = format!("{above}{}", verb.get_name());
    let own = |arg: &&Arg| {
        let is_shown = arg.get_long().is_some() && !arg.is_hide_set() && !arg.is_hide_short_help_set();
        is_shown && !is_of_the_program(arg) && !handed_down.contains(&arg.get_id().as_str())
    };
    let args: Vec<&Arg> = verb.get_arguments().filter(own).collect();
    if OF_A_RIG.contains(&name.as_str()) {
        let _ = write!(explained, "\n## `[{name}]`\n\n");
        args.iter().for_each(|arg| line(arg, explained));
    } else if !args.is_empty() {
        let keys: Vec<String> = args.iter().map(|arg| format!("`{}`", key(arg))).collect();
        let _ = writeln!(named, "- `[{name}]`: {}", keys.join(", "));
    }
    let global = args.iter().filter(|arg| arg.is_global_set()).map(|arg| arg.get_id().as_str());
    let handed_down: Vec<&str> = handed_down.iter().copied().chain(global).collect();
    for within in verb.get_subcommands() {
        keys(within, &format!("{name}."), &handed_down, (explained, named));
    }
}

fn key(arg: &Arg) -> String {
    arg.get_long().unwrap_or_default().replace('-', "_")
}

fn is_of_the_program(arg: &Arg) -> bool {
    ["help", "help_all", "version", "config", "json", "verbose", "quiet"].contains(&arg.get_id().as_str())
}

fn line(arg: &Arg, page: &mut String) {
    let plain = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let default: Vec<String> =
        arg.get_default_values().iter().map(|value| format!("`{}`", value.to_string_lossy())).collect();
    let default = match arg.get_action() {
        ArgAction::SetTrue => " (true or false)".to_owned(),
        _ if default.is_empty() => String::new(),
        _ => format!(" [default: {}]", default.join(", ")),
    };
    let help = arg.get_help().map(|help| plain(&help.to_string())).unwrap_or_default();
    let _ = writeln!(page, "- `{}`: {help}{default}", key(arg));
}
