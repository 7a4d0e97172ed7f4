//! Whether housings touch as they are tilted: two upright cylinders are apart when their origins keep the sum of their radii,
//! tilted or tall ones need not be.

use glam::DVec3;

use super::{MountedSensor, Rig};

/// Housings nearer than this count as touching, m.
const TOUCH_M: f64 = 1e-4;
/// Alternating projections; their error falls below a tenth of a millimetre long before, unless housings graze.
const ROUNDS: usize = 400;

/// Two sensors with housings that touch.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Touching {
    /// One sensor.
    pub first: String,
    /// The other.
    pub second: String,
}

impl std::fmt::Display for Touching {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the housings of {} and {} touch as they are tilted", self.first, self.second)
    }
}

impl Rig {
    /// Pairs of sensors with housings (cylinders of the models' radius, tilted with them) that touch or lie in each other.
    pub(crate) fn touching(&self) -> Vec<Touching> {
        let mut pairs = Vec::new();
        for (index, first) in self.sensors.iter().enumerate() {
            for second in &self.sensors[index + 1..] {
                if housing_gap_m(first, second) < TOUCH_M {
                    pairs.push(Touching { first: first.name.clone(), second: second.name.clone() });
                }
            }
        }
        pairs
    }

    /// 0 where no housings touch; otherwise how much farther apart the centres of those that do would have to be for no
    /// tilt to let them touch, summed over pairs, m.
    pub(crate) fn housing_shortfall_m(&self) -> f64 {
        let mut missing_m = 0.0;
        for (index, first) in self.sensors.iter().enumerate() {
            for second in &self.sensors[index + 1..] {
                if housing_gap_m(first, second) < TOUCH_M {
                    let (a, b) = (Cylinder::of(first), Cylinder::of(second));
                    let apart_m = a.centre_m.distance(b.centre_m);
                    missing_m += (a.reach_m() + b.reach_m() - apart_m).max(TOUCH_M);
                }
            }
        }
        missing_m
    }
}

/// Least distance between two housings, m; next to 0 where they touch. Both are convex: going from the nearest point of
/// one to the nearest of the other and back ends at the nearest pair (Cheney and Goldstein 1959,
/// doi:10.2307/2032908).
pub(crate) fn housing_gap_m(first: &MountedSensor, second: &MountedSensor) -> f64 {
    let (a, b) = (Cylinder::of(first), Cylinder::of(second));
    let mut at = a.centre_m;
    let mut gap_m = f64::INFINITY;
    for _ in 0..ROUNDS {
        let there = b.nearest_to(at);
        at = a.nearest_to(there);
        gap_m = at.distance(there);
        if gap_m < TOUCH_M {
            break;
        }
    }
    gap_m
}

struct Cylinder {
    centre_m: DVec3,
    axis: DVec3,
    radius_m: f64,
    half_height_m: f64,
}

impl Cylinder {
    fn of(sensor: &MountedSensor) -> Self {
        Self {
            centre_m: sensor.lidar_origin_m(),
            axis: sensor.spin_axis(),
            radius_m: sensor.model.housing_radius_m,
            half_height_m: 0.5 * sensor.model.housing_height_m,
        }
    }

    /// From the centre to the rim.
    fn reach_m(&self) -> f64 {
        self.radius_m.hypot(self.half_height_m)
    }

    fn nearest_to(&self, point_m: DVec3) -> DVec3 {
        let from_centre = point_m - self.centre_m;
        let along_m = from_centre.dot(self.axis);
        let out = (from_centre - along_m * self.axis).clamp_length_max(self.radius_m);
        self.centre_m + along_m.clamp(-self.half_height_m, self.half_height_m) * self.axis + out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Mount;

    fn sensor(model: &str, mount: Mount) -> MountedSensor {
        let model = sensors::catalogue::nominal(model).unwrap();
        MountedSensor { name: format!("at {}", mount.x_m), model, mount }
    }

    #[test]
    fn upright_housings_are_apart_by_their_radii_and_heights() {
        let at = |x_m| sensor("os1-64", Mount { x_m, ..Mount::default() });
        assert!((housing_gap_m(&at(0.0), &at(0.1)) - 0.013).abs() < 1e-6);
        let tall = |z_m| sensor("hdl-64e-s3", Mount { z_m, ..Mount::default() });
        // apart by more than both radii, yet each stands in the other
        assert!(housing_gap_m(&tall(0.0), &tall(0.25)) < TOUCH_M);
        assert!((housing_gap_m(&tall(0.0), &tall(0.3)) - 0.017).abs() < 1e-6);
    }

    #[test]
    fn housings_that_lean_together_meet_at_their_heads() {
        let leaning = |x_m, pitch_deg: f64| {
            sensor("os1-64", Mount { x_m, pitch_rad: pitch_deg.to_radians(), ..Mount::default() })
        };
        let pair = |x_m| Rig { sensors: vec![leaning(x_m, -25.0), leaning(-x_m, 25.0)] };
        // from the mount's origin to the middle, half the height on, and the radius, each as the tilt has it
        let model = sensors::catalogue::nominal("os1-64").unwrap();
        let head_m = model.sensor_from_lidar().translation.z + 0.5 * model.housing_height_m;
        let reach_m = head_m * 25.0_f64.to_radians().sin() + 0.0435 * 25.0_f64.to_radians().cos();
        assert_eq!(pair(reach_m - 0.001).touching().len(), 1);
        assert!(pair(reach_m - 0.001).clearances(0.0)[0].is_sufficient(), "the origins are far enough apart");
        let shortfall_m = |x_m| pair(x_m).housing_shortfall_m();
        assert!(shortfall_m(reach_m - 0.01) > shortfall_m(reach_m - 0.001));
        assert_eq!(shortfall_m(reach_m + 0.001), 0.0);
        assert!(pair(reach_m + 0.001).touching().is_empty());
        let gap_m = housing_gap_m(&leaning(reach_m + 0.01, -25.0), &leaning(-reach_m - 0.01, 25.0));
        assert!((gap_m - 0.02).abs() < 1e-4, "{gap_m}");
    }

    #[test]
    fn published_pairs_of_which_two_can_be_built() {
        let pair = |model: &str, x_m: f64, y_m: f64, z_m: f64, pitch_deg: f64| {
            let mount = Mount { x_m, y_m, z_m, pitch_rad: pitch_deg.to_radians(), ..Mount::default() };
            Rig::mirrored(vec![sensor(model, mount)]).touching().len()
        };
        assert_eq!(pair("os1-64", 0.074, 0.25, 0.119, 32.7), 0);
        assert_eq!(pair("vlp-16", 0.07, -0.004, 0.118, 37.55), 0);
        assert_eq!(pair("os1-64", 0.028, 0.17, 0.02, 26.0), 1);
        assert_eq!(pair("vlp-16", 0.03, -0.018, 0.129, 41.99), 1);
        assert_eq!(pair("vlp-16", 0.0365, -0.1184, 0.1153, 38.0), 1);
    }
}
