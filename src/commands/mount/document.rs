//! What `mount` prints.

use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use crate::rig::{Clearance, Conflicts, FramedSensor, MountFile, Rig, Servos, housing_gap_m, publishers};

/// The document that `mount` prints.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    format: &'static str,
    sensors: Vec<SensorRow>,
    /// Every frame in its parent: metres, quaternions.
    frames: Vec<FrameRow>,
    clearances: Vec<Gap>,
    /// What cannot be built as it is.
    pub(super) conflicts: Conflicts,
    /// Lines for a shell with ROS 2.
    static_transform_publishers: Vec<String>,
    /// What is odd, or was concluded.
    pub(super) problems: Vec<String>,
    written: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
struct SensorRow {
    name: String,
    model: String,
    x_m: f64,
    y_m: f64,
    z_m: f64,
    pitch_deg: f64,
    roll_deg: f64,
    yaw_deg: f64,
    angle_tolerance_deg: Option<f64>,
    /// Where the beams meet, in the mount frame.
    optical_centre_m: [f64; 3],
    /// The spin axis in the mount frame.
    spin_axis: [f64; 3],
    housing_radius_m: f64,
    housing_height_m: f64,
    field_of_view_deg: [f64; 2],
    /// Limits of the servo that turns it; none where none does.
    servo_limits_deg: Option<[f64; 2]>,
}

#[derive(Debug, Serialize)]
struct FrameRow {
    name: String,
    parent: String,
    translation_m: [f64; 3],
    rotation_xyzw: [f64; 4],
}

#[derive(Debug, Serialize)]
struct Gap {
    #[serde(flatten)]
    origins: Clearance,
    /// Between the housings as they are tilted; 0 where they touch.
    housing_gap_m: f64,
}

pub(super) fn document(
    file: &MountFile,
    sensors: &[FramedSensor],
    servos: &Servos,
    problems: Vec<String>,
    written: Vec<PathBuf>,
) -> Document {
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
    Document {
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

pub(super) fn text(document: &Document) -> String {
    let mut text = String::from(
        "sensor          model       x mm      y mm      z mm     pitch      roll       yaw   optical centre mm\n",
    );
    for row in &document.sensors {
        let [x, y, z] = row.optical_centre_m.map(|metres| 1000.0 * metres);
        let _ = writeln!(
            text,
            "{:<15} {:<8} {:>9.2} {:>9.2} {:>9.2} {:>8.1}° {:>8.1}° {:>8.1}°  {x:>9.2} {y:>9.2} {z:>9.2}",
            row.name,
            row.model,
            1000.0 * row.x_m,
            1000.0 * row.y_m,
            1000.0 * row.z_m,
            row.pitch_deg + 0.0,
            row.roll_deg + 0.0,
            row.yaw_deg + 0.0,
        );
    }
    text += "x right, y forward, z up; positive pitch: the top to the right, roll: the top back, yaw: the front to the left\n";
    for gap in &document.clearances {
        let _ = writeln!(
            text,
            "clearance       {} to {}: {:.1} mm",
            gap.origins.first,
            gap.origins.second,
            1000.0 * gap.housing_gap_m
        );
    }
    text += &document.conflicts.lines();
    for frame in &document.frames {
        let [x, y, z] = frame.translation_m.map(|metres| metres + 0.0);
        let [qx, qy, qz, qw] = frame.rotation_xyzw.map(|part| part + 0.0);
        let _ = writeln!(
            text,
            "frame           {} in {}: {x:.6} {y:.6} {z:.6} m, quaternion {qx:.6} {qy:.6} {qz:.6} {qw:.6}",
            frame.name, frame.parent
        );
    }
    for path in &document.written {
        let _ = writeln!(text, "written         {}", path.display());
    }
    text
}
