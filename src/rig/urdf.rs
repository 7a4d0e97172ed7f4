//! A rig as URDF: one revolute joint per servo, housings as cylinders, frames as drivers name them.
//!
//! A joint's position is the pitch of its sensor in radians, as the servo has it; at the pitch of the mount file the
//! sensors' frames sit where tf says. The element `outrigger`, which other readers pass over, has what URDF cannot say:
//! the pitch of the mount file, and the model.

use std::fmt::Write as _;

use glam::{DMat3, DQuat, DVec3, EulerRot};

use super::frames::BASE;
use super::tf::plain;
use super::{FramedSensor, Mount};
use crate::base::geometry::Pose;

/// Speed of a joint where the mount file states none, rad/s: 30 degrees a second.
const SPEED_RAD_S: f64 = std::f64::consts::FRAC_PI_6;
/// Torque of a joint, N m: URDF wants a number, and no mount file has one.
const TORQUE_N_M: f64 = 10.0;

/// What turns the sensors.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Servos {
    /// Of each sensor the limits of its pitch, degrees; none where no servo turns it.
    pub limits_deg: Vec<Option<[f64; 2]>>,
}

/// The URDF of these sensors, each with its servo or without one.
pub(crate) fn urdf(name: &str, sensors: &[FramedSensor], servos: &Servos) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n\
         <!-- Metres and radians, x forward, y left, z up. The position of a joint is the pitch of its sensor: positive tips\n     \
         its top to the right. Effort and velocity are nominal: put those of your servo there.\n     \
         Positions of the mount: {} -->\n\
         <robot name=\"{}\">\n  <link name=\"{BASE}\"/>\n",
        positions(sensors, servos),
        escaped(name)
    );
    for (sensor, limits_deg) in sensors.iter().zip(&servos.limits_deg) {
        let own = &sensor.frames[0].name;
        let prefix = &sensor.prefix;
        let mount = sensor.mounted.mount;
        match limits_deg {
            Some([low_deg, high_deg]) => {
                let plate = Mount { pitch_rad: 0.0, yaw_rad: 0.0, ..mount }.body_from_sensor();
                let _ = write!(
                    text,
                    "\n  <joint name=\"{prefix}_pitch\" type=\"revolute\">\n    <parent link=\"{BASE}\"/>\n    \
                     <child link=\"{prefix}_servo\"/>\n    {}\n    <axis xyz=\"1 0 0\"/>\n    \
                     <limit lower=\"{}\" upper=\"{}\" effort=\"{}\" velocity=\"{}\"/>\n  </joint>\n  \
                     <link name=\"{prefix}_servo\"/>\n",
                    origin(&plate),
                    plain(low_deg.to_radians()),
                    plain(high_deg.to_radians()),
                    plain(TORQUE_N_M),
                    plain(SPEED_RAD_S),
                );
                let on_plate = Pose::new(DQuat::from_rotation_z(mount.yaw_rad), DVec3::ZERO);
                fixed(&mut text, &format!("{prefix}_mount"), &format!("{prefix}_servo"), own, &on_plate);
            }
            None => fixed(&mut text, &format!("{prefix}_mount"), BASE, own, &sensor.body_from_sensor()),
        }
        text += &housing(sensor, own);
        for frame in &sensor.frames[1..] {
            let joint = format!("{}_joint", frame.name);
            fixed(&mut text, &joint, &frame.parent, &frame.name, &frame.parent_from_frame);
            let _ = writeln!(text, "  <link name=\"{}\"/>", frame.name);
        }
        let _ = writeln!(
            text,
            "  <outrigger frame=\"{own}\" name=\"{}\" model=\"{}\"{}/>",
            escaped(&sensor.mounted.name),
            escaped(&sensor.model),
            limits_deg.map_or(String::new(), |_| format!(
                " joint=\"{prefix}_pitch\" position=\"{}\"",
                plain(mount.pitch_rad)
            ))
        );
    }
    text += "</robot>\n";
    text
}

fn positions(sensors: &[FramedSensor], servos: &Servos) -> String {
    let turned = sensors.iter().zip(&servos.limits_deg).filter(|(_, limits_deg)| limits_deg.is_some());
    let positions: Vec<String> = turned
        .map(|(sensor, _)| format!("{}_pitch {}", sensor.prefix, plain(sensor.mounted.mount.pitch_rad)))
        .collect();
    if positions.is_empty() { "no joint turns".into() } else { positions.join(", ") }
}

fn fixed(text: &mut String, joint: &str, parent: &str, child: &str, parent_from_child: &Pose) {
    let _ = write!(
        text,
        "  <joint name=\"{joint}\" type=\"fixed\">\n    <parent link=\"{parent}\"/>\n    <child link=\"{child}\"/>\n    {}\n  \
         </joint>\n",
        origin(parent_from_child)
    );
}

/// The sensor's link with its housing as a cylinder around the middle that the model gives it.
fn housing(sensor: &FramedSensor, link: &str) -> String {
    let model = &sensor.mounted.model;
    let middle = Pose::new(DQuat::IDENTITY, model.sensor_from_lidar().translation);
    let body = |element: &str| {
        format!(
            "    <{element}>\n      {}\n      <geometry><cylinder radius=\"{}\" length=\"{}\"/></geometry>\n    </{element}>\n",
            origin(&middle),
            plain(model.housing_radius_m),
            plain(model.housing_height_m)
        )
    };
    format!("  <link name=\"{link}\">\n{}{}  </link>\n", body("visual"), body("collision"))
}

/// URDF's fixed axes: Rz(yaw) Ry(pitch) Rx(roll).
fn origin(pose: &Pose) -> String {
    let [x, y, z] = pose.translation_m.to_array().map(plain);
    let (yaw, pitch, roll) = DMat3::from_quat(pose.rotation).to_euler(EulerRot::ZYX);
    let [roll, pitch, yaw] = [roll, pitch, yaw].map(plain);
    format!("<origin xyz=\"{x} {y} {z}\" rpy=\"{roll} {pitch} {yaw}\"/>")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
