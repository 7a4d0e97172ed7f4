//! What a trajectory says about itself: length, gaps, jumps.

use glam::DVec3;

use super::Trajectory;

/// Something between two neighbouring poses that no walk does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspicion {
    /// The later of the two poses, counted from 0.
    pub index: usize,
    /// What is odd.
    pub kind: SuspicionKind,
}

/// Kinds of [`Suspicion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SuspicionKind {
    /// No pose for this long, s.
    Gap {
        /// Time between the poses, s.
        seconds: f64,
    },
    /// Faster than the limit, m/s.
    Jump {
        /// Speed between the poses, m/s.
        speed_m_s: f64,
    },
    /// Turns faster than the limit, rad/s.
    Spin {
        /// Turn rate between the poses, rad/s.
        turn_rad_s: f64,
    },
}

/// Limits beyond which two neighbouring poses are suspicious.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkLimits {
    /// Longest time between poses, s.
    pub gap_s: f64,
    /// Maximum speed, m/s.
    pub speed_m_s: f64,
    /// Maximum turn rate, rad/s.
    pub turn_rad_s: f64,
}

impl Default for WalkLimits {
    /// A carried or wheeled platform indoors: poses at least every half second, 5 m/s, 360 deg/s.
    fn default() -> Self {
        Self { gap_s: 0.5, speed_m_s: 5.0, turn_rad_s: std::f64::consts::TAU }
    }
}

impl std::fmt::Display for Suspicion {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let index = self.index;
        match self.kind {
            SuspicionKind::Gap { seconds } => {
                write!(out, "{seconds:.3} s without a pose before pose {index}")
            }
            SuspicionKind::Jump { speed_m_s } => {
                write!(out, "a jump at {speed_m_s:.1} m/s to pose {index}")
            }
            SuspicionKind::Spin { turn_rad_s } => {
                write!(out, "a turn at {:.0} deg/s to pose {index}", turn_rad_s.to_degrees())
            }
        }
    }
}

impl Trajectory {
    /// Distance travelled, m.
    pub fn length_m(&self) -> f64 {
        self.world_from_body
            .windows(2)
            .map(|pair| pair[0].translation_m.distance(pair[1].translation_m))
            .fold(0.0, |sum, step| sum + step) // the sum of nothing is -0
    }

    /// Neighbouring poses beyond the limits, in order.
    pub fn suspicions(&self, limits: &WalkLimits) -> Vec<Suspicion> {
        let mut found = Vec::new();
        for index in 1..self.time_ns.len() {
            let seconds = (self.time_ns[index] - self.time_ns[index - 1]) as f64 * 1e-9;
            let [from, to] = [&self.world_from_body[index - 1], &self.world_from_body[index]];
            let speed_m_s = from.translation_m.distance(to.translation_m) / seconds;
            let turn_rad_s = from.rotation.angle_between(to.rotation) / seconds;
            if seconds > limits.gap_s {
                found.push(Suspicion { index, kind: SuspicionKind::Gap { seconds } });
            }
            if speed_m_s > limits.speed_m_s {
                found.push(Suspicion { index, kind: SuspicionKind::Jump { speed_m_s } });
            }
            if turn_rad_s > limits.turn_rad_s {
                found.push(Suspicion { index, kind: SuspicionKind::Spin { turn_rad_s } });
            }
        }
        found
    }

    /// Positions of the body along the path, the first, then every `step_m` travelled, m.
    pub fn stations_m(&self, step_m: f64) -> Vec<DVec3> {
        let mut stations = vec![self.world_from_body[0].translation_m];
        let mut left_m = step_m;
        for pair in self.world_from_body.windows(2) {
            let (from, to) = (pair[0].translation_m, pair[1].translation_m);
            let length_m = from.distance(to);
            let mut walked_m = 0.0;
            while step_m > 0.0 && length_m - walked_m >= left_m {
                walked_m += left_m;
                stations.push(from.lerp(to, walked_m / length_m));
                left_m = step_m;
            }
            left_m -= length_m - walked_m;
        }
        stations
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::base::geometry::Pose;

    #[test]
    fn stations_are_a_step_apart() {
        let walk = Trajectory::straight(DVec3::ZERO, DVec3::new(2.2, 0.0, 0.0), 1.0, 0);
        let stations = walk.stations_m(0.5);
        assert_eq!(stations.len(), 5);
        assert!((stations[4].x - 2.0).abs() < 1e-12);
    }

    #[test]
    fn gaps_jumps_and_spins_are_found() {
        let at = |x: f64, yaw: f64| Pose::new(DQuat::from_rotation_z(yaw), DVec3::new(x, 0.0, 0.0));
        let walk = Trajectory::new(vec![
            (0, at(0.0, 0.0)),
            (100_000_000, at(0.1, 0.0)),
            (1_100_000_000, at(0.2, 0.0)),
            (1_200_000_000, at(2.2, 0.0)),
            (1_300_000_000, at(2.3, 2.0)),
        ])
        .unwrap();
        let found = walk.suspicions(&WalkLimits::default());
        assert_eq!(found.iter().map(|s| s.index).collect::<Vec<_>>(), [2, 3, 4]);
        assert!(found[0].to_string().contains("1.000 s"), "{}", found[0]);
        assert!(found[1].to_string().contains("20.0 m/s"), "{}", found[1]);
        assert!(found[2].to_string().contains("1146 deg/s"), "{}", found[2]);
    }
}
