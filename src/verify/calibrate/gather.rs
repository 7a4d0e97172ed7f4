//! Rays cast from the mounts as they stand, and what each says about them.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::Field;
use crate::base::geometry::{BODY_FROM_MOUNT_FRAME, Pose};
use crate::rig::{Mount, MountedSensor};
use crate::verify::compare::RecordedRay;

/// Rays that end farther from their prediction say nothing about the mount, m. Wider at first: 5 degrees of tilt move
/// the end of a ray of 6 m by half a metre.
pub const LAST_GATE_M: f64 = 0.3;
const FIRST_GATE_M: f64 = 1.0;
const WIDE_ROUNDS: usize = 3;
/// Surfaces seen more obliquely than 75 degrees are left out.
pub const LEAST_COSINE: f64 = 0.26;

/// Gate of a round, m.
pub(crate) fn gate_m(round: usize) -> f64 {
    if round < WIDE_ROUNDS { FIRST_GATE_M } else { LAST_GATE_M }
}

/// How a mount differs from what is nominal, in axes of the mount frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// Shift, m.
    pub translation_m: DVec3,
    /// Turn, applied after the mount's own rotation.
    pub rotation: DQuat,
    /// Added to every range, m.
    pub range_m: f64,
}

impl Default for Offset {
    fn default() -> Self {
        Self { translation_m: DVec3::ZERO, rotation: DQuat::IDENTITY, range_m: 0.0 }
    }
}

impl Offset {
    /// One step of the seven unknowns.
    pub(crate) fn add(&mut self, step: &[f64]) {
        self.translation_m += DVec3::new(step[0], step[1], step[2]);
        let turn = DQuat::from_scaled_axis(DVec3::new(step[3], step[4], step[5]));
        self.rotation = (turn * self.rotation).normalize();
        self.range_m += step[6];
    }

    /// Where the sensor then sits on the body.
    pub(crate) fn body_from_sensor(&self, mount: &Mount) -> Pose {
        let nominal = mount.body_from_sensor();
        let axes = DQuat::from_mat3(&BODY_FROM_MOUNT_FRAME);
        let turn = axes * self.rotation * axes.conjugate();
        Pose::new(turn * nominal.rotation, nominal.translation_m + BODY_FROM_MOUNT_FRAME * self.translation_m)
    }

    /// The mount nearest to that, of what is observable.
    pub(crate) fn corrected(&self, mount: &Mount, is_observable: &[bool; 7]) -> Mount {
        let keep = |place: usize, value: f64| if is_observable[place] { value } else { 0.0 };
        let turn = self.rotation.to_scaled_axis();
        let turn = DVec3::new(keep(3, turn.x), keep(4, turn.y), keep(5, turn.z));
        let shift = [0, 1, 2].map(|axis| keep(axis, self.translation_m[axis]));
        // R = Rx(roll) Ry(pitch) Rz(left over)
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * mount.rotation();
        let axis = rotation.z_axis;
        Mount {
            x_m: mount.x_m + shift[0],
            y_m: mount.y_m + shift[1],
            z_m: mount.z_m + shift[2],
            pitch_rad: axis.x.clamp(-1.0, 1.0).asin(),
            roll_rad: (-axis.y).atan2(axis.z),
            yaw_rad: mount.yaw_rad,
        }
    }
}

/// One ray's equation: residual = `of_mount` . unknowns + `of_pose` . pose error.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Sensor.
    pub sensor: usize,
    /// Across the surface, m.
    pub residual_m: f64,
    /// x, y, z, roll, tilt, yaw, range.
    pub of_mount: [f64; 7],
    /// Body x, y, z and turns about them.
    pub of_pose: [f64; 6],
}

/// The rows of one revolution.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Its middle, s since the first.
    pub time_s: f64,
    /// Equations.
    pub rows: Vec<Row>,
    /// Returns by sensor with a ray that meets a surface, near to where they ended or not.
    pub met: Vec<u64>,
}

/// Rays of each revolution, by their range in the list.
pub(crate) fn scans(field: &Field<'_>, revolution_ns: u64) -> Vec<(f64, std::ops::Range<usize>)> {
    let mut scans: Vec<(u64, std::ops::Range<usize>)> = Vec::new();
    let start_ns = field.rays.first().map_or(0, |ray| ray.time_ns);
    for (place, ray) in field.rays.iter().enumerate() {
        let number = ray.time_ns.saturating_sub(start_ns) / revolution_ns.max(1);
        match scans.last_mut() {
            Some((last, range)) if *last == number => range.end = place + 1,
            _ => scans.push((number, place..place + 1)),
        }
    }
    let seconds = revolution_ns as f64 * 1e-9;
    scans.into_iter().map(|(number, range)| ((number as f64 + 0.5) * seconds, range)).collect()
}

/// Casts every ray and keeps what says something. `poses`: error of the body's pose in each part, m and rad, as known.
pub(crate) fn rows(
    field: &Field<'_>,
    scans: &[(f64, std::ops::Range<usize>)],
    offsets: &[Offset],
    poses: &[[f64; 6]],
    gate_m: f64,
) -> Vec<Scan> {
    let made = scans.par_iter().zip(poses).map(|((time_s, range), pose)| {
        let [x, y, z, a, b, c] = *pose;
        let off = Pose::new(DQuat::from_scaled_axis(DVec3::new(a, b, c)), DVec3::new(x, y, z));
        let mut scan = Scan { time_s: *time_s, rows: Vec::new(), met: vec![0; offsets.len()] };
        for ray in &field.rays[range.clone()] {
            match meeting(field, ray, &off, &offsets[ray.sensor], gate_m) {
                Meeting::Nothing => {}
                Meeting::Elsewhere => scan.met[ray.sensor] += 1,
                Meeting::Near(row) => {
                    scan.met[ray.sensor] += 1;
                    scan.rows.push(row);
                }
            }
        }
        scan
    });
    made.collect()
}

/// What a ray says of mount and pose.
enum Meeting {
    /// No return, or its ray meets no surface well enough.
    Nothing,
    /// The return lies beyond the gate from where its ray meets a surface.
    Elsewhere,
    /// The return lies at a surface.
    Near(Row),
}

fn meeting(field: &Field<'_>, ray: &RecordedRay, off: &Pose, offset: &Offset, gate_m: f64) -> Meeting {
    let Some(recorded_m) = ray.range_m else { return Meeting::Nothing };
    let sensor: &MountedSensor = &field.sensors[ray.sensor];
    let Some(world_from_body) = field.trajectory.at(ray.time_ns) else { return Meeting::Nothing };
    let world_from_body = world_from_body * *off;
    let body_from_sensor = offset.body_from_sensor(&ray.mount(field.sensors));
    let world_from_sensor = world_from_body * body_from_sensor;
    let placed = ray.place(field.sensors, &world_from_sensor);
    let Some(hit) = field.scene.cast(placed.origin_m, placed.direction) else { return Meeting::Nothing };
    let range_m = hit.distance_m + placed.range_offset_m + offset.range_m;
    if range_m < sensor.model.min_range_m || range_m > sensor.model.max_range_m {
        return Meeting::Nothing;
    }
    let slope = placed.direction.dot(hit.normal);
    if slope.abs() < LEAST_COSINE {
        return Meeting::Nothing;
    }
    if (recorded_m - range_m).abs() > gate_m {
        return Meeting::Elsewhere;
    }
    let body_from_world = world_from_body.inverse();
    let mount_from_body = BODY_FROM_MOUNT_FRAME.transpose();
    let normal = body_from_world.rotate(hit.normal);
    let point_m = body_from_world.transform_point(placed.at_range(recorded_m - offset.range_m));
    let turn = point_m.cross(normal);
    let normal_m = mount_from_body * normal;
    let lever_m = mount_from_body * (point_m - body_from_sensor.translation_m);
    let mount_turn = lever_m.cross(normal_m);
    Meeting::Near(Row {
        sensor: ray.sensor,
        residual_m: slope * (recorded_m - range_m),
        of_mount: [-normal_m.x, -normal_m.y, -normal_m.z, -mount_turn.x, -mount_turn.y, -mount_turn.z, slope],
        of_pose: [-normal.x, -normal.y, -normal.z, -turn.x, -turn.y, -turn.z],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_about_the_servo_axis_is_pitch() {
        let mount = Mount { x_m: 0.1, y_m: 0.2, z_m: 0.3, pitch_rad: 0.4, roll_rad: 0.05, yaw_rad: 0.0 };
        let axis = super::super::tilt_axis(&mount);
        let mut offset = Offset::default();
        let step = 0.02 * axis;
        offset.add(&[0.01, 0.0, -0.02, step.x, step.y, step.z, 0.0]);
        let corrected = offset.corrected(&mount, &[true; 7]);
        assert!((corrected.pitch_rad - 0.42).abs() < 1e-12 && (corrected.roll_rad - 0.05).abs() < 1e-12);
        assert!((corrected.x_m - 0.11).abs() < 1e-12 && (corrected.z_m - 0.28).abs() < 1e-12);
        let [nominal, found] = [corrected.body_from_sensor(), offset.body_from_sensor(&mount)];
        assert!((nominal.inverse() * found).rotation.to_scaled_axis().length() < 1e-9);
        assert!(nominal.translation_m.distance(found.translation_m) < 1e-12);
    }
}
