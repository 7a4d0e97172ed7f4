//! Angles of a session that count from nowhere: of axes that were not homed while they were recorded.

use crate::base::numbers::signed;
use crate::recording::ServoReport;
use crate::rig::{MountedSensor, Rig};

/// What a reading is called that has no zero.
const NOT_HOMED: &str = "not_homed";

/// A mount and an axis that differ by more do not say the same, rad: five times what a good servo errs.
pub const CONTRADICTS_RAD: f64 = 0.3_f64.to_radians();

/// An axis that reads no more than this reads nothing, µrad: two counts of a usual encoder.
const NOTHING_URAD: i32 = 2 * firmware_protocol::simulated::ENCODER_STEP_URAD;

fn rad(urad: i32) -> f64 {
    f64::from(urad) * 1e-6
}

/// Sessions from before it was recorded whether an axis is homed call every reading measured. What else they hold says which
/// were not; each `axis` is the place of its sensor in `rig`.
pub(crate) fn doubt_old(reports: &mut [ServoReport], rig: &Rig) {
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let own = reports.iter_mut().filter(|report| report.axis == axis);
        let mut own: Vec<&mut ServoReport> = own.collect();
        if own.iter().any(|report| report.homed.is_some()) {
            continue;
        }
        own.sort_by_key(|report| report.time_ns);
        doubt_lying_encoder(&mut own);
        doubt_before_homing(&mut own);
        doubt_idle_at_nothing(&mut own, sensor);
    }
}

fn doubt(report: &mut ServoReport) {
    if report.source == "measured" {
        report.source = NOT_HOMED.into();
        report.uncertainty_urad = None;
    }
}

/// A rig that found its encoder lying trusts it again when it is homed, and does not move before.
fn doubt_lying_encoder(own: &mut [&mut ServoReport]) {
    let (mut lies, mut was_homing) = (false, false);
    for report in own {
        let is_homing = report.state == "homing";
        let lied =
            report.faults.iter().any(|fault| matches!(fault.as_str(), "encoder_invalid" | "encoder_jump"));
        let is_homed = report.state == "moving" || (was_homing && report.state == "holding");
        lies = lied || (lies && !is_homed);
        was_homing = is_homing;
        if lies {
            doubt(report);
        }
    }
}

/// An axis that reads another angle after homing than before counted from elsewhere until then.
fn doubt_before_homing(own: &mut [&mut ServoReport]) {
    let Some(begins) = own.iter().position(|report| matches!(report.state.as_str(), "moving" | "homing"))
    else {
        return;
    };
    let ends = own.iter().skip(begins).position(|report| report.state != "homing");
    let (Some(before), Some(ends)) = (begins.checked_sub(1), ends.map(|ends| begins + ends)) else { return };
    let turned_rad = rad(own[ends].position_urad) - rad(own[before].position_urad);
    if own[begins].state == "homing" && turned_rad.abs() > CONTRADICTS_RAD {
        own[..ends].iter_mut().for_each(|report| doubt(report));
    }
}

/// An encoder that counts from where it was switched on reads nothing until the axis moves. A rig that was never armed, and
/// with another angle in its mount file, is most likely such a one.
fn doubt_idle_at_nothing(own: &mut [&mut ServoReport], sensor: &MountedSensor) {
    let is_nothing = |report: &&mut ServoReport| {
        matches!(report.state.as_str(), "boot" | "idle") && report.position_urad.abs() <= NOTHING_URAD
    };
    if sensor.mount.pitch_rad.abs() > CONTRADICTS_RAD && own.iter().all(is_nothing) {
        own.iter_mut().for_each(|report| doubt(report));
    }
}

/// Times on the host's clock, ns, in which an axis had no zero: from the reading that says so to the next one that has it.
pub(crate) fn without_zero_ns(own: &[&ServoReport]) -> Vec<[u64; 2]> {
    let known = own.iter().filter(|report| matches!(report.source.as_str(), "measured" | NOT_HOMED));
    let mut known: Vec<_> = known.map(|report| (report.time_ns, report.source == NOT_HOMED)).collect();
    known.sort_unstable();
    let mut spans: Vec<[u64; 2]> = Vec::new();
    let mut last_ns = 0;
    for run in known.chunk_by(|a, b| a.1 == b.1) {
        if let (&[(_, is_without), ..], Some((end_ns, _))) = (run, run.last()) {
            // what lies between two readings of which one has none has none
            match spans.last_mut() {
                Some(span) if !is_without => span[1] = run[0].0,
                _ if is_without => spans.push([last_ns, u64::MAX]),
                _ => {}
            }
            last_ns = end_ns + 1;
        }
    }
    spans
}

/// What an axis counted while it was not homed, and what counts in its place; none where it was homed all along.
pub(crate) fn notice(sensor: &MountedSensor, own: &[&ServoReport]) -> Option<String> {
    let counted: Vec<&&ServoReport> = own.iter().filter(|report| report.source == NOT_HOMED).collect();
    let times_ns = own.iter().map(|report| report.time_ns);
    let (from_ns, to_ns) = (times_ns.clone().min()?, times_ns.max()?);
    let angles = || counted.iter().map(|report| rad(report.position_urad));
    let (least_rad, max_rad) = (angles().reduce(f64::min)?, angles().reduce(f64::max)?);
    let spans_ns = without_zero_ns(own);
    let lasted_ns: u64 =
        spans_ns.iter().map(|[a, b]| (*b).min(to_ns).saturating_sub((*a).max(from_ns))).sum();
    let when = if own.iter().any(|report| report.source == "measured") {
        format!("not homed for {:.1} s of {:.1} s", lasted_ns as f64 * 1e-9, (to_ns - from_ns) as f64 * 1e-9)
    } else {
        "never homed".into()
    };
    let doubt = match counted.iter().any(|report| report.homed.is_none()) {
        true => {
            " (the session does not say so: it is from before that was recorded, and its readings look like it)"
        }
        false => "",
    };
    let degrees = |rad: f64| signed(rad.to_degrees(), 2);
    Some(format!(
        "{}: its axis was {when}{doubt}: the {} to {} degrees that it counted have no zero and measure nothing; \
         in their place counts the pitch of the mount file, {} degrees. Home the rig before it records, or give --mount with the \
         pitch at which the sensor stood",
        sensor.name,
        degrees(least_rad),
        degrees(max_rad),
        degrees(sensor.mount.pitch_rad),
    ))
}

#[cfg(test)]
mod tests;
