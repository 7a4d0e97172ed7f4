//! The region of the pair's angles where the two sensors or their mounts would touch.

/// `a * A + b * B >= c`, with A and B the angles of axes 0 and 1 in µrad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HalfPlane {
    /// Weight of axis 0, -1000..=1000.
    pub a: i16,
    /// Weight of axis 1, -1000..=1000.
    pub b: i16,
    /// The edge, weight times µrad.
    pub c: i64,
}

impl HalfPlane {
    /// Positive or zero inside, once the edge is moved out by `margin_urad` on each axis.
    fn depth(&self, point_urad: [i32; 2], margin_urad: i32) -> i64 {
        let [x, y] = point_urad.map(i64::from);
        let (a, b) = (i64::from(self.a), i64::from(self.b));
        a * x + b * y - self.c + (a.abs() + b.abs()) * i64::from(margin_urad)
    }
}

/// A convex region: the points inside every half-plane. No half-plane, no region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeepOut {
    planes: [Option<HalfPlane>; 6],
}

impl KeepOut {
    /// No region at all.
    pub const NONE: Self = Self { planes: [None; 6] };

    /// The region inside these half-planes; `None` for more than six.
    pub fn inside(planes: &[HalfPlane]) -> Option<Self> {
        let mut region = Self::NONE;
        for (at, plane) in planes.iter().enumerate() {
            *region.planes.get_mut(at)? = Some(*plane);
        }
        Some(region)
    }

    fn planes(&self) -> impl Iterator<Item = &HalfPlane> {
        self.planes.iter().flatten()
    }

    /// Whether a point is in the region, widened by a margin on each axis.
    pub fn contains(&self, point_urad: [i32; 2], margin_urad: i32) -> bool {
        let mut planes = self.planes().peekable();
        planes.peek().is_some() && planes.all(|plane| plane.depth(point_urad, margin_urad) >= 0)
    }

    /// Whether the straight segment between two points touches the region, widened by a margin on each axis
    /// (Cyrus and Beck 1978, doi:10.1016/0097-8493(78)90021-3, in exact fractions).
    pub fn crosses(&self, from_urad: [i32; 2], to_urad: [i32; 2], margin_urad: i32) -> bool {
        let mut enter = (0i128, 1i128);
        let mut leave = (1i128, 1i128);
        let mut any = false;
        for plane in self.planes() {
            any = true;
            let start = i128::from(plane.depth(from_urad, margin_urad));
            let end = i128::from(plane.depth(to_urad, margin_urad));
            match (start >= 0, end >= 0) {
                (false, false) => return false,
                (true, true) => {}
                (false, true) => {
                    let at = (-start, end - start);
                    if at.0 * enter.1 > enter.0 * at.1 {
                        enter = at;
                    }
                }
                (true, false) => {
                    let at = (start, start - end);
                    if at.0 * leave.1 < leave.0 * at.1 {
                        leave = at;
                    }
                }
            }
        }
        any && enter.0 * leave.1 <= leave.0 * enter.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> KeepOut {
        // 100 <= A <= 200, -50 <= B <= 50
        let plane = |a, b, c| HalfPlane { a, b, c };
        KeepOut::inside(&[plane(1, 0, 100), plane(-1, 0, -200), plane(0, 1, -50), plane(0, -1, -50)]).unwrap()
    }

    /// Every segment of a coarse grid against 2000 points along it: the region is crossed when a point is inside.
    #[test]
    fn agrees_with_points_along_the_segment() {
        let region = square();
        let mut crossed = 0;
        let grid = || (-40..=340).step_by(20).flat_map(|x| (-120..=120).step_by(20).map(move |y| [x, y]));
        for from in grid() {
            for to in grid().step_by(7) {
                let crosses = region.crosses(from, to, 0);
                let sampled = (0..=2000).any(|t| {
                    let at = |k: usize| from[k] * 1000 + (to[k] - from[k]) * t / 2;
                    (100_000..=200_000).contains(&at(0)) && (-50_000..=50_000).contains(&at(1))
                });
                assert!(!sampled || crosses, "{from:?} -> {to:?}");
                if crosses && !sampled {
                    // a corner that the samples step over: a slightly larger region must contain a sample
                    let near = (0..=2000).any(|t| {
                        let at = |k: usize| from[k] * 1000 + (to[k] - from[k]) * t / 2;
                        (99_000..=201_000).contains(&at(0)) && (-51_000..=51_000).contains(&at(1))
                    });
                    assert!(near, "{from:?} -> {to:?}");
                }
                crossed += usize::from(crosses);
            }
        }
        assert!(crossed > 500);
    }

    #[test]
    fn margin_widens_and_no_plane_is_no_region() {
        assert!(!square().contains([95, 0], 0));
        assert!(square().contains([95, 0], 5));
        assert!(!KeepOut::NONE.contains([0, 0], 1000));
        assert!(!KeepOut::NONE.crosses([0, 0], [1, 1], 1000));
    }

    #[test]
    fn the_margin_counts_on_both_axes() {
        let one_urad_further =
            |at: [i32; 2], margin| [square().contains(at, margin - 1), square().contains(at, margin)];
        for at in [[95, 0], [205, 0], [150, 55], [150, -55]] {
            assert_eq!(one_urad_further(at, 5), [false, true], "{at:?}");
        }
        // B - A >= 100, and each axis may be off by 30
        let apart = KeepOut::inside(&[HalfPlane { a: -1, b: 1, c: 100 }]).unwrap();
        assert!(apart.contains([0, 40], 30) && !apart.contains([0, 39], 30));
        assert!(apart.crosses([0, 0], [0, 40], 30) && !apart.crosses([0, 0], [0, 39], 30));
    }

    #[test]
    fn there_is_room_for_six_planes() {
        let plane = HalfPlane { a: 1, b: 0, c: 0 };
        assert!(KeepOut::inside(&[plane; 6]).is_some() && KeepOut::inside(&[plane; 7]).is_none());
    }
}
