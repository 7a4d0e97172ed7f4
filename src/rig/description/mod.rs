//! A mount described: sensors, frames, clearances, and what cannot be built.

mod text;

use std::path::PathBuf;

use serde::Serialize;

use super::{Clearance, Conflicts, FramedSensor, MountFile, Rig, Servos, housing_gap_m, publishers};

/// A mount described.
#[derive(Debug, Serialize)]
pub(crate) struct Description {
    pub(super) format: &'static str,
    pub(super) sensors: Vec<SensorRow>,
    /// Every frame in its parent: metres, quaternions.
    pub(super) frames: Vec<FrameRow>,
    pub(super) clearances: Vec<Gap>,
    /// What cannot be built as it is.
    pub(crate) conflicts: Conflicts,
    /// Lines for a shell with ROS 2.
    pub(super) static_transform_publishers: Vec<String>,
    /// What is odd, or was concluded.
    pub(crate) problems: Vec<String>,
    pub(super) written: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
pub(crate) struct SensorRow {
    pub(super) name: String,
    pub(super) model: String,
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) z_m: f64,
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    pub(super) yaw_deg: f64,
    pub(super) angle_tolerance_deg: Option<f64>,
    /// Where the beams meet, in the mount frame.
    pub(super) optical_centre_m: [f64; 3],
    /// The spin axis in the mount frame.
    pub(super) spin_axis: [f64; 3],
    pub(super) housing_radius_m: f64,
    pub(super) housing_height_m: f64,
    pub(super) field_of_view_deg: [f64; 2],
    /// Limits of the servo that turns it; none where none does.
    pub(super) servo_limits_deg: Option<[f64; 2]>,
}

#[derive(Debug, Serialize)]
pub(crate) struct FrameRow {
    pub(super) name: String,
    pub(super) parent: String,
    pub(super) translation_m: [f64; 3],
    pub(super) rotation_xyzw: [f64; 4],
}

#[derive(Debug, Serialize)]
pub(crate) struct Gap {
    #[serde(flatten)]
    pub(super) origins: Clearance,
    /// Between the housings as they are tilted; 0 where they touch.
    pub(super) housing_gap_m: f64,
}

pub(crate) fn describe(
    file: &MountFile,
    sensors: &[FramedSensor],
    servos: &Servos,
    problems: Vec<String>,
    written: Vec<PathBuf>,
) -> Description {
    let rows =
        file.sensors.iter().zip(sensors).zip(&servos.limits_deg).map(|((entry, sensor), limits_deg)| {
            let mounted = &sensor.mounted;
            let elevations = mounted.model.beams().iter().map(|beam| beam.elevation_rad.to_degrees());
            let widest = |[low, high]: [f64; 2], angle: f64| [low.min(angle), high.max(angle)];
            SensorRow {
                name: entry.name.clone(),
                model: entry.model.clone(),
                x_m: entry.x_m,
                y_m: entry.y_m,
                z_m: entry.z_m,
                pitch_deg: entry.pitch_deg,
                roll_deg: entry.roll_deg,
                yaw_deg: entry.yaw_deg,
                angle_tolerance_deg: entry.angle_tolerance_deg,
                optical_centre_m: mounted.lidar_origin_m().to_array(),
                spin_axis: mounted.spin_axis().to_array(),
                housing_radius_m: mounted.model.housing_radius_m,
                housing_height_m: mounted.model.housing_height_m,
                field_of_view_deg: elevations.fold([f64::INFINITY, f64::NEG_INFINITY], widest),
                servo_limits_deg: *limits_deg,
            }
        });
    let frames = sensors.iter().flat_map(|sensor| &sensor.frames).map(|frame| FrameRow {
        name: frame.name.clone(),
        parent: frame.parent.clone(),
        translation_m: frame.parent_from_frame.translation_m.to_array(),
        rotation_xyzw: frame.parent_from_frame.rotation.to_array(),
    });
    let rig = Rig { sensors: sensors.iter().map(|sensor| sensor.mounted.clone()).collect() };
    let gap = |origins: Clearance| {
        let of = |name: &str| rig.sensors.iter().find(|sensor| sensor.name == name);
        let gap_m = of(&origins.first).zip(of(&origins.second)).map_or(0.0, |(a, b)| housing_gap_m(a, b));
        Gap { origins, housing_gap_m: gap_m }
    };
    Description {
        format: "outrigger-mount-description/1",
        sensors: rows.collect(),
        frames: frames.collect(),
        clearances: rig.clearances(0.0).into_iter().map(gap).collect(),
        conflicts: rig.conflicts(),
        static_transform_publishers: publishers(sensors),
        problems,
        written,
    }
}
