//! The JSON documents of `compare`.

use serde::Serialize;

use crate::recording::mounted::{AxisSummary, MountedRecording, PassSummary, SensorSummary};
use crate::report::{Report, comparison};
use crate::verify::align::Alignment;
use crate::verify::compare::TimeOffset;
use crate::verify::judgement::comparison::{Comparison, Reason, Verdict};
use crate::verify::judgement::zero_offer::ZeroOffer;
use crate::verify::walk::WalkSite;

/// The document that `compare` prints.
#[derive(Debug, Serialize)]
pub struct Document {
    pub format: &'static str,
    #[serde(flatten)]
    pub comparison: Comparison,
    pub recording: Vec<SensorSummary>,
    /// What the axes measured, where the session holds it.
    pub rig: Vec<AxisSummary>,
    /// Zeros of servo axes that would make their readings true; never applied.
    pub servo_zero: Vec<ZeroOffer>,
    /// What is odd or was lost.
    pub problems: Vec<String>,
    /// Where the trajectory lies in the scene; null where its frame is the scene's.
    pub alignment: Option<Alignment>,
    pub time_offset_s: f64,
    /// With how sure it is, where it was looked for.
    pub time_offset: Option<TimeOffset>,
    pub wall_s: f64,
}

impl Document {
    pub(super) fn new(
        recorded: &MountedRecording,
        place: &WalkSite,
        pass: &PassSummary,
        comparison: Comparison,
        wall_s: f64,
    ) -> Self {
        let axes = recorded.axes(pass);
        let mut problems = recorded.notices.clone();
        problems.extend(recorded.contradicted(pass));
        problems.extend(place.notices.iter().chain(&pass.losses).cloned());
        Self {
            format: "outrigger-compare/1",
            recording: pass.sensors.clone(),
            servo_zero: ZeroOffer::of(&axes, &comparison.mount),
            rig: axes,
            problems,
            alignment: place.alignment.clone(),
            time_offset_s: place.time_offset_ns as f64 * 1e-9,
            time_offset: place.time_offset,
            wall_s,
            comparison,
        }
    }

    pub(super) fn report(&self, pictures: Option<&comparison::Pictures<'_>>) -> Report {
        let zeros: Vec<String> = self.servo_zero.iter().map(ZeroOffer::words).collect();
        comparison::report(&self.comparison, &self.problems, &zeros, pictures)
    }
}

/// The document where no place of the trajectory in the scene is sure: nothing is compared.
#[derive(Serialize)]
pub(crate) struct Unplaced<'a> {
    pub(crate) format: &'static str,
    pub(crate) verdict: Verdict,
    pub(crate) reason: Reason,
    pub(crate) words: [String; 1],
    pub(crate) alignment: &'a Alignment,
    pub(crate) problems: Vec<String>,
    pub(crate) wall_s: f64,
}
