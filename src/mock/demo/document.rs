//! The demo's JSON document, `report.json`.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::recording::mounted::{AxisSummary, SensorSummary};
use crate::verify::judgement::comparison::Comparison;

/// Format name, also what marks a folder as made by the demo.
pub(crate) const FORMAT: &str = "outrigger-demo/1";

/// Everything the demo measured.
#[derive(Debug, Serialize)]
pub(crate) struct Document {
    pub format: &'static str,
    /// Command line that gives this document again.
    pub command: String,
    pub optimize: SearchSummary,
    pub rig: Vec<AxisSummary>,
    pub recording: Vec<SensorSummary>,
    pub compare: Comparison,
    /// What went wrong and was lived with.
    pub problems: Vec<String>,
    /// Seconds per stage.
    pub wall_s: BTreeMap<&'static str, f64>,
}

/// The search in short.
#[derive(Debug, Serialize)]
pub(crate) struct SearchSummary {
    pub preset: String,
    pub method: String,
    pub seed: u64,
    pub evaluations: usize,
    pub objective: f64,
    pub masters: Vec<[f64; 5]>,
    pub history: Vec<(usize, f64)>,
    pub wall_s: f64,
}
