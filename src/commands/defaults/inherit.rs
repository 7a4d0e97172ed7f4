//! Keys that verbs share.

use crate::commands::daemon::site::FROM_PREDICT;
use crate::live::config::{Config, Section, Setting};

/// Keys that a verb takes from another's section where its own does not say otherwise.
/// A later line wins.
const INHERITED: [(&str, &str, &[&str]); 6] = [
    ("daemon", "predict", &FROM_PREDICT),
    ("record", "predict", &["mount"]),
    ("record", "daemon", &["mount"]),
    ("doctor", "rig", &["port"]),
    ("doctor", "record", &["receive_buffer"]),
    ("doctor", "daemon", &["out"]),
];

/// The same as sections.
pub(super) fn inherited(config: &Config) -> impl Iterator<Item = Section> + '_ {
    let named = |name: &str| config.sections.iter().find(|section| section.verb == [name]);
    INHERITED.iter().filter_map(move |(heir, from, keys)| {
        let (from, own) = (named(from)?, named(heir));
        let is_own =
            |key: &String| own.is_some_and(|section| section.settings.iter().any(|other| other.key == *key));
        let is_inherited = |setting: &&Setting| keys.contains(&setting.key.as_str()) && !is_own(&setting.key);
        let settings = from.settings.iter().filter(is_inherited).cloned().collect();
        Some(Section { verb: vec![(*heir).into()], line: from.line, settings })
    })
}
