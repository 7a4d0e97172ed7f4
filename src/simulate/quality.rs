//! When a voxel counts as seen: how near, how squarely and how often it must be met.

use serde::Serialize;

use crate::base::numbers::counted;

/// Limits that a return must keep, and returns that a voxel must have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Farther returns do not count, m; the model's own limit where none.
    pub max_range_m: Option<f64>,
    /// Neither do those with a larger angle between beam and surface normal, degrees.
    pub max_incidence_deg: Option<f64>,
    /// Returns of all sensors together that make a voxel count.
    pub min_hits: u16,
}

impl Default for Quality {
    /// One return, however far and oblique.
    fn default() -> Self {
        Self { max_range_m: None, max_incidence_deg: None, min_hits: 1 }
    }
}

impl Quality {
    /// Itself, where it asks for anything.
    pub(crate) fn asked(self) -> Option<Self> {
        (self != Self::default()).then_some(self)
    }

    /// Least cosine between a beam and the normal against it; 0 where any counts.
    pub(crate) fn min_cosine(&self) -> f64 {
        self.max_incidence_deg.map_or(0.0, |angle_deg| angle_deg.to_radians().cos())
    }

    /// In words. `is_share_limited`: whether what can be seen is counted within the same range and angle.
    pub(crate) fn words(&self, is_share_limited: bool) -> String {
        let mut words = format!("a voxel needs {}", counted(u64::from(self.min_hits), "return"));
        if let Some(angle_deg) = self.max_incidence_deg {
            words += &format!(", at {angle_deg}° or less from the surface's normal");
        }
        if let Some(range_m) = self.max_range_m {
            words += &format!(", from {range_m} m or less");
        }
        words
            + match (is_share_limited, self.min_hits > 1) {
                (false, _) => "; \"can be seen\" means a line of sight at any range and angle",
                (true, true) => "; \"can be seen\" means within range and angle, however many returns",
                (true, false) => "; \"can be seen\" has the same limits",
            }
    }
}
