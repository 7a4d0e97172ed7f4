//! The file that the published program exports, so that what draws its results draws ours, and its mounts are read here.
//!
//! Layout of the released program (<https://github.com/geospatial-engineer/multi-lidar-optimization>, as its
//! `jsonencode` writes it). `position` and `t` are metres in the mount frame's axes. `euler_deg` is `[roll, pitch, yaw]`
//! of `Rz(yaw) Ry(pitch) Rx(roll)`, the other order than that of a mount, `Rx(roll) Ry(pitch)`: a mount with both tilts
//! has a yaw there. `R` is row by row.

use glam::{DMat3, EulerRot};
use serde::{Deserialize, Serialize};

use super::{Mount, MountFile, SensorEntry};

/// Sensor names of the released program, with ours.
const SENSOR_TYPES: [(&str, &str); 2] = [("Ouster OS1-64", "os1-64"), ("Velodyne VLP-16", "vlp-16")];
/// Largest part of a rotation that no mount has, before a file is refused: angles are written to the bit.
const YAW_TOLERANCE: f64 = 1e-6;

/// The content of the published export.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PublishedExport {
    /// `Ouster OS1-64` or `Velodyne VLP-16`.
    pub sensor_type: String,
    /// Whether masters were mirrored.
    pub symmetry: Symmetry,
    /// What was done with roll.
    pub roll: RollRule,
    /// The walk.
    pub backpack: Walk,
    /// What was found.
    pub optimization: Optimization,
    /// Every physical sensor.
    #[serde(deserialize_with = "one_or_many")]
    pub mounts: Vec<PublishedMount>,
    /// Poses of the platform along the walk.
    pub trajectory_world: Vec<PublishedPose>,
}

/// Mirroring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Symmetry {
    /// Whether masters were mirrored.
    pub enabled: bool,
    /// `YZ`.
    pub plane: String,
}

/// What was done with roll.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RollRule {
    /// Whether it was held.
    pub fixed: bool,
    /// At which angle, degrees.
    pub fixed_deg: f64,
}

/// A straight walk; lengths in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Walk {
    /// `x` or `y` of the mount frame.
    pub path_axis: String,
    /// From end to end.
    pub path_length: f64,
    /// From pose to pose.
    pub path_step: f64,
    /// From either end to the wall.
    pub margin: f64,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optimization {
    /// Voxels seen by at least one sensor.
    pub total_coverage: u64,
    /// Price of a sensor.
    pub lambda: f64,
    /// Physical sensors.
    #[serde(rename = "N")]
    pub sensors: usize,
    /// Search method; not every released program writes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
}

/// A sensor's mount.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PublishedMount {
    /// In the mount frame, m.
    pub position: [f64; 3],
    /// Roll, pitch, yaw in degrees, of `Rz Ry Rx`.
    pub euler_deg: [f64; 3],
}

/// A pose of the platform.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PublishedPose {
    /// Rotation, row by row.
    #[serde(rename = "R")]
    pub rotation: [[f64; 3]; 3],
    /// Position, m.
    #[serde(rename = "t")]
    pub position: [f64; 3],
}

impl From<Mount> for PublishedMount {
    fn from(mount: Mount) -> Self {
        let (yaw, pitch, roll) = mount.rotation().to_euler(EulerRot::ZYX);
        // a zero has no sign to a reader
        let degrees = [roll, pitch, yaw].map(|angle| angle.to_degrees() + 0.0);
        Self { position: mount.position_m().to_array(), euler_deg: degrees }
    }
}

impl PublishedMount {
    /// The mount with this position and rotation; none where it takes a yaw that no mount has.
    pub(crate) fn mount(&self) -> Option<Mount> {
        let [roll, pitch, yaw] = self.euler_deg.map(f64::to_radians);
        let rotation = DMat3::from_euler(EulerRot::ZYX, yaw, pitch, roll);
        let [x_m, y_m, z_m] = self.position;
        let [first, second, third] = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
        // Rx(roll) Ry(pitch): its second column has no x
        (second.x.abs() <= YAW_TOLERANCE).then(|| Mount {
            x_m,
            y_m,
            z_m,
            pitch_rad: third.x.atan2(first.x),
            roll_rad: second.z.atan2(second.y),
            yaw_rad: 0.0,
        })
    }
}

/// The published program's name of a sensor model.
pub fn sensor_type(model: &str) -> Option<&'static str> {
    SENSOR_TYPES.iter().find(|(_, ours)| *ours == model).map(|(published, _)| *published)
}

/// The released program's encoder writes a list of one as its only member.
fn one_or_many<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Vec<PublishedMount>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum OneOrMany {
        One(PublishedMount),
        Many(Vec<PublishedMount>),
    }
    OneOrMany::deserialize(from).map(|read| match read {
        OneOrMany::One(mount) => vec![mount],
        OneOrMany::Many(mounts) => mounts,
    })
}

/// Only this layout has such a field.
#[derive(Deserialize)]
struct Peek {
    sensor_type: Option<serde_json::Value>,
}

/// Whether a text is of this layout, whatever else is wrong with it.
pub(super) fn is_published(text: &str) -> bool {
    serde_json::from_str::<Peek>(text).is_ok_and(|peek| peek.sensor_type.is_some())
}

/// The mount file of an export.
pub(super) fn mount_file(text: &str) -> Result<MountFile, String> {
    let reader = &mut serde_json::Deserializer::from_str(text);
    let export: PublishedExport = serde_path_to_error::deserialize(reader)
        .map_err(|error| format!("at {} of the published export: {}", error.path(), error.inner()))?;
    let known = SENSOR_TYPES.iter().find(|(published, _)| *published == export.sensor_type);
    let (_, model) = known.ok_or_else(|| {
        let names = SENSOR_TYPES.map(|(published, _)| published).join(", ");
        format!("sensor_type is {:?}, known are {names}", export.sensor_type)
    })?;
    let mut sensors = Vec::new();
    for (index, published) in export.mounts.iter().enumerate() {
        let mount = published.mount().ok_or_else(|| {
            format!(
                "mounts[{index}].euler_deg {:?} is no roll and pitch of a mount: it takes a yaw",
                published.euler_deg
            )
        })?;
        sensors.push(SensorEntry {
            name: format!("sensor-{}", index + 1),
            model: (*model).into(),
            x_m: mount.x_m,
            y_m: mount.y_m,
            z_m: mount.z_m,
            pitch_deg: mount.pitch_rad.to_degrees(),
            roll_deg: mount.roll_rad.to_degrees(),
            ..SensorEntry::default()
        });
    }
    Ok(MountFile::new(sensors))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the released programs compute it from a rotation's elements.
    fn released_euler_deg(rotation: DMat3) -> [f64; 3] {
        let at = |row: usize, column: usize| rotation.col(column)[row];
        let pitch = (-at(2, 0)).atan2(at(0, 0).hypot(at(1, 0)));
        [at(2, 1).atan2(at(2, 2)), pitch, at(1, 0).atan2(at(0, 0))].map(f64::to_degrees)
    }

    #[test]
    fn angles_are_the_released_program_s_and_come_back() {
        for (pitch_deg, roll_deg) in
            [(25.23, 0.0), (-57.9, 0.0), (33.0, 12.5), (-80.0, -70.0), (0.0, 40.0), (89.0, 1.0)]
        {
            let mount = SensorEntry {
                name: "one".into(),
                model: "os1-64".into(),
                x_m: 0.1,
                y_m: -0.25,
                z_m: 0.05,
                pitch_deg,
                roll_deg,
                ..SensorEntry::default()
            }
            .mount();
            let published = PublishedMount::from(mount);
            for (ours, released) in published.euler_deg.iter().zip(released_euler_deg(mount.rotation())) {
                assert!((ours - released).abs() < 1e-9, "{pitch_deg} {roll_deg}: {published:?}");
            }
            let back = published.mount().unwrap();
            assert!((back.pitch_rad - mount.pitch_rad).abs() < 1e-9);
            assert!((back.roll_rad - mount.roll_rad).abs() < 1e-9);
        }
        let turned = PublishedMount { position: [0.0; 3], euler_deg: [0.0, 20.0, 30.0] };
        assert_eq!(turned.mount(), None, "a yaw is no tilt");
    }
}
