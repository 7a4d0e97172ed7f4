//! What blocks a rig's own beams: the other sensors' housings and the person who carries it.

use glam::DVec3;

use crate::rig::{MountedSensor, Rig};

/// A solid that moves with the body; body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Occluder {
    /// A round housing.
    Cylinder {
        /// Middle of the axis, m.
        centre_m: DVec3,
        /// Unit vector along the axis.
        axis: DVec3,
        /// Radius, m.
        radius_m: f64,
        /// Half the height, m.
        half_height_m: f64,
    },
    /// All points within a radius of a segment: a person.
    Capsule {
        /// One end of the segment, m.
        from_m: DVec3,
        /// The other end, m.
        to_m: DVec3,
        /// Radius, m.
        radius_m: f64,
    },
}

impl Occluder {
    /// The housing of a mounted sensor: a cylinder about its spin axis, its middle at the lidar origin.
    pub(crate) fn housing(sensor: &MountedSensor) -> Self {
        let body_from_sensor = sensor.mount.body_from_sensor();
        let lidar_origin_m = sensor.model.sensor_from_lidar().translation;
        Self::Cylinder {
            centre_m: body_from_sensor.transform_point(lidar_origin_m),
            axis: body_from_sensor.rotate(DVec3::Z),
            radius_m: sensor.model.housing_radius_m,
            half_height_m: 0.5 * sensor.model.housing_height_m,
        }
    }

    /// The housings of every other sensor of a rig.
    pub(crate) fn other_housings(rig: &Rig, sensor: usize) -> Vec<Self> {
        let others = rig.sensors.iter().enumerate().filter(|(index, _)| *index != sensor);
        others.map(|(_, other)| Self::housing(other)).collect()
    }

    /// Distance at which a ray (unit direction) enters the solid, 0 when it starts inside; none when it passes.
    pub(crate) fn distance_m(&self, origin_m: DVec3, direction: DVec3) -> Option<f64> {
        match *self {
            Self::Cylinder { centre_m, axis, radius_m, half_height_m } => {
                cylinder(origin_m - centre_m, direction, axis, radius_m, half_height_m)
            }
            Self::Capsule { from_m, to_m, radius_m } => {
                let half = 0.5 * (to_m - from_m);
                let half_height_m = half.length();
                let centre_m = 0.5 * (from_m + to_m);
                let tube = match half.try_normalize() {
                    Some(axis) => cylinder(origin_m - centre_m, direction, axis, radius_m, half_height_m),
                    None => None,
                };
                let ends = [from_m, to_m].map(|end| sphere(origin_m - end, direction, radius_m));
                [tube, ends[0], ends[1]].into_iter().flatten().reduce(f64::min)
            }
        }
    }
}

/// Roots of a t^2 + 2 b t + c, the entering one first.
fn roots(a: f64, b: f64, c: f64) -> Option<(f64, f64)> {
    let discriminant = b * b - a * c;
    (discriminant >= 0.0).then(|| {
        let root = discriminant.sqrt();
        ((-b - root) / a, (-b + root) / a)
    })
}

fn entering((near, far): (f64, f64)) -> Option<f64> {
    (far >= 0.0 && near <= far).then_some(near.max(0.0))
}

fn sphere(from_centre: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    let c = from_centre.length_squared() - radius * radius;
    roots(1.0, from_centre.dot(direction), c).and_then(entering)
}

fn cylinder(from_centre: DVec3, direction: DVec3, axis: DVec3, radius: f64, half_height: f64) -> Option<f64> {
    let (along, slope) = (from_centre.dot(axis), direction.dot(axis));
    let (out, sideways) = (from_centre - along * axis, direction - slope * axis);
    let slab = if slope == 0.0 {
        (along.abs() <= half_height).then_some((f64::NEG_INFINITY, f64::INFINITY))?
    } else {
        let ends = [(-half_height - along) / slope, (half_height - along) / slope];
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    };
    let (a, c) = (sideways.length_squared(), out.length_squared() - radius * radius);
    let tube = if a < 1e-24 {
        (c <= 0.0).then_some((f64::NEG_INFINITY, f64::INFINITY))?
    } else {
        roots(a, out.dot(sideways), c)?
    };
    entering((slab.0.max(tube.0), slab.1.min(tube.1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_can_is_hit_on_its_side_and_on_its_lid() {
        let can =
            Occluder::Cylinder { centre_m: DVec3::X, axis: DVec3::Z, radius_m: 0.1, half_height_m: 0.2 };
        assert!((can.distance_m(DVec3::ZERO, DVec3::X).unwrap() - 0.9).abs() < 1e-12);
        assert!((can.distance_m(DVec3::new(1.0, 0.0, 1.0), -DVec3::Z).unwrap() - 0.8).abs() < 1e-12);
        assert_eq!(can.distance_m(DVec3::new(0.0, 0.0, 0.3), DVec3::X), None);
        assert_eq!(can.distance_m(DVec3::ZERO, -DVec3::X), None);
        assert_eq!(can.distance_m(DVec3::X, DVec3::Y), Some(0.0));
    }

    #[test]
    fn a_capsule_has_round_ends() {
        let person = Occluder::Capsule { from_m: DVec3::ZERO, to_m: DVec3::Z, radius_m: 0.25 };
        let hit = person.distance_m(DVec3::new(0.0, 0.0, 3.0), -DVec3::Z).unwrap();
        assert!((hit - 1.75).abs() < 1e-12);
        assert!((person.distance_m(DVec3::new(2.0, 0.0, 0.5), -DVec3::X).unwrap() - 1.75).abs() < 1e-12);
        assert_eq!(person.distance_m(DVec3::new(2.0, 0.2, 1.2), -DVec3::X), None);
    }
}
