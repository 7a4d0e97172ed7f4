//! Frames and rotations: the only place where frame conventions are converted.
//!
//! World and body follow REP-103 (x forward, y left, z up; metres, radians). The **mount frame** is the published
//! one: x lateral (right), y forward, z up. A sensor at zero pitch and roll has the axes of the body.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};

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

    /// The transform that lays points of b nearest to those of a, by the squares of what is left (Kabsch, DOI
    /// 10.1107/S0567739476001873). None of fewer than three points, or where their spread has no finite decomposition.
    pub(crate) fn between_points(b_m: &[DVec3], a_m: &[DVec3]) -> Option<Self> {
        let count = b_m.len().min(a_m.len());
        if count < 3 {
            return None;
        }
        let mean = |points: &[DVec3]| points[..count].iter().sum::<DVec3>() / count as f64;
        let (b_mean_m, a_mean_m) = (mean(b_m), mean(a_m));
        let mut spread = Matrix3::zeros();
        for (b_m, a_m) in b_m.iter().zip(a_m) {
            let [b_m, a_m] = [*b_m - b_mean_m, *a_m - a_mean_m].map(|at| Vector3::from(at.to_array()));
            spread += a_m * b_m.transpose();
        }
        let svd = spread.try_svd(true, true, f64::EPSILON, 100)?;
        let (u, v_transposed) = (svd.u?, svd.v_t?);
        // no mirror
        let sign = (u * v_transposed).determinant().signum();
        let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_transposed;
        let columns: [[f64; 3]; 3] = rotation.into();
        let rotation = DQuat::from_mat3(&DMat3::from_cols_array_2d(&columns)).normalize();
        rotation.is_finite().then(|| Self::new(rotation, a_mean_m - rotation * b_mean_m))
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
    fn points_that_were_moved_tell_how() {
        let moved =
            Pose::new(DQuat::from_euler(glam::EulerRot::ZYX, 2.0, 0.3, -0.4), DVec3::new(3.0, -5.0, 0.5));
        let points_m = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 2.0, 0.0), DVec3::new(1.0, 1.0, 0.0)];
        let there_m = points_m.map(|point_m| moved.transform_point(point_m));
        let found = Pose::between_points(&points_m, &there_m).unwrap();
        assert!(found.rotation.angle_between(moved.rotation) < 1e-9, "{found:?}");
        assert!(found.translation_m.distance(moved.translation_m) < 1e-9);
        assert!(Pose::between_points(&points_m[..2], &there_m[..2]).is_none());
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
