//! Mounts, the sensors on them, and the files that say so.

mod brackets;
mod conflicts;
mod found_with;
mod mount_file;
mod published_export;
mod read_mount;
mod slots;
mod touching;
mod unit;

pub(crate) use conflicts::Conflicts;
pub use found_with::{FoundWith, Path, Phase};
pub use mount_file::{FORMAT, FRAME, MountFile, MountFileError, SensorEntry};
pub use published_export::{
    Optimization, PublishedExport, PublishedMount, PublishedPose, RollRule, Symmetry, Walk, sensor_type,
};
pub(crate) use slots::MountSlots;
pub use touching::{Touching, housing_gap_m};
pub use unit::{CalibrationFile, Unit, UnitChoice, UnitError};

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
}

impl Mount {
    /// The mirror image across the platform's plane of symmetry (YZ).
    pub fn mirrored(&self) -> Self {
        Self { x_m: -self.x_m, pitch_rad: -self.pitch_rad, ..*self }
    }

    /// Position in the mount frame, m.
    pub(crate) fn position_m(&self) -> DVec3 {
        DVec3::new(self.x_m, self.y_m, self.z_m)
    }

    /// Rotation in mount-frame axes: `Rx(roll) * Ry(pitch)`.
    pub(crate) fn rotation(&self) -> DMat3 {
        DMat3::from_rotation_x(self.roll_rad) * DMat3::from_rotation_y(self.pitch_rad)
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
