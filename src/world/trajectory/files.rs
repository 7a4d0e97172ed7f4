//! Trajectory files: TUM (`timestamp tx ty tz qx qy qz qw`, seconds and metres) and KITTI (the upper three rows of
//! `world_from_body`, row by row, no times). Errors name the line.

use std::fmt::Write as _;

use glam::{DMat3, DQuat, DVec3};

use super::{Trajectory, TrajectoryError};
use crate::base::geometry::Pose;

/// A pose and its time, ns.
pub(super) type Stamped = (u64, Pose);

/// Longest time between two poses of a file, s: what lies between them is filled in, at the cost of its length.
const LONGEST_GAP_S: f64 = 3600.0;
/// Longest distance between two poses of a file, m.
const LONGEST_JUMP_M: f64 = 10_000.0;
/// Coordinates beyond this are of no frame on this planet, m.
const FARTHEST_M: f64 = 1e8;
/// Rates of poses without times that are believed, Hz.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1e-3..=1e6;

/// How far the norm of a quaternion may be from 1 (a file with 4 digits is well inside).
const NORM_SLACK: f64 = 1e-2;
/// How far `R R^T` may be from the identity in any element.
const ORTHOGONAL_SLACK: f64 = 1e-2;

impl Trajectory {
    /// The TUM format; times with all nine digits, numbers that read back to the same pose.
    pub fn to_tum(&self) -> String {
        let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
        for (time_ns, pose) in self.stamped() {
            let (t, q) = (pose.translation_m, pose.rotation);
            let (seconds, nanoseconds) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
            let _ = writeln!(
                text,
                "{seconds}.{nanoseconds:09} {} {} {} {} {} {} {}",
                exact(t.x),
                exact(t.y),
                exact(t.z),
                exact(q.x),
                exact(q.y),
                exact(q.z),
                exact(q.w)
            );
        }
        text
    }

    /// The KITTI format; the times are lost.
    pub(crate) fn to_kitti(&self) -> String {
        let mut text = String::new();
        for (_, pose) in self.stamped() {
            let rotation = DMat3::from_quat(pose.rotation);
            for row in 0..3 {
                let r = rotation.row(row);
                let end = if row == 2 { "\n" } else { " " };
                let [x, y, z, t] = [r.x, r.y, r.z, pose.translation_m[row]].map(exact);
                let _ = write!(text, "{x} {y} {z} {t}{end}");
            }
        }
        text
    }
}

/// A number that reads back to the same, without a minus before nothing or a tail of zeros.
fn exact(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        small if small < 1e-6 => format!("{value:e}"),
        _ => value.to_string(),
    }
}

pub(super) fn numbers(fields: &[&str], line: usize) -> Result<Vec<f64>, TrajectoryError> {
    let mut values = Vec::with_capacity(fields.len());
    for field in fields {
        match field.parse::<f64>() {
            Ok(value) if value.is_finite() => values.push(value),
            _ => return Err(line_error(line, format!("{field:?} where a finite number is expected"))),
        }
    }
    Ok(values)
}

/// Refuses a rate that no poses have.
pub(super) fn check_rate(rate_hz: f64) -> Result<(), TrajectoryError> {
    if RATES_HZ.contains(&rate_hz) { Ok(()) } else { Err(TrajectoryError::Rate { rate_hz }) }
}

/// A quaternion that is a rotation.
pub(super) fn unit_quaternion(rotation: DQuat, line: usize) -> Result<DQuat, TrajectoryError> {
    if (rotation.length() - 1.0).abs() > NORM_SLACK {
        let found = format!("a quaternion of norm {:.4}, expected 1", rotation.length());
        return Err(TrajectoryError::Line { line, found });
    }
    // a rotation written by this program keeps every bit
    let is_unit = (rotation.length_squared() - 1.0).abs() < 1e-14;
    Ok(if is_unit { rotation } else { rotation.normalize() })
}

/// The pose of the 12 numbers of a 3 x 4 matrix, row by row, or of the 16 of a 4 x 4 one.
pub(super) fn rotation_of(n: &[f64], line: usize) -> Result<Pose, TrajectoryError> {
    if n.len() == 16 && n[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(line_error(line, format!("{:?} as the last row of a pose, expected 0 0 0 1", &n[12..])));
    }
    let rows = DMat3::from_cols(
        DVec3::new(n[0], n[1], n[2]),
        DVec3::new(n[4], n[5], n[6]),
        DVec3::new(n[8], n[9], n[10]),
    );
    let rotation = rows.transpose();
    let off = (rotation * rows).to_cols_array().into_iter().zip(DMat3::IDENTITY.to_cols_array());
    let worst = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    if worst > ORTHOGONAL_SLACK || rotation.determinant() < 0.0 {
        let found = format!(
            "a matrix that is no rotation (determinant {:.4}, off by {worst:.4})",
            rotation.determinant()
        );
        return Err(TrajectoryError::Line { line, found });
    }
    Ok(Pose::new(DQuat::from_mat3(&rotation).normalize(), DVec3::new(n[3], n[7], n[11])))
}

/// Refuses a pose that cannot be of one walk with the poses before it: one wrong number is not worth a year of simulated rays.
pub(super) fn check_bounds(stamped: &[Stamped], line: usize, next: Stamped) -> Result<(), TrajectoryError> {
    let at_m = next.1.translation_m;
    if at_m.abs().max_element() > FARTHEST_M {
        return Err(line_error(
            line,
            format!("a pose at {at_m} m, expected coordinates within {FARTHEST_M:e} m of 0"),
        ));
    }
    let Some((before_ns, before)) = stamped.last() else { return Ok(()) };
    let gap_s = next.0.saturating_sub(*before_ns) as f64 * 1e-9;
    if gap_s > LONGEST_GAP_S {
        let found = format!(
            "{gap_s:.0} s after the pose before it, expected at most {LONGEST_GAP_S} s: correct the time, or cut the \
             file there"
        );
        return Err(line_error(line, found));
    }
    let jump_m = at_m.distance(before.translation_m);
    if jump_m > LONGEST_JUMP_M {
        let found = format!(
            "{jump_m:.0} m from the pose before it, expected at most {LONGEST_JUMP_M} m: correct the position, or leave the \
             line out"
        );
        return Err(line_error(line, found));
    }
    Ok(())
}

pub(super) fn line_error(line: usize, found: String) -> TrajectoryError {
    TrajectoryError::Line { line, found }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, rate_hz: Option<f64>) -> Result<Trajectory, TrajectoryError> {
        Trajectory::read(text.as_bytes(), rate_hz).map(|read| read.trajectory)
    }

    #[test]
    fn tum_reads_back_to_the_bit() {
        let turn = DQuat::from_rotation_z(0.3) * DQuat::from_rotation_x(-0.1);
        let stamped = vec![
            (1_700_000_000_000_000_001, Pose::new(turn, DVec3::new(0.1, -2.0 / 3.0, 1e-9))),
            (1_700_000_000_005_000_000, Pose::new(turn.inverse(), DVec3::new(5e3, 0.0, 1.0))),
        ];
        let trajectory = Trajectory::new(stamped).unwrap();
        let again = read(&trajectory.to_tum(), None).unwrap();
        for ((t0, p0), (t1, p1)) in trajectory.stamped().zip(again.stamped()) {
            assert_eq!((t0, p0.translation_m), (t1, p1.translation_m));
            assert!(p0.rotation.angle_between(p1.rotation) < 1e-7);
        }
    }

    #[test]
    fn kitti_reads_back() {
        let turn = DQuat::from_rotation_y(1.0) * DQuat::from_rotation_z(2.0);
        let stamped = vec![(0, Pose::IDENTITY), (100_000_000, Pose::new(turn, DVec3::new(1.0, 2.0, 3.0)))];
        let trajectory = Trajectory::new(stamped).unwrap();
        let again = read(&trajectory.to_kitti(), Some(10.0)).unwrap();
        for ((t0, p0), (t1, p1)) in trajectory.stamped().zip(again.stamped()) {
            assert_eq!((t0, p0.translation_m), (t1, p1.translation_m));
            assert!(p0.rotation.angle_between(p1.rotation) < 1e-7);
        }
    }

    #[test]
    fn errors_name_the_line_and_what_was_found() {
        let tum = |text: &str| read(text, None).unwrap_err().to_string();
        let good = "# comment\n0.0 0 0 0 0 0 0 1\n";
        for (line, part) in [
            ("0.1 0 0 0 0 0 1\n", "7 fields"),
            ("0.1 0 0 nan 0 0 0 1\n", "\"nan\""),
            ("0.1 0 0 0 0 0 0 2\n", "norm 2.0"),
            ("0.1 0 0 0 0 0 0 0\n", "norm 0.0"),
            ("-1 0 0 0 0 0 0 1\n", "where seconds are expected"),
        ] {
            let error = tum(&format!("{good}{line}"));
            assert!(error.contains("line 3") && error.contains(part), "{error}");
        }
        assert!(tum("# nothing\n").contains("at least one pose"));
        let kitti = |text: &str, rate_hz: f64| read(text, Some(rate_hz)).unwrap_err().to_string();
        assert!(kitti("1 0 0 0 0 1 0 0 0 0 1\n", 10.0).contains("11 fields"));
        assert!(kitti("1 0 0 0 0 1 0 0 0 0 -1 0\n", 10.0).contains("no rotation"));
        assert!(kitti("1 0 0 0 0 1 0 0 0 0 1 0\n", 0.0).contains("rate"));
    }

    #[test]
    fn one_pose_far_off_is_refused_with_its_line() {
        let walk = |line: &str| read(&format!("10 0 0 0 0 0 0 1\n{line}\n"), None);
        let refused = |line: &str| walk(line).unwrap_err().to_string();
        let late = refused("1000000010 1 0 0 0 0 0 1");
        assert!(late.contains("line 2: 1000000000 s after the pose before it"), "{late}");
        let far = refused("11 1e7 0 0 0 0 0 1");
        assert!(far.contains("line 2: 10000000 m from the pose before it"), "{far}");
        assert!(refused("11 1e30 0 0 0 0 0 1").contains("within 1e8 m"));
        // what one may have: an hour's rest, a map in UTM
        assert!(walk("3610 9000 0 0 0 0 0 1").is_ok());
        assert!(read("1 412345 5567890 3e2 0 0 0 1\n2 412346 5567890 3e2 0 0 0 1\n", None).is_ok());
        let still = "1 0 0 0 0 1 0 0 0 0 1 0\n";
        for rate_hz in [0.0, -1.0, 1e-9, 1e9, f64::NAN, f64::INFINITY] {
            let error = read(&still.repeat(2), Some(rate_hz)).unwrap_err().to_string();
            assert!(error.contains("0.001 to 1000000"), "{error}");
        }
    }
}
