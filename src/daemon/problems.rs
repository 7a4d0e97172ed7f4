//! What is wrong, in plain words, and what to do about it.

use super::status::{
    CoverageStatus, Problem, RecorderStatus, RigState, SensorState, SensorStatus, Severity, Status,
};
use crate::clocks::ClockState;

/// An axis this far from its target while it holds is said to be off, degrees.
const OFF_TARGET_DEG: f64 = 0.5;
/// An axis this far from the mount's pitch sees other cells than were promised, degrees.
pub(super) const OFF_MOUNT_DEG: f64 = 1.0;
/// A write that takes longer than this is worth a word, s.
const SLOW_WRITE_S: f64 = 0.5;

/// Everything that is wrong with a state, worst first.
pub(super) fn problems(status: &Status) -> Vec<Problem> {
    let mut list = List::default();
    status.sensors.iter().for_each(|sensor| of_sensor(sensor, &mut list));
    status.rig.iter().for_each(|rig| of_rig(rig, &mut list));
    status.rig.iter().for_each(|rig| of_mount(rig, status.recorder.recording, &mut list));
    of_recorder(&status.recorder, &mut list);
    if status.recorder.recording {
        status.coverage.iter().for_each(|coverage| of_coverage(coverage, &mut list)); // before, no way has begun
    }
    if let Some(jump_s) = status.host_clock_jump_s {
        list.warn(
            "host",
            "host_clock_jump",
            format!("The clock of this computer was set by {jump_s:.3} s."),
            "Times of packets before and after do not fit together. Let chrony or ptp4l slew it, or set it before \
             recording.",
        );
    }
    list.0.sort_by_key(|problem| problem.severity);
    list.0
}

#[derive(Default)]
struct List(Vec<Problem>);

impl List {
    fn add(
        &mut self,
        severity: Severity,
        about: &str,
        kind: &'static str,
        what: String,
        advice: impl Into<String>,
    ) {
        self.0.push(Problem { severity, kind, about: about.to_owned(), what, advice: advice.into() });
    }

    fn error(&mut self, about: &str, kind: &'static str, what: String, advice: impl Into<String>) {
        self.add(Severity::Error, about, kind, what, advice);
    }

    fn warn(&mut self, about: &str, kind: &'static str, what: String, advice: impl Into<String>) {
        self.add(Severity::Warning, about, kind, what, advice);
    }
}

fn of_sensor(sensor: &SensorStatus, list: &mut List) {
    let name = sensor.name.as_str();
    let port = sensor.address.map_or(0, |address| address.port());
    match sensor.state {
        SensorState::Ok => {}
        SensorState::Waiting => list.error(
            name,
            "no_packets",
            format!("Nothing has come from {name} yet (port {port})."),
            "Is it powered, is the cable in, and does it send to this computer (udp_dest or host address)?",
        ),
        SensorState::Silent => {
            let age_s = sensor.last_packet_age_s.unwrap_or(0.0);
            list.error(
                name,
                "silent",
                format!("{name} has sent nothing for {age_s:.0} s."),
                "Check its power and its cable. What it sends is recorded again as soon as it comes back.",
            );
        }
        SensorState::NotDecoded => {
            let stranger = sensor.unclaimed.first();
            let reason = stranger.map(|entry| entry.reason.clone()).or_else(|| sensor.first_damage.clone());
            let is_metadata = stranger.is_some_and(|entry| entry.needs_metadata);
            let kind = if is_metadata { "wrong_metadata" } else { "not_decoded" };
            let reason = reason.unwrap_or_else(|| "they are no packets of a known format".into());
            let advice = if is_metadata {
                "The packets are recorded all the same. Save http://SENSOR/api/v1/sensor/metadata as the file that \
                 rig.toml names, and start again."
            } else {
                "The packets are recorded all the same. Does another device send to this port?"
            };
            list.error(name, kind, format!("Packets of {name} come but cannot be read: {reason}."), advice);
        }
    }
    of_losses(sensor, list);
    if sensor.recent_restarts > 0 {
        list.warn(
            name,
            "restarted",
            format!("{name} started again a moment ago."),
            "If nobody restarted it, look at its power supply. Recording goes on.",
        );
    }
    if sensor.is_other_model {
        list.warn(
            name,
            "other_model",
            format!("{name} is a {}, but rig.toml says {}.", sensor.product, sensor.model),
            "Correct the model in rig.toml, or the cables: predictions are made for the model that is named.",
        );
    }
    if let Some(why) = &sensor.unseated {
        list.warn(
            name,
            "unseated",
            format!("What {name} sees is drawn as if it sat at the platform's origin: {why}."),
            "Give it one name in rig.toml and in the mount file; a session without cannot be compared.",
        );
    }
    if let Some(clock) = &sensor.clock {
        if sensor.recent_clock_jumps > 0 && sensor.recent_restarts == 0 {
            let jump_s = clock.jumps.last().map_or(0.0, |jump| jump.change_s);
            list.warn(
                name,
                "clock_jump",
                format!("The clock of {name} jumped by {:.3} s against this computer's.", -jump_s),
                "Its time source came or went. Times before and after do not fit together.",
            );
        }
        if matches!(clock.state, ClockState::SincePowerOn | ClockState::Unsynchronised) {
            list.warn(
                name,
                "clock_not_locked",
                format!("The clock of {name} {}.", clock.text()),
                "Give it PTP, or GPS with a pulse per second; until then only arrival times tie it to the others.",
            );
        }
    }
    if sensor.gps_valid == Some(false) {
        list.warn(
            name,
            "gps_invalid",
            format!("The GPS receiver of {name} has no fix."),
            "Its time is not locked before it sees satellites.",
        );
    }
    for warning in &sensor.warnings {
        list.error(
            name,
            "sensor_warning",
            format!("{name} {warning}."),
            "Give it air and shade, or switch it off for a while.",
        );
    }
    if let Some(warning) = &sensor.buffer_warning {
        list.warn(name, "small_buffer", format!("{warning}."), "Bursts may be lost until that is done.");
    }
}

fn of_losses(sensor: &SensorStatus, list: &mut List) {
    let (name, recent) = (sensor.name.as_str(), &sensor.recent_losses);
    for (count, kind, what, advice) in [
        (
            recent.kernel_dropped,
            "kernel_drops",
            "packets were dropped by the kernel: this computer is too busy to take them",
            "End other programs, or raise net.core.rmem_max and --receive-buffer.",
        ),
        (
            recent.queue_dropped,
            "queue_drops",
            "packets were dropped because the disk did not keep up",
            "Record to a faster disk.",
        ),
        (
            recent.on_the_way,
            "lost_on_the_way",
            "packets were lost between the sensor and this computer",
            "Look at cable, switch and network card; a link of 100 Mbit/s is too slow for most sensors.",
        ),
        (
            recent.malformed + recent.crc_errors,
            "damaged",
            "packets came damaged",
            "Look at the cable, and whether the metadata in rig.toml is of the present settings.",
        ),
    ] {
        if count > 0 {
            list.error(name, kind, format!("{name}: {count} {what}."), advice);
        }
    }
    if recent.foreign_source > 0 {
        let from = recent.first_foreign_source.map_or("elsewhere".into(), |source| source.to_string());
        list.warn(
            name,
            "foreign_source",
            format!(
                "{name}: {} packets came from another sender ({from}) and were left out.",
                recent.foreign_source
            ),
            "Find out who sends to this port, or correct `source` in rig.toml.",
        );
    }
    if recent.not_its_own > 0 && sensor.state == SensorState::Ok {
        let reason = sensor.unclaimed.first().map_or("of another kind", |entry| entry.reason.as_str());
        list.warn(
            name,
            "foreign_packets",
            format!("{} packets on the port of {name} are not its own: {reason}.", recent.not_its_own),
            "They are recorded too. Give the sensor a `source` in rig.toml to keep others out.",
        );
    }
}

fn of_rig(rig: &RigState, list: &mut List) {
    if !rig.connected {
        let why = rig.error.as_deref().unwrap_or("not connected");
        list.error(
            "rig",
            "rig_lost",
            format!("The rig does not answer: {why}."),
            "Check its cable and power. The daemon goes on looking for it; home it when it is back.",
        );
        return;
    }
    let Some(status) = &rig.status else { return };
    if status.axes.iter().any(|axis| !axis.homed) {
        list.warn(
            "rig",
            "not_homed",
            "The rig is not homed: its angles are not to be trusted.".into(),
            "Arm the rig and home it.",
        );
    }
    for axis in &status.axes {
        let number = axis.axis;
        if axis.state == "e_stop" {
            if number == 0 {
                list.error(
                    "rig",
                    "e_stop",
                    "The emergency stop is latched.".into(),
                    "When the rig is safe, clear the faults, then arm and home it.",
                );
            }
        } else if !axis.faults.is_empty() {
            let faults = axis.faults.join(", ");
            list.error(
                "rig",
                "rig_fault",
                format!("Axis {number} of the rig reports {faults}."),
                "Take the cause away, then clear the faults.",
            );
        } else if axis.homed
            && axis.state == "holding"
            && (axis.position_deg - axis.target_deg).abs() > OFF_TARGET_DEG
        {
            list.warn(
                "rig",
                "off_target",
                format!(
                    "Axis {number} stands at {:.2} degrees, its target is {:.2}.",
                    axis.position_deg, axis.target_deg
                ),
                "Something is in its way, or it is overloaded.",
            );
        }
        if axis.source == "stale" {
            list.warn(
                "rig",
                "stale",
                format!("The angle of axis {number} is old."),
                "The encoder or the bus to it does not answer.",
            );
        }
        for error in &axis.device_errors {
            list.error("rig", "device_error", format!("Axis {number}: {error}."), "See the servo's manual.");
        }
    }
}

/// Whether the rig can go where the mount wants it, and stands there while it is recorded.
fn of_mount(rig: &RigState, recording: bool, list: &mut List) {
    let Some(status) = rig.status.as_ref().filter(|_| rig.connected) else { return };
    let (pitches, axes) = (rig.mount_pitches_deg.len(), status.axes.len());
    if pitches > 0 && pitches != axes {
        list.warn(
            "rig",
            "mount_out_of_reach",
            format!("The configured mount names {pitches} sensors, the rig has {axes} axes."),
            "The mount cannot be applied: give a mount of the sensors that the rig turns, in the order of its axes.",
        );
        return;
    }
    for (axis, pitch_deg) in status.axes.iter().zip(&rig.mount_pitches_deg) {
        let configured = rig.limits_deg.get(axis.axis).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let low_deg = axis.limits_deg[0].max(configured[0]);
        let high_deg = axis.limits_deg[1].min(configured[1]);
        if !(low_deg..=high_deg).contains(pitch_deg) {
            list.warn(
                "rig",
                "mount_out_of_reach",
                format!(
                    "The configured mount wants axis {} at {pitch_deg:.2} degrees, its limits are {low_deg:.2} to \
                     {high_deg:.2}.",
                    axis.axis
                ),
                "The mount cannot be applied: search one within the limits of the rig, or correct the limits.",
            );
        }
    }
    let stands = |state: &str| matches!(state, "idle" | "holding");
    for (axis, pitch_deg) in status.axes.iter().zip(&rig.recorded_pitches_deg) {
        let is_known = axis.homed && axis.source != "stale" && rig.busy.is_none() && stands(&axis.state);
        if recording && is_known && (axis.position_deg - pitch_deg).abs() > OFF_MOUNT_DEG {
            list.warn(
                "rig",
                "off_mount",
                format!(
                    "Axis {} stands at {:.2} degrees, the mount that is recorded says {pitch_deg:.2}.",
                    axis.axis, axis.position_deg
                ),
                "The coverage is predicted for the mount. Apply it, or know that this recording is of other pitches: \
                 measured angles are recorded beside it.",
            );
        }
    }
}

fn of_coverage(coverage: &CoverageStatus, list: &mut List) {
    if coverage.without_pose > 0 {
        list.warn(
            "coverage",
            "no_pose",
            format!(
                "{} points are not in the coverage: the trajectory does not say where the platform was.",
                coverage.without_pose
            ),
            "They are recorded all the same. Give a trajectory of this walk, or none at all for a platform that stands.",
        );
    }
}

fn of_recorder(recorder: &RecorderStatus, list: &mut List) {
    let free_mib = recorder.free_bytes.unwrap_or(0) >> 20;
    let make_room = "Delete or move old sessions, then record again. What was recorded is safe.";
    if let (false, Some(last)) = (recorder.recording, &recorder.last) {
        if let Some(failure) = &last.failure {
            list.error(
                "recorder",
                "recording_failed",
                format!("Recording ended: {failure}."),
                if failure.contains("disk full") {
                    make_room
                } else {
                    "Look at the disk, then record again."
                },
            );
        } else if last.why == "disk_full" {
            let what = format!("Recording ended: the disk is nearly full ({free_mib} MiB left).");
            list.error("recorder", "disk_full", what, make_room);
        }
    }
    if recorder.low_disk {
        let left = match recorder.seconds_left {
            Some(left_s) if recorder.recording => format!(", about {:.0} min at this rate", left_s / 60.0),
            _ => String::new(),
        };
        list.warn(
            "recorder",
            "low_disk",
            format!("{free_mib} MiB are left on the disk{left}."),
            "Make room before recording ends.",
        );
    }
    if recorder.stalled_s > SLOW_WRITE_S {
        list.error(
            "recorder",
            "disk_slow",
            format!("The disk has not taken packets for {:.1} s; they wait in memory.", recorder.stalled_s),
            "If this lasts, packets are lost. Record to a faster disk.",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::{AxisStatus, RigStatus};

    fn kinds(change: impl FnOnce(&mut SensorStatus)) -> Vec<&'static str> {
        let mut sensor =
            SensorStatus { name: "left".into(), state: SensorState::Ok, ..SensorStatus::default() };
        change(&mut sensor);
        let mut list = List::default();
        of_sensor(&sensor, &mut list);
        assert!(list.0.iter().all(|problem| problem.what.contains("left") && !problem.advice.is_empty()));
        list.0.into_iter().map(|problem| problem.kind).collect()
    }

    #[test]
    fn a_healthy_sensor_has_no_problem_and_each_trouble_its_own() {
        assert!(kinds(|_| {}).is_empty());
        assert_eq!(kinds(|sensor| sensor.state = SensorState::Silent), ["silent"]);
        assert_eq!(kinds(|sensor| sensor.state = SensorState::NotDecoded), ["not_decoded"]);
        assert_eq!(kinds(|sensor| sensor.recent_losses.kernel_dropped = 1), ["kernel_drops"]);
        assert_eq!(kinds(|sensor| sensor.recent_losses.crc_errors = 1), ["damaged"]);
        assert_eq!(kinds(|sensor| sensor.losses.kernel_dropped = 1), [""; 0], "long ago");
        assert_eq!(kinds(|sensor| sensor.recent_restarts = 1), ["restarted"]);
        assert_eq!(kinds(|sensor| sensor.warnings.push("left is hot".into())), ["sensor_warning"]);
    }

    #[test]
    fn a_rig_beside_its_mount_is_told_of_while_it_is_recorded() {
        let axis = |number: usize, position_deg: f64| -> AxisStatus {
            serde_json::from_value(serde_json::json!({
                "axis": number, "state": "idle", "source": "measured", "homed": true, "position_deg": position_deg,
                "target_deg": position_deg, "limits_deg": [-30.0, 30.0], "age_ms": 0.0, "uncertainty_deg": 0.1,
                "faults": [], "device_errors": [],
            }))
            .unwrap()
        };
        let status: RigStatus = serde_json::from_value(serde_json::json!({
            "port": "mock", "uid": "1", "firmware": "1", "reset_cause": "power", "armed": false, "homing_moves": false,
            "axes": [axis(0, 20.0), axis(1, -20.0)], "frames": 1, "damaged": 0,
        }))
        .unwrap();
        let kinds = |mount_deg: &[f64], recorded_deg: &[f64], recording: bool| {
            let mut rig = RigState {
                connected: true,
                mount_pitches_deg: mount_deg.to_vec(),
                recorded_pitches_deg: recorded_deg.to_vec(),
                ..RigState::default()
            };
            rig.status = Some(status.clone());
            let mut list = List::default();
            of_mount(&rig, recording, &mut list);
            list.0.into_iter().map(|problem| (problem.kind, problem.what)).collect::<Vec<_>>()
        };
        assert_eq!(kinds(&[20.5, -20.0], &[20.5, -20.0], true), []);
        assert_eq!(kinds(&[25.0, -20.0], &[25.0, -20.0], false), [], "not recording: it may be on its way");
        let found = kinds(&[25.0, -20.0], &[25.0, -20.0], true);
        assert!(found.len() == 1 && found[0].0 == "off_mount", "{found:?}");
        assert!(
            found[0].1.contains("Axis 0 stands at 20.00 degrees") && found[0].1.contains("25.00"),
            "{found:?}"
        );
        assert_eq!(kinds(&[25.0, -20.0], &[20.0, -20.0], true), [], "better pitches were agreed to");
        assert_eq!(kinds(&[35.0, -20.0], &[20.0, -20.0], false)[0].0, "mount_out_of_reach");
        assert_eq!(kinds(&[20.0; 3], &[20.0; 3], true).len(), 1, "three sensors, two axes");
        assert_eq!(kinds(&[], &[], true), [], "no mount");
    }

    #[test]
    fn a_full_disk_says_what_to_do() {
        let mut recorder = RecorderStatus { free_bytes: Some(5 << 20), ..RecorderStatus::default() };
        recorder.last = Some(super::super::status::LastSession {
            name: "a".into(),
            dir: "a".into(),
            why: "disk_full",
            complete: true,
            packets: 1,
            bytes: 1,
            lost: 0,
            failure: None,
        });
        let mut list = List::default();
        of_recorder(&recorder, &mut list);
        assert!(list.0[0].what.contains("5 MiB") && list.0[0].advice.contains("Delete"), "{:?}", list.0);
    }
}
