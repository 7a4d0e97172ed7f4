//! What `boresight` prints.

use serde::Serialize;

use crate::base::numbers::signed;
use crate::report::{Report, values};
use crate::verify::calibrate::RelativeMount;

/// A tilt is called off beyond so many standard deviations and degrees.
const SURE: f64 = 3.0;
const NOTABLE_DEG: f64 = 0.1;

/// The document that `boresight` prints.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    pub(super) format: &'static str,
    pub(super) verdict: &'static str,
    pub(super) words: Vec<String>,
    /// Every two sensors, the first against the second.
    pub(super) relative: Vec<RelativeMount>,
    /// What is odd or was lost.
    pub(super) problems: Vec<String>,
    pub(super) wall_s: f64,
}

fn is_off(found: &RelativeMount) -> bool {
    found.tilt.as_ref().is_some_and(|tilt| tilt.error_deg.abs() > (SURE * tilt.sd_deg).max(NOTABLE_DEG))
}

pub(super) fn verdict(relative: &[RelativeMount]) -> &'static str {
    if relative.iter().any(is_off) {
        "differs"
    } else if relative.iter().any(|found| found.tilt.is_none()) {
        "cannot_tell"
    } else {
        "matches"
    }
}

pub(super) fn words(found: &RelativeMount) -> String {
    let [first, second] = &found.sensors;
    match (&found.tilt, &found.cannot_tell) {
        (Some(tilt), _) => format!(
            "{first} against {second}: pitch {} ± {:.3} degrees (95 %) from nominal, {}{}",
            signed(tilt.error_deg, 3),
            tilt.u95_deg,
            values::p_value(tilt.p_value),
            if is_off(found) { "" } else { ": as specified, within the uncertainty" }
        ),
        (None, why) => format!("{first} against {second}: {}", why.as_deref().unwrap_or("cannot tell here")),
    }
}

pub(super) fn report(document: &Document) -> Report {
    let mut report = Report::new("How the sensors sit to each other", "");
    for (words, found) in document.words.iter().zip(&document.relative) {
        report.heading("");
        report.note(words);
        if found.windows == 0 {
            continue;
        }
        let [roll, pitch, yaw] = found.rotation_deg.map(|turn| values::estimate(turn, 3));
        report.figure("turn", format!("roll {roll}, pitch {pitch}, yaw {yaw} deg"));
        let [x, y, z] = found.translation_mm.map(|shift| values::estimate(shift, 1));
        report.figure("shift", format!("x {x}, y {y}, z {z} mm"));
        report.figure("range", format!("{} mm", values::estimate(found.range_offset_mm, 1)));
        let observable = match found.observable.join(" ") {
            none if none.is_empty() => "nothing".into(),
            observable => observable,
        };
        let condition = found.condition_number.map_or("-".into(), |number| format!("{number:.0}"));
        report.figure("observable", format!("{observable}; condition number {condition}"));
        report.figure(
            "from",
            format!(
                "{} points in {} windows, {:.1} mm from the planes",
                found.pairs, found.windows, found.residual_sd_mm
            ),
        );
    }
    report
}
