//! Flags of `rig` that an action has no use for.

use crate::commands::defaults::long_name;
use crate::commands::{Context, output};

/// Arguments that not every verb has a use for, and which have.
const USED_BY: [(&str, &[&str]); 10] = [
    ("port", &["status", "home", "set", "apply", "watch", "stop", "clear"]),
    ("node", &["status", "home", "set", "apply", "watch", "stop", "clear"]),
    ("arm", &["home", "set", "apply"]),
    ("home", &["home", "set", "apply"]),
    ("approach_deg", &["set", "apply"]),
    ("dry_run", &["home", "set", "apply"]),
    ("limits_deg", &["set", "apply"]),
    ("tolerance_deg", &["set", "apply"]),
    ("timeout_s", &["home", "set", "apply"]),
    ("reconnect", &["watch"]),
];

/// The arguments that a verb has no use for, and the verbs that have.
fn unused_by(verb: &str) -> impl Iterator<Item = &'static (&'static str, &'static [&'static str])> {
    USED_BY.iter().filter(move |(_, verbs)| !verbs.contains(&verb))
}

/// A verb's help without what it refuses.
pub(super) fn hide_unused(verb: clap::Command) -> clap::Command {
    let has = |id: &str| verb.get_arguments().any(|arg| arg.get_id() == id);
    let unused: Vec<&str> = unused_by(verb.get_name()).map(|(id, _)| *id).filter(|id| has(id)).collect();
    unused.into_iter().fold(verb, |verb, id| verb.mut_arg(id, |arg| arg.hide(true)))
}

pub(in crate::commands) fn refuse_unused(verb: &str, context: Context) -> anyhow::Result<()> {
    if verb == "stop" {
        // whoever stops a rig stops it, whatever else was typed
        if let Some((argument, _)) = unused_by(verb).find(|(argument, _)| context.is_typed(argument)) {
            output::say_notice(&format!("a stop is a stop: --{} changes nothing", long_name(argument)));
        }
        return Ok(());
    }
    unused_by(verb).try_for_each(|(argument, verbs)| {
        let users = verbs.join("`, `rig ");
        context
            .ensure_not_typed(&[*argument], format!("is about `rig {users}`: `rig {verb}` has no use for it"))
    })
}
