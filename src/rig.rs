//! Mounts, the sensors on them, and the files that say so.

mod brackets;
mod conflicts;
mod description;
mod doubts;
mod drawing;
mod extrinsics;
mod found_with;
mod frames;
mod masters;
mod mount_deg;
mod mount_file;
mod own_sensor;
mod published_export;
mod read_mount;
mod scad;
mod tf;
mod slots;
mod touching;
mod unit;
mod urdf;

pub(crate) use conflicts::Conflicts;
pub(crate) use description::{Description, FrameRow, Gap, SensorRow, describe};
pub(crate) use drawing::draw;
pub(crate) use extrinsics::Extrinsics;
pub use found_with::{FoundWith, Path, Phase, Roll};
pub(crate) use frames::{BASE, FramedSensor, NamedFrame, framed, rings};
pub(crate) use masters::Masters;
pub use mount_deg::{MountDeg, MountRegion};
pub use mount_file::{FORMAT, FRAME, MountFile, MountFileError, SensorEntry};
pub use published_export::{
    Optimization, PublishedExport, PublishedMount, PublishedPose, RollRule, Symmetry, Walk, sensor_type,
};
pub(crate) use scad::scad;
pub(crate) use slots::MountSlots;
pub(crate) use tf::{publishers, yaml};
pub use touching::Touching;
pub(crate) use touching::housing_gap_m;
pub use unit::{CalibrationFile, Unit, UnitChoice, UnitError};
pub(crate) use urdf::{Servos, urdf};

use glam::{DMat3, DQuat, DVec3};
use sensors::SensorModel;

use crate::base::geometry::{BODY_FROM_MOUNT_FRAME, Pose};

/// Where a sensor sits and how it is tilted, in the mount frame (x right, y forward, z up).
///
/// ```
/// use glam::DVec3;
/// use outrigger::rig::Mount;
///
/// // right of the platform, tipped outward by 30 degrees: what looked up looks to the right
/// let right = Mount { x_m: 0.1, pitch_rad: 30_f64.to_radians(), ..Mount::default() };
/// let body_from_sensor = right.body_from_sensor(); // x forward, y left, z up
/// assert!(body_from_sensor.transform_point(DVec3::ZERO).abs_diff_eq(DVec3::new(0.0, -0.1, 0.0), 1e-12));
/// let up = body_from_sensor.rotation * DVec3::Z;
/// assert!((up.y + 0.5).abs() < 1e-12);
/// // its mirror image looks to the left
/// assert!(((right.mirrored().body_from_sensor().rotation * DVec3::Z).y - 0.5).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Mount {
    /// Right of the platform's origin, m.
    pub x_m: f64,
    /// Ahead of it, m.
    pub y_m: f64,
    /// Above it, m.
    pub z_m: f64,
    /// Servo angle about the forward axis, rad: tips the sensor sideways.
    pub pitch_rad: f64,
    /// Angle about the lateral axis, rad.
    pub roll_rad: f64,
    /// Angle about the sensor's own spin axis, rad: how it is turned on its plate, counterclockwise seen from its top.
    pub yaw_rad: f64,
}

impl Mount {
    /// The mirror image across the platform's plane of symmetry (YZ).
    pub fn mirrored(&self) -> Self {
        Self { x_m: -self.x_m, pitch_rad: -self.pitch_rad, yaw_rad: -self.yaw_rad, ..*self }
    }

    /// Position in the mount frame, m.
    pub(crate) fn position_m(&self) -> DVec3 {
        DVec3::new(self.x_m, self.y_m, self.z_m)
    }

    /// The mount of a sensor with this position and rotation in mount-frame axes. Every rotation has one; of the two with
    /// yaw the one with a pitch within 90 degrees, of those without yaw the one with such a roll.
    pub(crate) fn from_rotation(position_m: DVec3, rotation: DMat3) -> Self {
        let [first, second, third] = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
        let [x_m, y_m, z_m] = position_m.to_array();
        let (pitch_rad, roll_rad, yaw_rad) = if second.x.abs() < 1e-12 && second.y >= 0.0 {
            (third.x.atan2(first.x), second.z.atan2(second.y), 0.0)
        } else if third.y.hypot(third.z) < 1e-9 {
            // pitch of 90 degrees: roll and yaw turn about one axis
            (third.x.atan2(0.0), 0.0, first.y.atan2(second.y))
        } else {
            let pitch_rad = third.x.atan2(third.y.hypot(third.z));
            (pitch_rad, (-third.y).atan2(third.z), (-second.x).atan2(first.x))
        };
        Self { x_m, y_m, z_m, pitch_rad, roll_rad, yaw_rad }
    }

    /// The mount of a sensor that sits so on the body.
    pub(crate) fn from_body(body_from_sensor: &Pose) -> Self {
        let mount_from_body = BODY_FROM_MOUNT_FRAME.transpose();
        let rotation = mount_from_body * DMat3::from_quat(body_from_sensor.rotation) * BODY_FROM_MOUNT_FRAME;
        Self::from_rotation(mount_from_body * body_from_sensor.translation_m, rotation)
    }

    /// Rotation in mount-frame axes: `Rx(roll) * Ry(pitch) * Rz(yaw)`. The servo turns the pitch, and a yaw with it.
    pub(crate) fn rotation(&self) -> DMat3 {
        let servo = DMat3::from_rotation_x(self.roll_rad) * DMat3::from_rotation_y(self.pitch_rad);
        // as published, to the bit, where a sensor has no yaw
        if self.yaw_rad == 0.0 { servo } else { servo * DMat3::from_rotation_z(self.yaw_rad) }
    }

    /// Body from sensor, both REP-103: a sensor at zero pitch and roll looks ahead, its +x along the body's +x.
    pub fn body_from_sensor(&self) -> Pose {
        let rotation = BODY_FROM_MOUNT_FRAME * self.rotation() * BODY_FROM_MOUNT_FRAME.transpose();
        Pose::new(DQuat::from_mat3(&rotation), BODY_FROM_MOUNT_FRAME * self.position_m())
    }
}

/// A sensor and where it sits.
#[derive(Clone, Debug, PartialEq)]
pub struct MountedSensor {
    /// Name within the rig, unique there.
    pub name: String,
    /// Beams, limits and housing.
    pub model: SensorModel,
    /// Where it sits.
    pub mount: Mount,
}

impl MountedSensor {
    /// Where the beams meet, in the mount frame, m: the lidar origin, within 2 mm the middle of the housing of every
    /// model with a drawing.
    pub(crate) fn lidar_origin_m(&self) -> DVec3 {
        let lidar_origin = self.model.sensor_from_lidar().translation;
        let in_mount_axes = BODY_FROM_MOUNT_FRAME.transpose() * lidar_origin;
        self.mount.position_m() + self.mount.rotation() * in_mount_axes
    }

    /// The spin axis (+z of the sensor) in the mount frame.
    pub(crate) fn spin_axis(&self) -> DVec3 {
        self.mount.rotation() * DVec3::Z
    }
}

/// Sensors that share one platform.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Rig {
    /// In the order in which coverage counts them.
    pub sensors: Vec<MountedSensor>,
}

/// A sensor without a slot in the mount file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the mount file does not say where {name:?} sits; it names {known}")]
pub struct NoSlot {
    name: String,
    known: String,
}

impl Rig {
    /// A sensor of this model on each of these mounts, named by its number.
    pub(crate) fn of_model(model: &SensorModel, mounts: &[Mount]) -> Self {
        let sensor = |(index, mount): (usize, &Mount)| MountedSensor {
            name: format!("sensor {}", index + 1),
            model: model.clone(),
            mount: *mount,
        };
        Self { sensors: mounts.iter().enumerate().map(sensor).collect() }
    }

    /// Each sensor followed by its mirror image across the platform's plane of symmetry.
    #[cfg(test)]
    pub(crate) fn mirrored(masters: Vec<MountedSensor>) -> Self {
        let pair = |master: MountedSensor| {
            let image = MountedSensor {
                name: format!("{}-mirrored", master.name),
                mount: master.mount.mirrored(),
                ..master.clone()
            };
            [master, image]
        };
        Self { sensors: masters.into_iter().flat_map(pair).collect() }
    }

    /// Place of a sensor, by name.
    ///
    /// # Errors
    /// No sensor has it.
    pub(crate) fn slot(&self, name: &str) -> Result<usize, NoSlot> {
        self.sensors.iter().position(|sensor| sensor.name == name).ok_or_else(|| NoSlot {
            name: name.to_owned(),
            known: self.sensors.iter().map(|sensor| sensor.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    }

    /// Mean height of the sensors above the body's origin, m.
    pub(crate) fn mean_height_m(&self) -> f64 {
        self.sensors.iter().map(|sensor| sensor.mount.z_m).sum::<f64>() / self.sensors.len() as f64
    }

    /// Distances between sensor origins and what each pair needs, every pair once: the sum of both housing radii, or
    /// `min_distance_m` where that is more (the published d_min; 0 asks for the housings only).
    pub(crate) fn clearances(&self, min_distance_m: f64) -> Vec<Clearance> {
        let mut pairs = Vec::new();
        for (index, first) in self.sensors.iter().enumerate() {
            for second in &self.sensors[index + 1..] {
                let housings_m = first.model.housing_radius_m + second.model.housing_radius_m;
                pairs.push(Clearance {
                    first: first.name.clone(),
                    second: second.name.clone(),
                    distance_m: first.mount.position_m().distance(second.mount.position_m()),
                    needed_m: housings_m.max(min_distance_m),
                });
            }
        }
        pairs
    }
}

/// How far two sensors are apart and how far they must be.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Clearance {
    /// One sensor.
    pub first: String,
    /// The other.
    pub second: String,
    /// Between their origins, m.
    pub distance_m: f64,
    /// Least allowed distance, m.
    pub needed_m: f64,
}

impl Clearance {
    /// Whether the pair can be built.
    pub(crate) fn is_sufficient(&self) -> bool {
        self.distance_m >= self.needed_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(name: &str, x_m: f64) -> MountedSensor {
        let model = sensors::catalogue::nominal("os1-64").unwrap();
        MountedSensor { name: name.into(), model, mount: Mount { x_m, pitch_rad: 0.4, ..Mount::default() } }
    }

    #[test]
    fn a_mirrored_pair_leans_outward_on_both_sides() {
        let rig = Rig::mirrored(vec![sensor("a", 0.06)]);
        let axes: Vec<_> = rig.sensors.iter().map(MountedSensor::spin_axis).collect();
        assert_eq!(rig.sensors[1].mount.x_m, -0.06);
        assert!(axes[0].x > 0.0 && axes[0].x == -axes[1].x && axes[0].z == axes[1].z);
    }

    #[test]
    fn every_rotation_is_that_of_a_mount() {
        for (pitch_deg, roll_deg, yaw_deg) in [
            (0.0, 0.0, 0.0),
            (30.0, 0.0, 0.0),
            (-120.0, 0.0, 0.0),
            (25.0, -12.5, 90.0),
            (-80.0, 40.0, -170.0),
            (90.0, 0.0, 35.0),
        ] {
            let angles = [pitch_deg, roll_deg, yaw_deg].map(f64::to_radians);
            let [pitch_rad, roll_rad, yaw_rad] = angles;
            let mount = Mount { x_m: 0.1, y_m: -0.2, z_m: 0.3, pitch_rad, roll_rad, yaw_rad };
            let back = Mount::from_body(&mount.body_from_sensor());
            let found = [back.pitch_rad, back.roll_rad, back.yaw_rad];
            assert!(back.rotation().abs_diff_eq(mount.rotation(), 1e-12), "{mount:?} {back:?}");
            // at a pitch of 90 degrees roll and yaw turn about one axis
            let is_same = angles.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(is_same || pitch_deg == 90.0, "{mount:?} {back:?}");
            assert!(back.position_m().abs_diff_eq(mount.position_m(), 1e-12));
        }
        let mirrored = Mount { pitch_rad: 0.4, roll_rad: 0.1, yaw_rad: 0.3, ..Mount::default() }.mirrored();
        let flip = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let image = flip
            * Mount { pitch_rad: 0.4, roll_rad: 0.1, yaw_rad: 0.3, ..Mount::default() }.rotation()
            * flip;
        assert!(mirrored.rotation().abs_diff_eq(image, 1e-12));
    }

    #[test]
    fn each_model_brings_its_own_size() {
        let mut rig = Rig::mirrored(vec![sensor("a", 0.05)]);
        rig.sensors[1].model = sensors::catalogue::nominal("hdl-64e-s3").unwrap();
        assert!((rig.clearances(0.0)[0].needed_m - (0.0435 + 0.1118)).abs() < 1e-12);
    }

    #[test]
    fn housings_ask_for_their_radii() {
        let near = Rig::mirrored(vec![sensor("a", 0.028)]).clearances(0.0);
        assert_eq!(near.len(), 1);
        assert!(!near[0].is_sufficient(), "{near:?}");
        assert!((near[0].needed_m - 0.087).abs() < 1e-12);
        assert!(Rig::mirrored(vec![sensor("a", 0.05)]).clearances(0.0)[0].is_sufficient());
        assert!(!Rig::mirrored(vec![sensor("a", 0.05)]).clearances(0.12)[0].is_sufficient());
    }
}
