//! The TUM text format: `seconds x y z qx qy qz qw` per line, `#` comments. Source: TUM RGB-D benchmark, "File formats".

use glam::{DQuat, DVec3};

use super::{Trajectory, TrajectoryError};
use crate::geometry::Pose;

impl Trajectory {
    /// The trajectory as TUM text. Times keep every nanosecond, poses every bit.
    pub fn to_tum(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::from("# seconds x y z qx qy qz qw\n");
        for (time_ns, pose) in self.stamped() {
            let (at, turn) = (pose.translation_m, pose.rotation);
            let (seconds, nanoseconds) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
            // a String takes everything
            let _ = writeln!(
                text,
                "{seconds}.{nanoseconds:09} {} {} {} {} {} {} {}",
                at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w
            );
        }
        text
    }

    /// A trajectory from TUM text. Quaternions are normalised; anything else that is wrong is an error with its line.
    pub fn from_tum(text: &str) -> Result<Self, TrajectoryError> {
        let mut stamped = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let wrong = |reason: String| TrajectoryError::Line { line: index + 1, reason };
            let fields: Vec<&str> = line.split_ascii_whitespace().collect();
            let [time, numbers @ ..] = fields.as_slice() else { continue };
            if numbers.len() != 7 {
                return Err(wrong(format!("{} numbers, expected 8", fields.len())));
            }
            let mut values = [0.0_f64; 7];
            for (value, field) in values.iter_mut().zip(numbers) {
                *value = field
                    .parse()
                    .ok()
                    .filter(|number: &f64| number.is_finite())
                    .ok_or_else(|| wrong(format!("{field:?} is no finite number")))?;
            }
            let time_ns =
                nanoseconds(time).ok_or_else(|| wrong(format!("{time:?} is no time in seconds")))?;
            let [x, y, z, qx, qy, qz, qw] = values;
            let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
            if !(0.5..=2.0).contains(&rotation.length()) {
                return Err(wrong(format!("quaternion of length {}, expected 1", rotation.length())));
            }
            let rotation = if rotation.is_normalized() { rotation } else { rotation.normalize() };
            if stamped.last().is_some_and(|(before, _)| *before >= time_ns) {
                return Err(wrong("time does not increase".into()));
            }
            stamped.push((time_ns, Pose::new(rotation, DVec3::new(x, y, z))));
        }
        Self::new(stamped)
    }
}

/// Decimal seconds to nanoseconds without the rounding of a float; digits beyond the ninth decimal are cut.
fn nanoseconds(text: &str) -> Option<u64> {
    if text.contains(['e', 'E']) {
        let seconds: f64 = text.parse().ok().filter(|seconds| (0.0..1.8e10).contains(seconds))?;
        return Some((seconds * 1e9).round() as u64);
    }
    let (whole, decimals) = text.split_once('.').unwrap_or((text, ""));
    if !decimals.bytes().all(|digit| digit.is_ascii_digit()) || whole.len() + decimals.len() == 0 {
        return None;
    }
    let seconds: u64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
    let nine: String = decimals.chars().chain(std::iter::repeat('0')).take(9).collect();
    seconds.checked_mul(1_000_000_000)?.checked_add(nine.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_to_the_bit() {
        let pose =
            |x| Pose::new(DQuat::from_rotation_z(x) * DQuat::from_rotation_x(0.1), DVec3::splat(x / 3.0));
        let start = 1_763_722_223_123_456_789;
        let path = Trajectory::new(vec![(start, pose(0.1)), (start + 1, pose(0.2))]).unwrap();
        let text = path.to_tum();
        assert_eq!(Trajectory::from_tum(&text).unwrap(), path, "{text}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (line, words) in [
            ("1 2 3", "3 numbers"),
            ("x 0 0 0 0 0 0 1", "\"x\""),
            ("-1 0 0 0 0 0 0 1", "\"-1\""),
            ("1 0 0 NaN 0 0 0 1", "\"NaN\""),
            ("1 0 0 0 0 0 0 0", "length 0"),
            ("0.5 0 0 0 0 0 0 1", "does not increase"),
            ("99999999999999999999 0 0 0 0 0 0 1", "no time"),
        ] {
            let error = Trajectory::from_tum(&format!("# head\n0.5 0 0 0 0 0 0 1\n{line}\n"))
                .unwrap_err()
                .to_string();
            assert!(error.contains("line 3") && error.contains(words), "{line}: {error}");
        }
        assert_eq!(nanoseconds("1.5e0"), Some(1_500_000_000));
        assert_eq!(nanoseconds(".0000000019"), Some(1));
    }
}
