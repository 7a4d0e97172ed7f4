//! What every `--help` looks like: flags under headings, those of experts under `--help-all` alone, two examples at the end.

mod examples;
mod flags;

use clap::{Command, CommandFactory as _};

use super::Cli;
pub use examples::EXAMPLES;
use flags::{EVERYBODYS, EXPERT, HEADINGS};

/// What other programs, and older versions of this one, call a verb.
const OTHER_VERBS: [(&str, &str); 12] = [
    ("info", "inspect"),
    ("viz", "view"),
    ("slice", "cut"),
    ("convert", "decode"),
    ("export", "decode"),
    ("play", "replay"),
    ("simulate", "predict"),
    ("evaluate", "predict --preset"),
    ("validate", "predict --scene MESH --ideal"),
    ("stand", "rig calibrate"),
    ("discover", "sensor discover"),
    ("calibrate", "boresight (sensors) or rig calibrate (servos)"),
];

/// And a flag.
const OTHER_FLAGS: [(&str, &str); 4] =
    [("--mesh", "--scene"), ("--wearer", "--operator"), ("--output", "--out"), ("--extrinsics", "--mount")];

/// The command line with its headings and examples.
pub fn command() -> Command {
    arranged(Cli::command(), "")
}

fn arranged(verb: Command, above: &str) -> Command {
    let name = format!("{above}{}", verb.get_name());
    let name = if above.is_empty() && name == "outrigger" { String::new() } else { name };
    let verb = verb.mut_args(|arg| {
        let long = arg.get_long().unwrap_or_default().to_owned();
        let arg = match &*long {
            "out" => arg.short('o'),
            "force" => arg.short('f'),
            _ => arg,
        };
        let is_expert = (EXPERT.contains(&&*long) || EXPERT.contains(&&*format!("{name} --{long}")))
            && !EVERYBODYS.contains(&(&name, &long));
        let heading = HEADINGS.iter().find(|(_, flags)| flags.contains(&&*long)).map(|(heading, _)| *heading);
        match (is_expert, heading) {
            (true, _) => arg.help_heading("Expert").hide_short_help(true),
            (false, Some(heading)) => arg.help_heading(heading),
            (false, None) => arg,
        }
    });
    let verb = match EXAMPLES.iter().find(|(known, _)| *known == name) {
        Some((_, examples)) => {
            let before = verb.get_after_help().map_or(String::new(), |text| format!("{text}\n\n"));
            let [first, second] = examples;
            verb.after_help(format!("{before}Examples:\n  outrigger {first}\n  outrigger {second}"))
        }
        None => verb,
    };
    let above = if name.is_empty() { String::new() } else { format!("{name} ") };
    verb.mut_subcommands(|within| arranged(within, &above))
}

/// What is ours where a verb or a flag of another program was typed.
pub fn ours(typed: &str) -> Option<&'static str> {
    let name = typed.split('=').next().unwrap_or_default();
    OTHER_VERBS.iter().chain(&OTHER_FLAGS).find(|(theirs, _)| *theirs == name).map(|(_, ours)| *ours)
}
