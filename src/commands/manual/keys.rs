//! Every key of rig.toml, from the flags of the verbs.

use std::fmt::Write as _;

use clap::{Arg, ArgAction, Command};
use sensors::catalogue;

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

pub(super) fn page(program: &Command) -> String {
    let models: Vec<String> = catalogue::decoded_names().iter().map(|name| format!("`{name}`")).collect();
    let mut page = OF_SENSORS.replace("{models}", &models.join(", "));
    program.get_subcommands().for_each(|verb| keys(verb, "", &[], &mut page));
    page
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
