//! What is wrong with the rig.

use super::List;
use crate::daemon::status::RigState;
use crate::drive::{AxisStatus, RigStatus};

/// An axis this far from its target while it holds is off target, degrees.
const OFF_TARGET_DEG: f64 = 0.5;
/// An axis this far from the mount's pitch sees other cells than predicted, degrees.
pub(in crate::daemon) const OFF_MOUNT_DEG: f64 = 1.0;

/// All that is wrong with the rig.
pub(super) fn problems(rig: &RigState, recording: bool, list: &mut List) {
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
        let what = if status.axes.iter().any(|axis| axis.source == "not_homed") {
            "The rig is not homed: its angles have no zero. Sessions say so, and the mount file's pitches count for them."
        } else {
            "The rig is not homed: it does not move."
        };
        list.warn("rig", "not_homed", what.into(), "Arm the rig and home it.");
    }
    status.axes.iter().for_each(|axis| of_axis(axis, list));
    reach(rig, status, list);
    if recording && rig.busy.is_none() {
        off_mount(rig, status, list);
    }
}

fn of_axis(axis: &AxisStatus, list: &mut List) {
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
            "Something blocks it, or it is overloaded.",
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

/// Whether the rig can go where the configured mount wants it.
fn reach(rig: &RigState, status: &RigStatus, list: &mut List) {
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
}

/// Whether the rig stands where the mount that goes into the session says.
fn off_mount(rig: &RigState, status: &RigStatus, list: &mut List) {
    let stands = |state: &str| matches!(state, "idle" | "holding");
    for (axis, pitch_deg) in status.axes.iter().zip(&rig.recorded_pitches_deg) {
        let is_known = axis.homed && axis.source != "stale" && stands(&axis.state);
        if is_known && (axis.position_deg - pitch_deg).abs() > OFF_MOUNT_DEG {
            list.warn(
                "rig",
                "off_mount",
                format!(
                    "Axis {} stands at {:.2} degrees, the mount that is recorded says {pitch_deg:.2}.",
                    axis.axis, axis.position_deg
                ),
                "The coverage is predicted for the mount. Apply it, or know that this recording is of other pitches: \
                 measured angles are recorded, too.",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_off_its_mount_is_reported_while_it_is_recorded() {
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
            problems(&rig, recording, &mut list);
            list.0.into_iter().map(|problem| (problem.kind, problem.what)).collect::<Vec<_>>()
        };
        assert_eq!(kinds(&[20.5, -20.0], &[20.5, -20.0], true), []);
        assert_eq!(kinds(&[25.0, -20.0], &[25.0, -20.0], false), [], "not recording: it may still move");
        let found = kinds(&[25.0, -20.0], &[25.0, -20.0], true);
        assert!(found.len() == 1 && found[0].0 == "off_mount", "{found:?}");
        assert!(
            found[0].1.contains("Axis 0 stands at 20.00 degrees") && found[0].1.contains("25.00"),
            "{found:?}"
        );
        assert_eq!(kinds(&[25.0, -20.0], &[20.0, -20.0], true), [], "better pitches were agreed to");
        assert_eq!(kinds(&[35.0, -20.0], &[20.0, -20.0], false)[0].0, "mount_out_of_reach");
        assert_eq!(
            kinds(&[20.0, -20.0, 0.0], &[20.0, -20.0, 0.0], true),
            [],
            "the third sensor does not turn"
        );
        assert_eq!(kinds(&[], &[], true), [], "no mount");
    }
}
