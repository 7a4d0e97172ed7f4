//! One local origin for scene, trajectory and map. National grids, UTM and earth-centred frames put coordinates at 1e5 to 1e7 m,
//! where fine grids have no numbers left for their cells. All that lies in such a frame is read in f64, moved once by whole
//! metres, computed there, and moved back in every output.

use glam::DVec3;

use super::trajectory::Trajectory;

/// Along an axis on which a scene is nearer than this to the origin of its file, it stays where it is, m.
const FAR_M: f64 = 10_000.0;

/// Where the local frame begins in the frame of the files: whole metres, so that moving there and back loses no bit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalOrigin(DVec3);

impl LocalOrigin {
    /// Near the middle of a box (minimum and maximum corner, m); none where it is near the origin itself.
    pub(crate) fn of_box([low_m, high_m]: [DVec3; 2]) -> Self {
        Self::near(0.5 * (low_m + high_m))
    }

    /// Near a point.
    pub(crate) fn near(point_m: DVec3) -> Self {
        let far_or_none =
            |value: f64| if value.is_finite() && value.abs() >= FAR_M { value.round() } else { 0.0 };
        Self(DVec3::from(point_m.to_array().map(far_or_none)))
    }

    /// In the frame of the files, m.
    pub(crate) fn world_m(self) -> DVec3 {
        self.0
    }

    /// A point of the files in the local frame, m.
    pub(crate) fn local(self, world_m: DVec3) -> DVec3 {
        world_m - self.0
    }

    /// A point of the local frame in that of the files, m.
    pub fn world(self, local_m: DVec3) -> DVec3 {
        local_m + self.0
    }

    /// A trajectory of the files in the local frame.
    pub(crate) fn local_trajectory(self, world: Trajectory) -> Trajectory {
        if self.0 == DVec3::ZERO { world } else { world.moved(-self.0) }
    }

    /// In words; none where nothing is moved.
    pub(crate) fn words(self) -> Option<String> {
        let [x, y, z] = self.0.to_array();
        let words = format!("({x:.0}, {y:.0}, {z:.0}) m: computed around it, moved back in every output");
        (self.0 != DVec3::ZERO).then_some(words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moving_there_and_back_loses_no_bit() {
        let point_m = DVec3::new(412_341.37, 5_567_887.63, 312.2);
        for low_m in [point_m, -point_m, DVec3::new(4_156_789.125, -1e4, 0.1), DVec3::ZERO] {
            let origin = LocalOrigin::of_box([low_m, low_m + DVec3::new(8.0, 6.0, 3.0)]);
            assert_eq!(origin.world(origin.local(low_m)), low_m);
            assert!(origin.local(low_m).abs().max_element() <= 10_000.0);
            assert_eq!(origin.world_m(), origin.world_m().round());
        }
        assert_eq!(LocalOrigin::near(DVec3::splat(9_000.0)), LocalOrigin::default());
        assert_eq!(LocalOrigin::near(DVec3::splat(f64::NAN)), LocalOrigin::default());
    }
}
