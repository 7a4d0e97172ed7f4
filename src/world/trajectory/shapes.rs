//! Planned walks: polylines and loops at constant speed, turning to where they go.

use glam::{DQuat, DVec3};

use super::{Trajectory, TrajectoryError};
use crate::base::geometry::Pose;

impl Trajectory {
    /// Along corners at constant speed (m/s), body x along the path. The body turns on the spot at a corner, at
    /// `turn_rad_s`. A vertical piece keeps the heading before it.
    ///
    /// # Errors
    /// Fewer than two different corners, a corner that is not finite, or a speed or turn rate that is not above 0.
    pub(crate) fn polyline(
        corners_m: &[DVec3],
        speed_m_s: f64,
        turn_rad_s: f64,
        start_ns: u64,
    ) -> Result<Self, TrajectoryError> {
        for (name, value) in [("speed", speed_m_s), ("turn rate", turn_rad_s)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(TrajectoryError::Shape { reason: format!("{name} {value}, expected above 0") });
            }
        }
        if let Some(corner) = corners_m.iter().position(|corner| !corner.is_finite()) {
            return Err(TrajectoryError::Shape { reason: format!("corner {corner} is not finite") });
        }
        let mut legs: Vec<(DVec3, DVec3, f64)> = Vec::new();
        for pair in corners_m.windows(2) {
            let step_m = pair[1] - pair[0];
            if step_m.length() < 1e-9 {
                continue;
            }
            let flat = step_m.truncate().length() > 1e-9 * step_m.length();
            let before = legs.last().map(|leg| leg.2).unwrap_or(0.0);
            legs.push((pair[0], pair[1], if flat { step_m.y.atan2(step_m.x) } else { before }));
        }
        let Some(first) = legs.first() else {
            return Err(TrajectoryError::Shape { reason: "a walk needs two different corners".into() });
        };
        let heading = |yaw_rad: f64| DQuat::from_rotation_z(yaw_rad);
        let mut stamped = vec![(start_ns, Pose::new(heading(first.2), first.0))];
        let mut yaw_rad = first.2;
        let mut seconds = 0.0;
        let mut push = |seconds: f64, pose: Pose| {
            let time_ns = start_ns + (seconds * 1e9).round() as u64;
            if stamped.last().is_none_or(|(before, _)| time_ns > *before) {
                stamped.push((time_ns, pose));
            }
        };
        for (from_m, to_m, next_rad) in legs {
            let turn = (next_rad - yaw_rad + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                - std::f64::consts::PI;
            // quarter turns at most, so that the shorter turn between two stamps is the turn meant
            let steps = (turn.abs() / std::f64::consts::FRAC_PI_2).ceil() as usize;
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let angle = yaw_rad + share * turn;
                push(seconds + share * turn.abs() / turn_rad_s, Pose::new(heading(angle), from_m));
            }
            seconds += turn.abs() / turn_rad_s;
            yaw_rad = next_rad;
            seconds += from_m.distance(to_m) / speed_m_s;
            push(seconds, Pose::new(heading(yaw_rad), to_m));
        }
        Self::new(stamped)
    }

    /// A closed walk: the corners and back to the first, ending with the heading it began with.
    ///
    /// # Errors
    /// As [`Trajectory::polyline`].
    pub(crate) fn closed_loop(
        corners_m: &[DVec3],
        speed_m_s: f64,
        turn_rad_s: f64,
        start_ns: u64,
    ) -> Result<Self, TrajectoryError> {
        let mut closed = corners_m.to_vec();
        closed.extend(corners_m.first());
        let walk = Self::polyline(&closed, speed_m_s, turn_rad_s, start_ns)?;
        let mut stamped: Vec<(u64, Pose)> = walk.stamped().collect();
        if let (Some(&(_, first)), Some(&(end_ns, last))) = (stamped.first(), stamped.last()) {
            let turn_rad = first.rotation.angle_between(last.rotation);
            if turn_rad > 1e-6 {
                let half = last.interpolate(&first, 0.5);
                let seconds = turn_rad / turn_rad_s;
                stamped.push((end_ns + (0.5 * seconds * 1e9).round().max(1.0) as u64, half));
                stamped.push((end_ns + (seconds * 1e9).round().max(2.0) as u64, first));
            }
        }
        Self::new(stamped)
    }

    /// The same walk with poses in between: the next one no later than so long after each, ns.
    pub(crate) fn filled(&self, longest_ns: u64) -> Self {
        let mut times_ns: Vec<u64> = Vec::new();
        for pair in self.time_ns.windows(2) {
            let span_ns = pair[1] - pair[0];
            let parts = span_ns.div_ceil(longest_ns);
            times_ns.extend(
                (0..parts).map(|part| {
                    pair[0] + (u128::from(span_ns) * u128::from(part) / u128::from(parts)) as u64
                }),
            );
        }
        let [_, end_ns] = self.time_span_ns();
        times_ns.push(end_ns);
        let world_from_body = times_ns.iter().filter_map(|time_ns| self.at(*time_ns)).collect();
        Self { time_ns: times_ns, world_from_body }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS_M: [DVec3; 4] = [
        DVec3::new(0.0, 0.0, 1.0),
        DVec3::new(4.0, 0.0, 1.0),
        DVec3::new(4.0, 3.0, 1.0),
        DVec3::new(0.0, 3.0, 1.0),
    ];

    #[test]
    fn a_loop_has_its_length_and_comes_back() {
        let walk = Trajectory::closed_loop(&CORNERS_M, 2.0, 1.0, 5).unwrap();
        assert!((walk.length_m() - 14.0).abs() < 1e-12);
        let [start, end] = walk.time_span_ns();
        let seconds = 14.0 / 2.0 + 4.0 * std::f64::consts::FRAC_PI_2;
        assert!(((end - start) as f64 * 1e-9 - seconds).abs() < 1e-6);
        let (first, last) = (walk.at(start).unwrap(), walk.at(end).unwrap());
        assert!(first.translation_m.distance(last.translation_m) < 1e-12);
        assert!(first.rotation.angle_between(last.rotation) < 1e-7);
    }

    #[test]
    fn the_body_looks_along_its_path() {
        let walk = Trajectory::polyline(&CORNERS_M, 1.0, 1.0, 0).unwrap();
        // 4 m, a quarter turn, then half of the 3 m
        let time_ns = ((4.0 + std::f64::consts::FRAC_PI_2 + 1.5) * 1e9) as u64;
        let pose = walk.at(time_ns).unwrap();
        assert!(pose.translation_m.distance(DVec3::new(4.0, 1.5, 1.0)) < 1e-6);
        assert!(pose.rotate(DVec3::X).distance(DVec3::Y) < 1e-6);
    }

    #[test]
    fn a_walk_to_nowhere_is_refused() {
        let same = [DVec3::ONE; 3];
        assert!(Trajectory::polyline(&same, 1.0, 1.0, 0).unwrap_err().to_string().contains("two different"));
        assert!(Trajectory::polyline(&CORNERS_M, 0.0, 1.0, 0).unwrap_err().to_string().contains("speed 0"));
        let broken = [DVec3::ZERO, DVec3::NAN];
        assert!(Trajectory::polyline(&broken, 1.0, 1.0, 0).unwrap_err().to_string().contains("corner 1"));
    }

    #[test]
    fn a_filled_walk_is_the_same_walk_without_gaps() {
        let walk = Trajectory::polyline(&CORNERS_M, 1.0, 1.0, 7).unwrap();
        let filled = walk.filled(100_000_000);
        assert!(filled.suspicions(&Default::default()).is_empty());
        assert_eq!(filled.time_span_ns(), walk.time_span_ns());
        assert!(walk.stamped().all(|(time_ns, pose)| filled.at(time_ns) == Some(pose)));
        for time_ns in (7..walk.time_span_ns()[1]).step_by(33_333_333) {
            let [a, b] = [&walk, &filled].map(|of| of.at(time_ns).unwrap());
            assert!(a.translation_m.distance(b.translation_m) < 1e-9, "{time_ns}");
            assert!(a.rotation.angle_between(b.rotation) < 1e-7, "{time_ns}");
        }
    }
}
