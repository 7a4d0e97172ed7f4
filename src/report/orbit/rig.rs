//! The rig in a 3-D picture: housings and fields of view where the trajectory begins, and the person who carries it.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Orbit, Shape};
use crate::base::geometry::Pose;
use crate::rig::Rig;
use crate::simulate::occluder::Occluder;

/// Colours of single sensors, in the order of the rig: as in charts of who saw what.
const SENSOR_CSS: [&str; 3] = ["c-left", "c-right", "c-odd"];
/// Length of the edges of a field of view, m, at most.
const VIEW_M: f64 = 6.0;
/// Parts of a circle.
const PARTS: usize = 24;

impl Orbit {
    /// Housings and fields of view of a rig with this pose, and what else stops its beams.
    pub(crate) fn rig(&mut self, rig: &Rig, world_from_body: &Pose, others: &[Occluder]) {
        let extent_m = self.bounds_m[1] - self.bounds_m[0];
        let view_m = VIEW_M.min(0.4 * extent_m.x.max(extent_m.y));
        for (number, sensor) in rig.sensors.iter().enumerate() {
            let css = SENSOR_CSS[number.min(SENSOR_CSS.len() - 1)];
            let housing = solid_m(&Occluder::housing(sensor), world_from_body);
            self.add(&sensor.name, css, Shape::Surface, housing, false);
            let world_from_sensor = *world_from_body * sensor.mount.body_from_sensor();
            let elevations = sensor.model.beams().iter().map(|beam| beam.elevation_rad);
            let (low, high) = elevations
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
            let origin_m = sensor.model.sensor_from_lidar().translation;
            let ring = |elevation: f64| {
                let (up, out) = elevation.sin_cos();
                ring_m(origin_m + view_m * up * DVec3::Z, view_m * out)
            };
            let mut lines: Vec<DVec3> = Vec::new();
            for rim in [ring(low), ring(high)] {
                lines.extend(rim.iter().zip(rim.iter().cycle().skip(1)).flat_map(|(from, to)| [*from, *to]));
                lines.extend(rim.iter().step_by(PARTS / 8).flat_map(|at| [origin_m, *at]));
            }
            let lines = lines.into_iter().map(|at| world_from_sensor.transform_point(at)).collect();
            self.add(&format!("field of view of {}", sensor.name), css, Shape::Lines, lines, false);
        }
        for other in others {
            self.add("operator", "c-faint", Shape::Surface, solid_m(other, world_from_body), false);
        }
    }
}

fn ring_m(middle_m: DVec3, radius_m: f64) -> Vec<DVec3> {
    let at = |part: usize| {
        let (sin, cos) = (TAU * part as f64 / PARTS as f64).sin_cos();
        middle_m + radius_m * DVec3::new(cos, sin, 0.0)
    };
    (0..PARTS).map(at).collect()
}

/// A solid as triangles: stacked rings around its axis.
fn solid_m(solid: &Occluder, world_from_body: &Pose) -> Vec<DVec3> {
    // height along the axis and radius of each ring
    let (foot_m, along, rings): (DVec3, DVec3, Vec<[f64; 2]>) = match *solid {
        Occluder::Cylinder { centre_m, axis, radius_m, half_height_m } => {
            let (low, high) = (-half_height_m, half_height_m);
            (centre_m, axis, vec![[low, 0.0], [low, radius_m], [high, radius_m], [high, 0.0]])
        }
        Occluder::Capsule { from_m, to_m, radius_m } => {
            let length_m = (to_m - from_m).length();
            let cap = |start: f64, from: i32| {
                (0..=4).map(move |step| {
                    let (sin, cos) = (0.25 * std::f64::consts::FRAC_PI_2 * f64::from(from + step)).sin_cos();
                    [start + radius_m * sin, radius_m * cos]
                })
            };
            let rings = cap(0.0, -4).chain(cap(length_m, 0)).collect();
            (from_m, (to_m - from_m).try_normalize().unwrap_or(DVec3::Z), rings)
        }
    };
    let (first, second) = along.any_orthonormal_pair();
    let at = |[height_m, radius_m]: [f64; 2], part: usize| {
        let (sin, cos) = (TAU * part as f64 / PARTS as f64).sin_cos();
        world_from_body.transform_point(foot_m + height_m * along + radius_m * (cos * first + sin * second))
    };
    let mut corners_m = Vec::new();
    for pair in rings.windows(2) {
        for part in 0..PARTS {
            let [a, b, c, d] =
                [at(pair[0], part), at(pair[0], part + 1), at(pair[1], part + 1), at(pair[1], part)];
            corners_m.extend([a, b, c, a, c, d]);
        }
    }
    corners_m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solid_is_as_large_as_it_is() {
        let person = Occluder::Capsule { from_m: DVec3::ZERO, to_m: 1.2 * DVec3::Z, radius_m: 0.3 };
        let can =
            Occluder::Cylinder { centre_m: DVec3::ZERO, axis: DVec3::X, radius_m: 0.05, half_height_m: 0.04 };
        for (solid, low, high) in
            [(person, [-0.3, -0.3, -0.3], [0.3, 0.3, 1.5]), (can, [-0.04, -0.05, -0.05], [0.04, 0.05, 0.05])]
        {
            let moved = Pose::from_translation(DVec3::new(5.0, 0.0, 0.0));
            let corners = solid_m(&solid, &moved);
            let least = corners.iter().copied().reduce(DVec3::min).unwrap() - 5.0 * DVec3::X;
            let most = corners.iter().copied().reduce(DVec3::max).unwrap() - 5.0 * DVec3::X;
            assert!(
                least.abs_diff_eq(low.into(), 1e-9) && most.abs_diff_eq(high.into(), 1e-9),
                "{least} {most}"
            );
        }
    }
}
