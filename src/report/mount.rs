//! The report of a mount.

use super::Report;
use crate::report::chart::number;
use crate::rig::{Description, FrameRow, Gap, SensorRow};

/// Sensors, clearances, frames and files.
pub(crate) fn report(mount: &Description) -> Report {
    let mut report = Report::new("A mount", "");
    let row = |sensor: &SensorRow| {
        let position_mm = [sensor.x_m, sensor.y_m, sensor.z_m].map(|metres| number(1e3 * metres, 2));
        let angles_deg = [sensor.pitch_deg, sensor.roll_deg, sensor.yaw_deg].map(|angle| number(angle, 1));
        let centre_mm = sensor.optical_centre_m.map(|metres| number(1e3 * metres, 2));
        let named = [sensor.name.clone(), sensor.model.clone()];
        named.into_iter().chain(position_mm).chain(angles_deg).chain([centre_mm.join(", ")]).collect()
    };
    report.table(
        &[
            "sensor",
            "model",
            "x, mm",
            "y, mm",
            "z, mm",
            "pitch, °",
            "roll, °",
            "yaw, °",
            "optical centre, mm",
        ],
        mount.sensors.iter().map(row).collect(),
    );
    report.note("x right, y forward, z up; positive pitch: the top to the right, roll: the top back, yaw: the front to the left");
    let clearance = |gap: &Gap| {
        let (first, second) = (&gap.origins.first, &gap.origins.second);
        ("clearance", format!("{first} to {second}: {:.1} mm", 1e3 * gap.housing_gap_m))
    };
    report.figures(mount.clearances.iter().map(clearance));
    report.figures(mount.conflicts.figures());
    let frame = |frame: &FrameRow| {
        let [x, y, z] = frame.translation_m.map(|metres| metres + 0.0);
        let [qx, qy, qz, qw] = frame.rotation_xyzw.map(|part| part + 0.0);
        let (name, parent) = (&frame.name, &frame.parent);
        let at = format!("{x:.6} {y:.6} {z:.6} m, quaternion {qx:.6} {qy:.6} {qz:.6} {qw:.6}");
        ("frame", format!("{name} in {parent}: {at}"))
    };
    report.figures(mount.frames.iter().map(frame));
    report.figures(mount.written.iter().map(|path| ("written", path.display().to_string())));
    report
}
