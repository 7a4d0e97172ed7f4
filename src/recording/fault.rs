//! Faults of a recording, each with a name.

/// A fault.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Fault {
    /// Short name, one of a few.
    pub name: &'static str,
    /// Sensors concerned.
    pub sensors: Vec<String>,
    /// In plain words.
    pub words: String,
    /// Share of the rays that agree with the recording as specified; none where rays cannot decide.
    pub agree_share: Option<f64>,
    /// The same if the fault is as named.
    pub explained_share: Option<f64>,
}

impl Fault {
    /// One that rays say nothing about.
    pub(crate) fn new(name: &'static str, sensors: Vec<String>, words: String) -> Self {
        Self { name, sensors, words, agree_share: None, explained_share: None }
    }
}
