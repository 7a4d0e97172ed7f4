//! The demo's JSON document, `report.json`.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::compare::{Agreement, CoverageCounts, RayClasses, Verdict};

/// Format name, also what marks a folder as made by the demo.
pub const FORMAT: &str = "outrigger-demo/1";

/// Everything the demo measured.
#[derive(Debug, Serialize)]
pub struct Document {
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
pub struct SearchSummary {
    pub preset: String,
    pub method: String,
    pub seed: u64,
    pub evaluations: usize,
    pub objective: f64,
    pub masters: Vec<[f64; 5]>,
    pub history: Vec<(usize, f64)>,
    pub wall_s: f64,
}

/// One servo axis.
#[derive(Debug, Serialize)]
pub struct AxisSummary {
    pub sensor: String,
    pub target_pitch_deg: f64,
    /// Mean of what the axis measured while recording.
    pub measured_pitch_deg: f64,
    /// Greatest minus least of it.
    pub measured_span_deg: f64,
    pub reports: usize,
}

/// One sensor's packets.
#[derive(Debug, Default, Serialize)]
pub struct SensorSummary {
    pub sensor: String,
    pub packets_sent: u64,
    pub packets_recorded: u64,
    /// Losses of every kind, kernel and queue and decoder.
    pub lost: u64,
    pub frames: u64,
    pub complete_frames: u64,
    pub points: u64,
}

/// Predicted against recorded.
#[derive(Debug, Serialize)]
pub struct Comparison {
    pub rays: BTreeMap<String, RayClasses>,
    /// As driven against recorded.
    pub agreement: Agreement,
    /// Planned against as driven.
    pub execution: Agreement,
    pub coverage: CoverageCounts,
    pub verdict: Verdict,
}
