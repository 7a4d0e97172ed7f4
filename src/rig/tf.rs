//! The frames of a rig for tf: YAML as `ros2 topic echo /tf_static` prints it, and `static_transform_publisher` lines.

use std::fmt::Write as _;

use super::{FramedSensor, NamedFrame};

/// Every frame of these sensors, in an order in which a parent comes before its children.
fn frames(sensors: &[FramedSensor]) -> impl Iterator<Item = &NamedFrame> {
    sensors.iter().flat_map(|sensor| &sensor.frames)
}

/// A message of tf2_msgs/TFMessage, with the publishers' lines as comments above it.
pub(crate) fn yaml(sensors: &[FramedSensor]) -> String {
    let mut text = String::from(
        "# Frames of the rig: metres, quaternions, x forward, y left, z up. Each line below publishes one of them.\n",
    );
    for line in publishers(sensors) {
        let _ = writeln!(text, "# {line}");
    }
    text += "transforms:\n";
    for frame in frames(sensors) {
        let [x, y, z] = frame.parent_from_frame.translation_m.to_array().map(plain);
        let [qx, qy, qz, qw] = frame.parent_from_frame.rotation.to_array().map(plain);
        let _ = write!(
            text,
            "- header:\n    stamp: {{sec: 0, nanosec: 0}}\n    frame_id: {}\n  child_frame_id: {}\n  transform:\n    \
             translation: {{x: {x}, y: {y}, z: {z}}}\n    rotation: {{x: {qx}, y: {qy}, z: {qz}, w: {qw}}}\n",
            frame.parent, frame.name
        );
    }
    text
}

/// A line for a shell with ROS 2 for each frame.
pub(crate) fn publishers(sensors: &[FramedSensor]) -> Vec<String> {
    let line = |frame: &NamedFrame| {
        let [x, y, z] = frame.parent_from_frame.translation_m.to_array().map(plain);
        let [qx, qy, qz, qw] = frame.parent_from_frame.rotation.to_array().map(plain);
        format!(
            "ros2 run tf2_ros static_transform_publisher --x {x} --y {y} --z {z} --qx {qx} --qy {qy} --qz {qz} --qw {qw} \
             --frame-id {} --child-frame-id {}",
            frame.parent, frame.name
        )
    };
    frames(sensors).map(line).collect()
}

/// A number to a femtometre, without exponent and without a negative zero; with a decimal point, so that YAML reads no
/// integer.
pub(super) fn plain(number: f64) -> String {
    let text = format!("{number:.15}");
    let text = text.trim_end_matches('0');
    match text.trim_end_matches('.') {
        "-0" => "0.0".into(),
        whole if text.ends_with('.') => format!("{whole}.0"),
        _ => text.to_owned(),
    }
}
