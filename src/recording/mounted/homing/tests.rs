//! What old sessions say of axes that were not homed.

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
fn doubted(pitch_deg: f64, readings: &[(i32, &str)], lies_at: Option<usize>, homed: Option<bool>) -> String {
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
    assert!(words.contains("not homed for 0.0 s of 0.0 s") && words.contains("+30.00 degrees"), "{words}");
    reports.iter_mut().for_each(|report| report.source = NOT_HOMED.into());
    assert_eq!(spans(&reports), [[0, u64::MAX]]);
    let words = notice(&sensor(30.0), &reports.iter().collect::<Vec<_>>()).unwrap();
    assert!(words.contains("was never homed") && !words.contains("does not say"), "{words}");
    assert_eq!(notice(&sensor(30.0), &[]), None);
}
