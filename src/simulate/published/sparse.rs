//! Some of the rays of one pose, with what they hit: enough for the registration strength of a scan.

use super::{PublishedBox, brute};
use crate::rig::MountDeg;

impl PublishedBox {
    /// Hits of every `column_step`-th column of a sensor at a pose (counted from 0): place relative to the body, m, and
    /// the wall's unit normal, turned against the ray; axes of the mount frame. Rays along an axis are not lost here.
    pub(crate) fn sparse_hits(
        &self,
        sensor: &MountDeg,
        pose: usize,
        column_step: usize,
        mut take: impl FnMut([f64; 3], [f64; 3]),
    ) {
        let preset = &self.experiment.preset;
        let simulator = self.of(sensor);
        let pose = self.pose(sensor, pose);
        let origin_m = pose.origin_m;
        for azimuth in (0..self.experiment.azimuths).step_by(column_step.max(1)) {
            for beam in 0..simulator.elevations.len() {
                let direction = brute::direction(simulator, &pose, azimuth, beam);
                let (mut exit_m, mut normal) = (f64::INFINITY, [0.0; 3]);
                for axis in 0..3 {
                    let ahead = direction[axis] > 0.0;
                    let wall_m = if ahead { preset.box_max_m[axis] } else { preset.box_min_m[axis] };
                    // no slope gives an infinite distance: that wall is never the nearest
                    let distance_m = (wall_m - origin_m[axis]) / direction[axis];
                    if distance_m.abs() < exit_m {
                        exit_m = distance_m.abs();
                        normal = [0.0; 3];
                        normal[axis] = if ahead { -1.0 } else { 1.0 };
                    }
                }
                let mut from_body_m = [sensor.x_m, sensor.y_m, sensor.z_m];
                (0..3).for_each(|axis| from_body_m[axis] += exit_m * direction[axis]);
                take(from_body_m, normal);
            }
        }
    }
}
