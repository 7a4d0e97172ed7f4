//! The frames of a rig as robots name them, and where each one sits: what URDF and tf say, from one list.
//!
//! All frames follow REP-103 (x forward, y left, z up), lengths in metres. `base_link` is the platform's origin. An Ouster
//! has the frames of its driver: `NAME_os_sensor` at the middle of its bottom plane, and in it `NAME_os_lidar` and
//! `NAME_os_imu`. A Velodyne has `NAME_velodyne` where its beams meet, as its driver names it.

use glam::{DAffine3, DQuat, DVec3};
use sensors::SensorModel;
use sensors::velodyne::Product;

use super::{MountFile, MountedSensor, Unit};
use crate::base::geometry::Pose;

/// The platform's frame.
pub(crate) const BASE: &str = "base_link";
/// Where a driver has its frames, behind the sensor's name.
pub(super) const OUSTER_SENSOR: &str = "os_sensor";
pub(super) const OUSTER_LIDAR: &str = "os_lidar";
pub(super) const OUSTER_IMU: &str = "os_imu";
pub(super) const VELODYNE: &str = "velodyne";

/// Ouster's nominal IMU. Source: Ouster sensor documentation, hardware user manuals of OS0, OS1 and OS2, "inertial
/// measurement unit frame".
const NOMINAL_IMU_M: DVec3 = DVec3::new(0.006_253, -0.011_775, 0.007_645);

/// One frame and where it sits in another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedFrame {
    /// Its name.
    pub name: String,
    /// The frame that it is described in.
    pub parent: String,
    /// Where it sits there.
    pub parent_from_frame: Pose,
}

/// A sensor of a rig with the names of its frames.
#[derive(Clone, Debug)]
pub(crate) struct FramedSensor {
    /// Beams, housing and mount.
    pub mounted: MountedSensor,
    /// Name of its model in the catalogue, as the mount file has it.
    pub model: String,
    /// How far each angle may be off, degrees, where the mount file says so.
    pub angle_tolerance_deg: Option<f64>,
    /// Its name as a part of frames' names.
    pub prefix: String,
    /// Its frames; the first one is the sensor's own, in [`BASE`], at the pitch of the mount.
    pub frames: Vec<NamedFrame>,
}

/// Whether a model is a Velodyne; every other one of the catalogue is an Ouster.
pub(super) fn is_velodyne(model: &SensorModel) -> bool {
    Product::from_name(&model.name).is_some()
}

/// Number of each channel, as point files have them (`ring`): a Velodyne's rise with elevation.
pub(crate) fn rings(model: &SensorModel) -> Vec<u16> {
    if is_velodyne(model) { model.rings_by_elevation() } else { (0..model.channels() as u16).collect() }
}

/// Height of the housing's bottom plane above the sensor's origin, m: an Ouster's origin lies in it, a Velodyne's is the
/// middle of the housing (within 2 mm).
pub(crate) fn bottom_plane_m(model: &SensorModel) -> f64 {
    if is_velodyne(model) { -0.5 * model.housing_height_m } else { 0.0 }
}

/// A rigid transform of the sensors' crate.
fn pose(transform: DAffine3) -> Pose {
    Pose::new(DQuat::from_mat3(&transform.matrix3), transform.translation)
}

/// What can stand in a frame's name: letters, digits and `_`.
fn as_frame_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// The sensors of a mount file with their frames.
///
/// # Errors
/// Two sensors with frames of one name, in words.
pub(crate) fn framed(file: &MountFile, units: &[Unit]) -> Result<Vec<FramedSensor>, String> {
    let mut framed: Vec<FramedSensor> = Vec::new();
    for ((mounted, unit), entry) in file.rig_of(units).sensors.into_iter().zip(units).zip(&file.sensors) {
        let prefix = as_frame_name(&mounted.name);
        if let Some(twin) = framed.iter().find(|other| other.prefix == prefix) {
            return Err(format!(
                "{:?} and {:?} would both be {prefix:?} in the names of frames, where letters, digits and _ may stand: rename \
                 one",
                twin.mounted.name, mounted.name
            ));
        }
        let frames = frames(&mounted, unit, &prefix);
        let (model, angle_tolerance_deg) = (entry.model.clone(), entry.angle_tolerance_deg);
        framed.push(FramedSensor { mounted, model, angle_tolerance_deg, prefix, frames });
    }
    Ok(framed)
}

fn frames(mounted: &MountedSensor, unit: &Unit, prefix: &str) -> Vec<NamedFrame> {
    let named = |own: &str, parent: &str, parent_from_frame| NamedFrame {
        name: format!("{prefix}_{own}"),
        parent: parent.to_owned(),
        parent_from_frame,
    };
    let body_from_sensor = mounted.mount.body_from_sensor();
    if is_velodyne(&mounted.model) {
        return vec![named(VELODYNE, BASE, body_from_sensor)];
    }
    let sensor = named(OUSTER_SENSOR, BASE, body_from_sensor);
    let lidar = named(OUSTER_LIDAR, &sensor.name, pose(mounted.model.sensor_from_lidar()));
    let imu = unit.sensor_from_imu.map_or(Pose::new(DQuat::IDENTITY, NOMINAL_IMU_M), pose);
    let imu = named(OUSTER_IMU, &sensor.name, imu);
    vec![sensor, lidar, imu]
}

impl FramedSensor {
    /// The sensor's own frame on the body.
    pub(crate) fn body_from_sensor(&self) -> Pose {
        self.mounted.mount.body_from_sensor()
    }

    /// The prefix as the name of a module, which begins with a letter.
    pub(super) fn prefix_of_module(&self) -> String {
        format!("sensor_{}", self.prefix)
    }
}
