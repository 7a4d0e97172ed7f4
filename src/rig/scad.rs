//! A rig for OpenSCAD: its housings where they sit, to draw brackets around.

use std::fmt::Write as _;

use glam::DMat3;

use super::FramedSensor;
use super::frames::bottom_plane_m;
use super::tf::plain;
use crate::base::geometry::BODY_FROM_MOUNT_FRAME;

/// A program for OpenSCAD, in millimetres and in the mount frame (x right, y forward, z up).
pub(crate) fn scad(sensors: &[FramedSensor]) -> String {
    let mut text = String::from(
        "// Sensors of the rig: millimetres, x right, y forward, z up. Each module is drawn where its sensor sits;\n\
         // clearance_mm grows every housing, for a bracket to be cut by difference().\nclearance_mm = 0;\n$fn = 96;\n",
    );
    for sensor in sensors {
        let (mounted, model) = (&sensor.mounted, &sensor.mounted.model);
        let rotation = mounted.mount.rotation();
        // the model's own axes are x forward; here it stands in the axes of the mount frame
        let lidar_mm = BODY_FROM_MOUNT_FRAME.transpose() * model.sensor_from_lidar().translation * 1000.0;
        let bottom_mm = bottom_plane_m(model) * 1000.0;
        let top_mm = lidar_mm.z + 500.0 * model.housing_height_m;
        let rows = matrix_rows(rotation, mounted.mount.position_m().to_array().map(|metres| 1000.0 * metres));
        let _ = write!(
            text,
            "\n// {}: {}\nmodule {}() {{\n  multmatrix({rows}) {{\n    translate([0, 0, {} - clearance_mm])\n      \
             cylinder(r = {} + clearance_mm, h = {} + 2 * clearance_mm);\n    color(\"red\") translate([{}, {}, {}]) sphere(r = 2); \
             // optical centre\n    color(\"green\") translate([0, {} , {}]) cube([2, {}, 2], center = true); // the sensor's \
             +x\n  }}\n}}\n{}();\n",
            mounted.name.escape_default(),
            sensor.model,
            sensor.prefix_of_module(),
            plain(bottom_mm),
            plain(1000.0 * model.housing_radius_m),
            plain(top_mm - bottom_mm),
            plain(lidar_mm.x),
            plain(lidar_mm.y),
            plain(lidar_mm.z),
            plain(1000.0 * model.housing_radius_m),
            plain(top_mm),
            plain(2000.0 * model.housing_radius_m),
            sensor.prefix_of_module(),
        );
    }
    text
}

fn matrix_rows(rotation: DMat3, translation_mm: [f64; 3]) -> String {
    let rows: Vec<String> = (0..3)
        .map(|row| {
            let numbers = (0..3).map(|column| rotation.col(column)[row]).chain([translation_mm[row]]);
            format!("[{}]", numbers.map(plain).collect::<Vec<_>>().join(", "))
        })
        .collect();
    format!("[{}, [0, 0, 0, 1]]", rows.join(", "))
}
