//! A mount on the screen.

use std::fmt::Write as _;

use super::Description;

impl Description {
    pub(crate) fn text(&self) -> String {
        let mut text = String::from(
            "sensor          model       x mm      y mm      z mm     pitch      roll       yaw   optical centre mm\n",
        );
        for row in &self.sensors {
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
        for gap in &self.clearances {
            let _ = writeln!(
                text,
                "clearance       {} to {}: {:.1} mm",
                gap.origins.first,
                gap.origins.second,
                1000.0 * gap.housing_gap_m
            );
        }
        text += &self.conflicts.lines();
        for frame in &self.frames {
            let [x, y, z] = frame.translation_m.map(|metres| metres + 0.0);
            let [qx, qy, qz, qw] = frame.rotation_xyzw.map(|part| part + 0.0);
            let _ = writeln!(
                text,
                "frame           {} in {}: {x:.6} {y:.6} {z:.6} m, quaternion {qx:.6} {qy:.6} {qz:.6} {qw:.6}",
                frame.name, frame.parent
            );
        }
        for path in &self.written {
            let _ = writeln!(text, "written         {}", path.display());
        }
        text
    }
}
