//! An axis-aligned box seen from inside, any of its faces absent.

use glam::DVec3;

use super::Hit;

/// A box of up to six faces.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxScene {
    /// Minimum corner, m.
    pub min_m: DVec3,
    /// Maximum corner, m.
    pub max_m: DVec3,
    /// Which faces exist: `[[-x, +x], [-y, +y], [-z, +z]]`.
    pub faces: [[bool; 2]; 3],
}

impl BoxScene {
    /// A box with all six faces.
    pub fn closed(min_m: DVec3, max_m: DVec3) -> Self {
        Self { min_m, max_m, faces: [[true; 2]; 3] }
    }

    /// The same box elsewhere.
    pub(crate) fn moved(&self, by_m: DVec3) -> Self {
        Self { min_m: self.min_m + by_m, max_m: self.max_m + by_m, ..self.clone() }
    }

    /// First face that a ray from inside reaches. Rays that start outside or on no side of a present face miss it.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for axis in 0..3 {
            let slope = direction[axis];
            if slope == 0.0 {
                continue;
            }
            let side = usize::from(slope > 0.0);
            if !self.faces[axis][side] {
                continue;
            }
            let plane = if side == 1 { self.max_m[axis] } else { self.min_m[axis] };
            let distance_m = (plane - origin_m[axis]) / slope;
            if distance_m < 0.0 || best.is_some_and(|hit| hit.distance_m <= distance_m) {
                continue;
            }
            let point = origin_m + distance_m * direction;
            let inside = (0..3).all(|other| {
                other == axis || (point[other] >= self.min_m[other] && point[other] <= self.max_m[other])
            });
            if inside {
                let mut normal = DVec3::ZERO;
                normal[axis] = -slope.signum();
                best = Some(Hit { distance_m, normal });
            }
        }
        best
    }
}
