//! A mount described: sensors, frames, clearances, and what cannot be built.

use std::path::PathBuf;

use serde::Serialize;

use super::{Clearance, Conflicts, FramedSensor, MountFile, Rig, Servos, housing_gap_m, publishers};

/// A mount described.
#[derive(Debug, Serialize)]
pub(crate) struct Description {
    pub(crate) format: &'static str,
    pub(crate) sensors: Vec<SensorRow>,
    /// Every frame in its parent: metres, quaternions.
    pub(crate) frames: Vec<FrameRow>,
    pub(crate) clearances: Vec<Gap>,
    /// What cannot be built as it is.
    pub(crate) conflicts: Conflicts,
    /// Lines for a shell with ROS 2.
    pub(crate) static_transform_publishers: Vec<String>,
    /// What is odd, or was concluded.
    pub(crate) problems: Vec<String>,
    pub(crate) written: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
pub(crate) struct SensorRow {
    pub(crate) name: String,
    pub(crate) model: String,
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    pub(crate) z_m: f64,
    pub(crate) pitch_deg: f64,
    pub(crate) roll_deg: f64,
    pub(crate) yaw_deg: f64,
    pub(crate) angle_tolerance_deg: Option<f64>,
    /// Where the beams meet, in the mount frame.
    pub(crate) optical_centre_m: [f64; 3],
    /// The spin axis in the mount frame.
    pub(crate) spin_axis: [f64; 3],
    pub(crate) housing_radius_m: f64,
    pub(crate) housing_height_m: f64,
    pub(crate) field_of_view_deg: [f64; 2],
    /// Limits of the servo that turns it; none where none does.
    pub(crate) servo_limits_deg: Option<[f64; 2]>,
}

#[derive(Debug, Serialize)]
pub(crate) struct FrameRow {
    pub(crate) name: String,
    pub(crate) parent: String,
    pub(crate) translation_m: [f64; 3],
    pub(crate) rotation_xyzw: [f64; 4],
}

#[derive(Debug, Serialize)]
pub(crate) struct Gap {
    #[serde(flatten)]
    pub(crate) origins: Clearance,
    /// Between the housings as they are tilted; 0 where they touch.
    pub(crate) housing_gap_m: f64,
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
