//! How the demo ends.

use std::path::Path;

use super::document::Document;
use super::folder::{REPORT_HTML, SESSION};
use super::setup::Walk;
use super::walk::Walked;
use crate::commands::{Context, Outcome, output};
use crate::recording::Session;
use crate::recording::mounted::SensorSummary;
use crate::verify::judgement::comparison::Verdict;

/// Everything that was lost or sent nothing, in words.
pub(super) fn problems(
    out: &Path,
    session: &Session,
    walk: &Walk<'_>,
    walked: &Walked,
    sensors: &mut [SensorSummary],
) -> Vec<String> {
    let mut problems = session.problems().to_vec();
    let [start_ns, end_ns] = walk.trajectory.time_span_ns();
    let max_frames = sensors.iter().map(|sensor| sensor.frames).max().unwrap_or(0);
    for (sensor, sent) in sensors.iter_mut().zip(&walked.packets_sent) {
        sensor.packets_sent = *sent;
        if sensor.lost > 0 {
            problems.push(format!("sensor {} lost {} packets", sensor.sensor, sensor.lost));
        }
        // the first and the last revolution may be cut short
        if sensor.frames + 2 < max_frames {
            let seconds = (end_ns - start_ns) as f64 * 1e-9;
            problems.push(format!(
                "sensor {} sent no data for a time: {} revolutions in a walk of {seconds:.1} s, the other has {max_frames}",
                sensor.sensor, sensor.frames
            ));
        }
    }
    if walked.manifest.complete && sensors.iter().all(|sensor| sensor.frames == 0) {
        problems.push(format!("nothing was recorded into {}", out.join(SESSION).display()));
    }
    problems
}

pub(super) fn conclude(out: &Path, context: Context, document: &Document) -> anyhow::Result<Outcome> {
    let counts = &document.compare.coverage;
    let iou = |iou: Option<f64>| iou.map_or("no IoU".into(), |iou| format!("IoU {iou:.5}"));
    let cells = iou(document.compare.model.iou);
    let patches = document.compare.agreement.as_ref().and_then(|agreement| agreement.patches.agreement.iou);
    if context.json {
        output::print_json(document)?;
    } else {
        output::print_text(&format!(
            "planned {}, as driven {}, recorded {} cells ({cells}); patches of surface as driven against recorded {}: {}\n{}\n",
            counts.planned,
            counts.as_driven,
            counts.recorded,
            iou(patches),
            match document.compare.verdict {
                Verdict::Matches => "matches",
                Verdict::Differs => "differs",
                Verdict::CannotTell => "cannot tell",
            },
            out.join(REPORT_HTML).display()
        ))?;
    }
    for problem in &document.problems {
        output::say_notice(problem);
    }
    let fine = document.problems.is_empty() && document.compare.verdict == Verdict::Matches;
    Ok(if fine { Outcome::Done } else { Outcome::DataLost })
}
