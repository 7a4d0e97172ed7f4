//! What `odometry` prints.

use serde::Serialize;

use crate::base::numbers::counted;
use crate::design::registration::RegistrationQuality;
use crate::report::{Report, figures};
use crate::verify::align::Alignment;
use crate::verify::odometry::Step;

/// The document that `odometry` prints.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    pub(super) format: &'static str,
    pub(super) sensors: Vec<String>,
    pub(super) sweeps: usize,
    pub(super) duration_s: f64,
    pub(super) length_m: f64,
    pub(super) voxel_m: f64,
    pub(super) registration: Option<RegistrationQuality>,
    /// Sweeps along which a direction was a guess.
    #[serde(rename = "loose_sweeps")]
    pub(super) degenerate_sweeps: usize,
    pub(super) steps: Vec<Step>,
    /// Where the walk lies in the scene; null without one.
    pub(super) alignment: Option<Alignment>,
    /// What is odd or was lost.
    pub(super) problems: Vec<String>,
    pub(super) files: Vec<String>,
    pub(super) wall_s: f64,
}

pub(super) fn report(document: &Document) -> Report {
    let sentence = format!(
        "{} of {} in {:.1} s: {:.3} m travelled, map voxels {:.2} m",
        counted(document.sweeps as u64, "revolution"),
        document.sensors.join(", "),
        document.duration_s,
        document.length_m,
        document.voxel_m
    );
    let mut report = Report::new("Odometry", &sentence);
    if let Some(quality) = &document.registration {
        report.heading("Registration strength");
        figures::registration_figures(&mut report, quality);
    }
    report.heading("");
    document.files.iter().for_each(|file| report.note(file));
    report
}
