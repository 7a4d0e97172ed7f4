//! The line below a cloud of delayed stamps: packets come late by different amounts and never early, so the earliest of them
//! show how two clocks stand to each other.
//!
//! Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay measurements",
//! doi:10.1109/INFCOM.1999.749287: of all lines below the cloud the one that is nearest to it on the whole. It is an edge of
//! the lower convex hull, the one over the mean of the times.

/// A line and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Time at which `offset_ns` holds: the mean of the points' times, ns.
    pub at_ns: f64,
    /// Its height there, ns.
    pub offset_ns: f64,
    /// How much it rises, ns per ns.
    pub slope: f64,
    /// Half the width in which the true height lies at `at_ns`, ns.
    pub offset_uncertainty_ns: f64,
    /// Half the width in which the true slope lies.
    pub slope_uncertainty: f64,
}

impl Line {
    /// Its height at a time, ns.
    pub(crate) fn height_ns(&self, at_ns: f64) -> f64 {
        self.offset_ns + self.slope * (at_ns - self.at_ns)
    }

    /// Half the width in which the true height lies at a time, ns.
    pub(crate) fn uncertainty_ns(&self, at_ns: f64) -> f64 {
        self.offset_uncertainty_ns + self.slope_uncertainty * (at_ns - self.at_ns).abs()
    }
}

/// The line below points (time, height), in the order of time; none for fewer than three points or without time between
/// them.
pub(crate) fn below(points: &[[f64; 2]]) -> Option<Line> {
    let (first, last) = (points.first()?, points.last()?);
    let span_ns = last[0] - first[0];
    if points.len() < 3 || span_ns <= 0.0 {
        return None;
    }
    let mean_ns = points.iter().map(|point| point[0]).sum::<f64>() / points.len() as f64;
    let hull = lower_hull(points);
    let edge = hull.windows(2).find(|edge| edge[0][0] <= mean_ns && mean_ns <= edge[1][0])?;
    let slope = (edge[1][1] - edge[0][1]) / (edge[1][0] - edge[0][0]);
    let offset_ns = edge[0][1] + slope * (mean_ns - edge[0][0]);
    let above = |point: &[f64; 2]| point[1] - (offset_ns + slope * (point[0] - mean_ns));
    // what the quicker half of the points is late by, as a measure of how much the quickest may be late
    let mut late: Vec<f64> = points.iter().map(above).collect();
    late.sort_by(f64::total_cmp);
    let typical_ns = late[late.len() / 2].max(0.0);
    Some(Line {
        at_ns: mean_ns,
        offset_ns,
        slope,
        offset_uncertainty_ns: typical_ns,
        slope_uncertainty: 2.0 * typical_ns / span_ns,
    })
}

/// The corners of the convex hull from below (Andrew's monotone chain, doi:10.1016/0020-0190(79)90072-3).
fn lower_hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for point in points {
        while let [.., a, b] = hull[..] {
            let turn = (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]);
            if turn > 0.0 {
                break;
            }
            hull.pop();
        }
        // of two at one time the lower counts
        match hull.last() {
            Some(last) if last[0] == point[0] && last[1] <= point[1] => {}
            _ => hull.push(*point),
        }
    }
    hull
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_line_with_late_points_is_found() {
        let points: Vec<[f64; 2]> = (0..100)
            .map(|i| {
                let late = if i % 7 == 0 { 0.0 } else { 50.0 * f64::from(i % 5) };
                [1e9 * f64::from(i), 1000.0 + 20.0 * f64::from(i) + late]
            })
            .collect();
        let line = below(&points).unwrap();
        assert!((line.slope - 20e-9).abs() < 1e-12, "{line:?}");
        assert!((line.height_ns(0.0) - 1000.0).abs() < 1e-6, "{line:?}");
        assert_eq!(below(&points[..2]), None);
        assert_eq!(below(&[[0.0, 1.0], [0.0, 2.0], [0.0, 3.0]]), None);
    }

    proptest! {
        /// No point lies below the line, and two lie on it.
        #[test]
        fn it_lies_below_and_touches(heights in proptest::collection::vec(0.0f64..1e6, 3..80)) {
            let points: Vec<[f64; 2]> = heights.iter().enumerate().map(|(i, y)| [1e9 * i as f64, *y]).collect();
            let line = below(&points).unwrap();
            let above = |p: &[f64; 2]| p[1] - line.height_ns(p[0]);
            prop_assert!(points.iter().all(|point| above(point) > -1e-3));
            prop_assert!(points.iter().filter(|point| above(point).abs() < 1e-3).count() >= 2);
        }
    }
}
