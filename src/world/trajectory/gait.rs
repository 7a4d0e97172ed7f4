//! How a walking body moves about its path: it sways, bobs and turns with every step.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::Trajectory;
use crate::base::geometry::Pose;

/// Poses per second: motion between them is straight, and a step takes about half a second.
const POSES_PER_S: f64 = 100.0;

/// Amplitudes of a walk. The default is the order of a human trunk's: steps at 1.8 Hz, 2 cm to each side, 2 cm up and
/// down (Whittle 1997, doi:10.1016/S0167-9457(96)00052-8), turns of one to two degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gait {
    /// Steps per second; swaying and turning take two steps, bobbing one.
    pub step_hz: f64,
    /// To the left and right, m.
    pub sway_m: f64,
    /// Up and down, m.
    pub bob_m: f64,
    /// About the direction of travel, rad.
    pub roll_rad: f64,
    /// About the lateral axis, rad.
    pub pitch_rad: f64,
    /// About the vertical, rad.
    pub yaw_rad: f64,
}

impl Default for Gait {
    fn default() -> Self {
        Self {
            step_hz: 1.8,
            sway_m: 0.02,
            bob_m: 0.02,
            roll_rad: 1.5_f64.to_radians(),
            pitch_rad: 1.0_f64.to_radians(),
            yaw_rad: 2.0_f64.to_radians(),
        }
    }
}

impl Gait {
    /// The same path at the same times, walked: poses every 10 ms and at the end.
    pub(crate) fn walk(&self, path: &Trajectory) -> Trajectory {
        let [start_ns, end_ns] = path.time_span_ns();
        let step_ns = (1e9 / POSES_PER_S) as u64;
        let times = (start_ns..end_ns).step_by(step_ns as usize).chain([end_ns]);
        let stamped = times.filter_map(|time_ns| {
            let seconds = (time_ns - start_ns) as f64 * 1e-9;
            Some((time_ns, path.at(time_ns)? * self.swayed(seconds)))
        });
        // times are those of a trajectory, thinned or filled in order
        Trajectory::new(stamped.collect()).unwrap_or_else(|_| path.clone())
    }

    /// Body on the path from body as walked, s after the first step.
    fn swayed(&self, seconds: f64) -> Pose {
        let stride = (TAU * self.step_hz / 2.0 * seconds).sin();
        // a quarter of a stride apart, as the trunk turns ahead of its sway
        let stride_ahead = (TAU * self.step_hz / 2.0 * seconds).cos();
        let step = (TAU * self.step_hz * seconds).sin();
        let rotation = DQuat::from_rotation_z(self.yaw_rad * stride_ahead)
            * DQuat::from_rotation_y(self.pitch_rad * step)
            * DQuat::from_rotation_x(self.roll_rad * stride);
        Pose::new(rotation, DVec3::new(0.0, self.sway_m * stride, self.bob_m * step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_follows_its_path() {
        let path = Trajectory::straight(DVec3::ZERO, DVec3::new(10.0, 0.0, 0.0), 2.0, 5_000);
        let walked = Gait::default().walk(&path);
        assert_eq!(walked.time_span_ns(), path.time_span_ns());
        let mut farthest_m: f64 = 0.0;
        for (time_ns, pose) in walked.stamped() {
            let straight = path.at(time_ns).unwrap();
            farthest_m = farthest_m.max(pose.translation_m.distance(straight.translation_m));
            assert!(pose.rotation.angle_between(straight.rotation) < 3f64.to_radians());
        }
        assert!((0.02..0.03).contains(&farthest_m), "{farthest_m}");
    }
}
