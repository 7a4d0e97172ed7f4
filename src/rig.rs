//! Mounts, the sensors on them, and the files that say so.

use glam::{DMat3, DQuat, DVec3};

use crate::geometry::{BODY_FROM_MOUNT_FRAME, Pose};

/// Where a sensor sits and how it is tilted, in the mount frame (x right, y forward, z up).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Mount {
    /// Right of the platform's origin, m.
    pub x_m: f64,
    /// Ahead of it, m.
    pub y_m: f64,
    /// Above it, m.
    pub z_m: f64,
    /// Servo angle about the forward axis, rad: tips the sensor sideways.
    pub pitch_rad: f64,
    /// Angle about the lateral axis, rad.
    pub roll_rad: f64,
}

impl Mount {
    /// The mirror image across the platform's plane of symmetry (YZ).
    pub fn mirrored(&self) -> Self {
        Self { x_m: -self.x_m, pitch_rad: -self.pitch_rad, ..*self }
    }

    /// Position in the mount frame, m.
    pub fn position_m(&self) -> DVec3 {
        DVec3::new(self.x_m, self.y_m, self.z_m)
    }

    /// Rotation in mount-frame axes: `Rx(roll) * Ry(pitch)`.
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_rotation_x(self.roll_rad) * DMat3::from_rotation_y(self.pitch_rad)
    }

    /// Body from sensor, both REP-103: a sensor at zero pitch and roll looks ahead, its +x along the body's +x.
    pub fn body_from_sensor(&self) -> Pose {
        let rotation = BODY_FROM_MOUNT_FRAME * self.rotation() * BODY_FROM_MOUNT_FRAME.transpose();
        Pose::new(DQuat::from_mat3(&rotation), BODY_FROM_MOUNT_FRAME * self.position_m())
    }
}
