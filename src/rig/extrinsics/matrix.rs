//! A rigid transform out of sixteen numbers, each doubt named.

use glam::{DMat3, DQuat, DVec3};

use crate::base::geometry::Pose;

/// Beyond this a number of the last row is no rounding.
const ROW_TOLERANCE: f64 = 1e-6;
/// Columns of a rotation that are off their length or their right angles by more are no rotation.
const ROTATION_TOLERANCE: f64 = 2e-3;
/// Below this they are rounded and need no words.
const ROUNDED: f64 = 1e-5;

/// The pose of a 4x4 matrix, row by row (metres), and what was corrected.
///
/// # Errors
/// It is no rigid transform: which number, and what to do, in words.
pub(super) fn pose(numbers: &[f64; 16]) -> Result<(Pose, Option<String>), String> {
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        return Err(format!(
            "row {}, column {} is {}: expected a finite number",
            at / 4 + 1,
            at % 4 + 1,
            numbers[at]
        ));
    }
    let is_last = |found: [f64; 4]| {
        found[..3].iter().all(|number| number.abs() <= ROW_TOLERANCE)
            && (found[3] - 1.0).abs() <= ROW_TOLERANCE
    };
    let row = [numbers[12], numbers[13], numbers[14], numbers[15]];
    let column = [numbers[3], numbers[7], numbers[11], numbers[15]];
    let transposed = match (is_last(row), is_last(column)) {
        (true, _) => false,
        (false, true) => true,
        (false, false) => {
            return Err(format!("the last row is {row:?}, expected 0 0 0 1: no rigid transform, row by row"));
        }
    };
    let at = |row: usize, column: usize| {
        if transposed { numbers[4 * column + row] } else { numbers[4 * row + column] }
    };
    let column = |column: usize| DVec3::new(at(0, column), at(1, column), at(2, column));
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let mut notices = Vec::new();
    if transposed {
        notices.push("written column by column, read as that".to_owned());
    }
    if let Some(notice) = doubt(rotation)? {
        notices.push(notice);
    }
    // nearest rotation: the quaternion of a nearly orthonormal matrix, normalised
    let pose = Pose::new(DQuat::from_mat3(&rotation).normalize(), column(3));
    Ok((pose, (!notices.is_empty()).then(|| notices.join("; "))))
}

/// What is off about a rotation: an error where it is none, a notice where it was rounded.
fn doubt(rotation: DMat3) -> Result<Option<String>, String> {
    let lengths = [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(DVec3::length);
    let mean = lengths.iter().sum::<f64>() / 3.0;
    let products = rotation.transpose() * rotation - DMat3::IDENTITY;
    let off = products.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    if off > ROTATION_TOLERANCE {
        let even = lengths.iter().all(|length| (length / mean - 1.0).abs() < 1e-3);
        return Err(if even && (mean - 1.0).abs() > ROTATION_TOLERANCE {
            format!("the rotation is scaled by {mean:.6}, expected 1: divide its nine numbers by that")
        } else {
            format!(
                "its upper left 3x3 is off a rotation by {off:.4} (columns of length {:.4}, {:.4}, {:.4}), expected at most \
                 {ROTATION_TOLERANCE}",
                lengths[0], lengths[1], lengths[2]
            )
        });
    }
    if rotation.determinant() < 0.0 {
        return Err("its determinant is -1: one axis is reversed, a mirror image and no rotation".into());
    }
    Ok((off > ROUNDED)
        .then(|| format!("its rotation was rounded (off by {off:.1e}) and is made whole again")))
}

/// A unit quaternion out of x, y, z, w.
///
/// # Errors
/// It is none, in words.
pub(super) fn quaternion(xyzw: [f64; 4]) -> Result<DQuat, String> {
    let quaternion = DQuat::from_array(xyzw);
    let length = quaternion.length();
    if !(length.is_finite() && (length - 1.0).abs() < 1e-2) {
        return Err(format!("the quaternion x y z w {xyzw:?} has length {length:.6}, expected 1"));
    }
    Ok(quaternion.normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUARTER: [f64; 16] =
        [0.0, -1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0];

    fn changed(change: impl Fn(&mut [f64; 16])) -> [f64; 16] {
        let mut numbers = QUARTER;
        change(&mut numbers);
        numbers
    }

    #[test]
    fn a_quarter_turn_is_read_by_rows_and_by_columns() {
        let (by_rows, notice) = pose(&QUARTER).unwrap();
        assert!((by_rows.rotation * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12) && notice.is_none());
        assert_eq!(by_rows.translation_m, DVec3::new(0.1, 0.2, 0.3));
        let transposed: [f64; 16] = std::array::from_fn(|at| QUARTER[4 * (at % 4) + at / 4]);
        let (by_columns, notice) = pose(&transposed).unwrap();
        assert_eq!(by_columns, by_rows);
        assert!(notice.unwrap().contains("column by column"));
    }

    #[test]
    fn what_is_no_rigid_transform_is_refused_by_its_reason() {
        for (numbers, words) in [
            (changed(|n| n[5] = f64::NAN), "row 2, column 2"),
            (changed(|n| n[15] = 2.0), "0 0 0 1"),
            (changed(|n| n[10] = -1.0), "mirror image"),
            (changed(|n| (0..12).filter(|at| at % 4 < 3).for_each(|at| n[at] *= 1000.0)), "scaled by 1000"),
            (changed(|n| n[0] = 0.1), "off a rotation by"),
        ] {
            let reason = pose(&numbers).unwrap_err();
            assert!(reason.contains(words), "{reason}");
        }
        assert!(pose(&changed(|n| n[0] = 1e-4)).unwrap().1.unwrap().contains("rounded"));
        assert!(quaternion([0.0, 0.0, 0.0, 0.0]).is_err());
    }
}
