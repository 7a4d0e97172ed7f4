//! Sensors that a recording shows away from their nominal mount.

use super::comparison::Comparison;
use crate::verify::calibrate::{Estimate, SensorCheck};

/// A tilt below this is not worth a word, degrees: coverage does not feel it and servos do not reach it.
const TILT_MATTERS_DEG: f64 = 0.1;
/// And it must be this sure.
const TILT_P: f64 = 0.003;

/// The other turns of a mount are known less surely, and there are more of them.
const TURN_P: f64 = 0.001;
/// Shifts of a mount below this are not worth a word, mm, nor are half as large ones of ranges: plates are not measured better.
const SHIFT_MATTERS_MM: f64 = 30.0;

/// No sensor is mounted so far from its nominal mount, mm.
const NO_MOUNT_MM: f64 = 500.0;

/// Whether an estimate is no chance and large enough to be felt.
fn matters(value: f64, u95: f64, least: f64, p_value: f64, most_p: f64) -> bool {
    value.abs() > least.max(u95) && p_value < most_p
}

fn shift_matters(shift: &Estimate) -> bool {
    matters(shift.value, shift.u95, SHIFT_MATTERS_MM, shift.p_value, TURN_P)
}

/// How a sensor surely differs from its nominal mount.
pub(crate) fn off_its_slot(check: &SensorCheck) -> Vec<String> {
    let mut words = Vec::new();
    let sensor = &check.sensor;
    if let (Some(tilt), Some(u95), Some(p_value)) = (check.tilt_error_deg, check.u95_deg, check.p_value)
        && matters(tilt, u95, TILT_MATTERS_DEG, p_value, TILT_P)
    {
        words.push(format!("{sensor} is tilted {tilt:+.2} ± {u95:.2} degrees from its nominal mount"));
    }
    let [roll, _, yaw] = check.rotation_deg;
    for (turn, what) in [(roll, "rolled"), (yaw, "turned about the vertical by")] {
        if let Some(turn) = turn.filter(|t| matters(t.value, t.u95, TILT_MATTERS_DEG, t.p_value, TURN_P)) {
            let (value, u95) = (turn.value, turn.u95);
            words.push(format!("{sensor} is {what} {value:+.2} ± {u95:.2} degrees from its nominal mount"));
        }
    }
    for (shift, axis) in check.translation_mm.iter().zip(["right", "ahead", "up"]) {
        if let Some(shift) = shift.filter(shift_matters) {
            words.push(format!(
                "{sensor} sits {:+.0} ± {:.0} mm {axis} of its nominal mount",
                shift.value, shift.u95
            ));
        }
    }
    words
}

/// Whether trajectory or scene rather have the shifts: every sensor has the same, or one has more than any mount.
fn shifts_are_shared(checks: &[SensorCheck]) -> bool {
    let Some((first, others)) = checks.split_first() else { return false };
    (0..3).any(|axis| {
        let Some(shift) = first.translation_mm[axis].filter(shift_matters) else { return false };
        let is_alike = |other: &SensorCheck| {
            other.translation_mm[axis].filter(shift_matters).is_some_and(|other| {
                (other.value - shift.value).abs() < shift.u95.hypot(other.u95).max(SHIFT_MATTERS_MM)
            })
        };
        others.iter().all(is_alike) && (!others.is_empty() || shift.value.abs() > NO_MOUNT_MM)
    })
}

/// What is surely off of the mounts.
pub(crate) fn off(comparison: &Comparison) -> Vec<String> {
    let mut words: Vec<String> = comparison.mount.iter().flat_map(off_its_slot).collect();
    if shifts_are_shared(&comparison.mount) {
        words.push(
            "rather than the mounts, the trajectory or the scene is shifted by that: do both begin at one point (an \
             odometry begins at its own), and do the clocks agree (--time-offset search tells)?"
                .into(),
        );
    }
    if let Some(relative) = &comparison.relative_tilt
        && matters(relative.error_deg, relative.u95_deg, TILT_MATTERS_DEG, relative.p_value, TILT_P)
    {
        let [first, second] = &relative.sensors;
        words.push(format!(
            "{first} against {second}: {:+.3} ± {:.3} degrees of pitch above nominal",
            relative.error_deg, relative.u95_deg
        ));
    }
    words
}

/// Ranges that are surely too long or too short.
pub(crate) fn off_in_range(check: &SensorCheck) -> Option<String> {
    let offset = check.range_offset_mm?;
    matters(offset.value, offset.u95, 0.5 * SHIFT_MATTERS_MM, offset.p_value, TURN_P).then(|| {
        let what = if offset.value > 0.0 { "long" } else { "short" };
        format!("{}: ranges are {:.0} ± {:.0} mm too {what}", check.sensor, offset.value.abs(), offset.u95)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(ahead_mm: Option<f64>, right_mm: f64) -> SensorCheck {
        let estimate = |value| Estimate { value, sd: 5.0, u95: 10.0, p_value: 1e-9 };
        SensorCheck {
            translation_mm: [Some(estimate(right_mm)), ahead_mm.map(estimate), None],
            ..SensorCheck::undetermined("a", Default::default())
        }
    }

    #[test]
    fn what_all_sensors_share_is_not_their_mounts() {
        assert!(shifts_are_shared(&[check(Some(200.0), 5.0), check(Some(190.0), -40.0)]));
        assert!(shifts_are_shared(&[check(Some(-900.0), 0.0)]));
        for mounts in [
            &[check(Some(200.0), 0.0), check(Some(-200.0), 0.0)][..],
            &[check(Some(200.0), 0.0), check(None, 0.0)],
            &[check(Some(20.0), 0.0), check(Some(20.0), 0.0)],
            &[check(Some(200.0), 0.0)],
            &[],
        ] {
            assert!(!shifts_are_shared(mounts), "{mounts:?}");
        }
    }
}
