//! How the daemon itself does.

use serde::Serialize;

/// How a component of the daemon does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ComponentState {
    /// It does its work.
    Running,
    /// Its work is done.
    Ended,
    /// It ended before its work was done.
    Dead,
}

/// A thread of the daemon, or one that panicked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Component {
    /// `recorder`, `receive left`.
    pub name: String,
    /// The daemon ends in order when it dies.
    pub essential: bool,
    /// How it does.
    pub state: ComponentState,
    /// How it died.
    pub why: Option<String>,
}

/// The log on stderr.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LogStatus {
    /// Lines so far.
    pub lines: u64,
    /// Of these, lines without a reader.
    pub lost_lines: u64,
    /// Why the newest line could not be written.
    pub error: Option<String>,
    /// How long its reader has read nothing, s.
    pub stuck_s: f64,
}
