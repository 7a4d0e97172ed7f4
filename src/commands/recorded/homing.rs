//! Angles of a session that count from nowhere: of axes that were not homed while they were recorded.

use crate::drive::ServoReport;
use crate::report::chart::signed;
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
mod tests {
    use super::*;
    use crate::rig::Mount;

    fn sensor(pitch_deg: f64) -> MountedSensor {
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let mount = Mount { pitch_rad: pitch_deg.to_radians(), ..Mount::default() };
        MountedSensor { name: "left".into(), model, mount }
    }

    fn report(time_ns: u64, position_urad: i32, state: &str, homed: Option<bool>) -> ServoReport {
        ServoReport {
            time_ns,
            axis: 0,
            position_urad,
            uncertainty_urad: Some(192),
            target_urad: 0,
            source: "measured".into(),
            homed,
            state: state.into(),
            faults: Vec::new(),
        }
    }

    /// Which readings of an old session are doubted, by the mount's pitch.
    fn doubted(
        pitch_deg: f64,
        readings: &[(i32, &str)],
        lies_at: Option<usize>,
        homed: Option<bool>,
    ) -> String {
        let mut rig = Rig::default();
        rig.sensors.push(sensor(pitch_deg));
        let each = readings.iter().enumerate();
        let mut reports: Vec<_> =
            each.map(|(at, (urad, state))| report(100 * at as u64, *urad, state, homed)).collect();
        if let Some(at) = lies_at {
            reports[at].faults.push("encoder_jump".into());
        }
        doubt_old(&mut reports, &rig);
        let is_bare = |report: &ServoReport| report.source == NOT_HOMED && report.uncertainty_urad.is_none();
        reports.iter().map(|report| if is_bare(report) { '-' } else { '+' }).collect()
    }

    #[test]
    fn an_old_session_of_a_rig_that_was_never_armed_and_reads_nothing_is_doubted() {
        let idle = [(0, "idle"), (383, "idle"), (0, "idle")];
        assert_eq!(doubted(30.0, &idle, None, None), "---");
        assert_eq!(doubted(0.1, &idle, None, None), "+++", "the mount file says the same");
        assert_eq!(doubted(30.0, &idle, None, Some(false)), "+++", "a session that says it is believed");
        assert_eq!(doubted(30.0, &[(0, "holding"), (0, "holding")], None, None), "++", "it was armed");
        assert_eq!(doubted(30.0, &[(436_000, "idle"), (436_000, "idle")], None, None), "++");
    }

    #[test]
    fn an_old_session_is_doubted_until_homing_moved_its_zero() {
        let homes =
            |before: i32| [(before, "idle"), (before, "homing"), (-523_000, "holding"), (-523_000, "idle")];
        assert_eq!(doubted(30.0, &homes(0), None, None), "--++");
        assert_eq!(doubted(30.0, &homes(-522_900), None, None), "++++", "homing changed nothing");
        let moves_first = [(100, "idle"), (100, "moving"), (400_000, "homing"), (100, "holding")];
        assert_eq!(doubted(30.0, &moves_first, None, None), "++++", "what moves is homed");
    }

    #[test]
    fn an_old_session_is_doubted_from_a_lying_encoder_to_the_next_homing() {
        let readings = [
            (1, "holding"),
            (90_000, "fault"),
            (90_000, "idle"),
            (90_000, "homing"),
            (90_100, "holding"),
            (90_100, "moving"),
        ];
        assert_eq!(doubted(0.0, &readings, Some(1), None), "+---++");
    }

    #[test]
    fn the_time_without_a_zero_ends_with_the_first_reading_that_has_one() {
        let mut reports: Vec<_> = (1..=6).map(|at| report(100 * at, 0, "idle", Some(true))).collect();
        let spans = |reports: &[ServoReport]| without_zero_ns(&reports.iter().collect::<Vec<_>>());
        assert_eq!(spans(&reports), [[0; 2]; 0]);
        for at in [0, 1, 4] {
            reports[at].source = NOT_HOMED.into();
        }
        reports[3].source = "stale".into();
        assert_eq!(spans(&reports), [[0, 300], [301, 600]]);
        let words = notice(&sensor(30.0), &reports.iter().collect::<Vec<_>>()).unwrap();
        assert!(
            words.contains("not homed for 0.0 s of 0.0 s") && words.contains("+30.00 degrees"),
            "{words}"
        );
        reports.iter_mut().for_each(|report| report.source = NOT_HOMED.into());
        assert_eq!(spans(&reports), [[0, u64::MAX]]);
        let words = notice(&sensor(30.0), &reports.iter().collect::<Vec<_>>()).unwrap();
        assert!(words.contains("was never homed") && !words.contains("does not say"), "{words}");
        assert_eq!(notice(&sensor(30.0), &[]), None);
    }
}
