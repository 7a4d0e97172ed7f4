//! What went wrong on the walk and was lived with.

use std::path::Path;

use super::setup::Walk;
use super::walk::Walked;
use crate::recording::Session;
use crate::recording::mounted::SensorSummary;

/// Everything that was lost or sent nothing, in words.
pub(crate) fn problems(
    dir: &Path,
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
        problems.push(format!("nothing was recorded into {}", dir.display()));
    }
    problems
}
