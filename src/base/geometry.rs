//! Frames and rotations: the only place where frame conventions are converted.
//!
//! World and body follow REP-103 (x forward, y left, z up; metres, radians). The **mount frame** is the published
//! one: x lateral (right), y forward, z up. A sensor at zero pitch and roll has the axes of the body.

use glam::{DMat3, DQuat, DVec3};

/// Body axes from mount-frame axes: body = (y, -x, z).
pub const BODY_FROM_MOUNT_FRAME: DMat3 =
    DMat3::from_cols(DVec3::new(0.0, -1.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 1.0));

/// A rigid transform `a_from_b`: rotate, then translate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation, unit quaternion.
    pub rotation: DQuat,
    /// Origin of b in a, m.
    pub translation_m: DVec3,
}

impl Pose {
    /// No rotation, no translation.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation_m: DVec3::ZERO };

    /// From its parts.
    pub fn new(rotation: DQuat, translation_m: DVec3) -> Self {
        Self { rotation, translation_m }
    }

    pub(crate) fn from_translation(translation_m: DVec3) -> Self {
        Self { rotation: DQuat::IDENTITY, translation_m }
    }

    /// Maps a point of b to a.
    pub fn transform_point(&self, point_m: DVec3) -> DVec3 {
        self.rotation * point_m + self.translation_m
    }

    /// Maps a direction of b to a.
    pub fn rotate(&self, direction: DVec3) -> DVec3 {
        self.rotation * direction
    }

    /// `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// Between two poses: `share` 0 gives `self`, 1 gives `to`; slerp and straight line.
    pub(crate) fn interpolate(&self, to: &Self, share: f64) -> Self {
        Self {
            rotation: self.rotation.slerp(to.rotation, share),
            translation_m: self.translation_m.lerp(to.translation_m, share),
        }
    }
}

impl std::ops::Mul for Pose {
    type Output = Pose;

    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, b_from_c: Pose) -> Pose {
        Pose {
            rotation: self.rotation * b_from_c.rotation,
            translation_m: self.transform_point(b_from_c.translation_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_of_the_mount_frame_is_minus_y_of_the_body() {
        assert_eq!(BODY_FROM_MOUNT_FRAME * DVec3::X, -DVec3::Y);
        assert_eq!(BODY_FROM_MOUNT_FRAME * DVec3::Y, DVec3::X);
        assert_eq!(BODY_FROM_MOUNT_FRAME * DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, -1.0, 3.0));
    }

    #[test]
    fn inverse_undoes() {
        let pose =
            Pose::new(DQuat::from_rotation_x(0.3) * DQuat::from_rotation_z(1.1), DVec3::new(1.0, -2.0, 0.5));
        let round = pose * pose.inverse();
        assert!(round.translation_m.length() < 1e-15);
        assert!(round.rotation.angle_between(DQuat::IDENTITY) < 1e-7);
    }
}
