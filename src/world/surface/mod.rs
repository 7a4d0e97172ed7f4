//! How much of a surface was seen: sample points that have a return within 2, 5 or 10 cm, of all points and of those
//! that can be seen from the path at all.
//!
//! Hits stream in and are not stored. Each threshold holds the points it still misses in a hash of cells; a hit looks
//! into one cell per threshold, and where everything is found already the cell is gone. Distances are exact.

mod completeness;
mod level;
mod npy;
mod observable;
mod shares;

pub use completeness::{Adder, Completeness, THRESHOLDS_M};
pub(crate) use npy::write_flags;
pub use npy::{NpyError, read_points};
pub(crate) use shares::{MAIN_RANK, ObservableSurface, SurfaceShares};

use glam::DVec3;

use crate::world::scene::Mesh;

/// Points on a surface, spread evenly over its area.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceSamples {
    points_m: Vec<DVec3>,
}

impl SurfaceSamples {
    /// Given points, m.
    ///
    /// # Errors
    /// No point, or the first that is not finite.
    pub fn new(points_m: Vec<DVec3>) -> Result<Self, SamplesError> {
        if points_m.is_empty() {
            return Err(SamplesError::Empty);
        }
        match points_m.iter().position(|point| !point.is_finite()) {
            Some(index) => Err(SamplesError::NotFinite { index }),
            None => Ok(Self { points_m }),
        }
    }

    /// `count` points (at least one) of a mesh, the same for the same seed.
    pub fn of_mesh(mesh: &Mesh, count: usize, seed: u64) -> Self {
        Self { points_m: mesh.sample(count.max(1), seed) }
    }

    /// The points, m.
    pub fn points_m(&self) -> &[DVec3] {
        &self.points_m
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points_m.len()
    }

    /// Never: there is at least one point.
    pub fn is_empty(&self) -> bool {
        self.points_m.is_empty()
    }

    /// Numbers of the points along a space-filling curve: neighbours in the list are neighbours in space.
    fn order(&self) -> Vec<u32> {
        use rayon::slice::ParallelSliceMut as _;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for point in &self.points_m {
            low = low.min(*point);
            high = high.max(*point);
        }
        let scale = 65535.0 / (high - low).max_element().max(1e-9);
        let mut keyed: Vec<(u64, u32)> =
            (0..).zip(&self.points_m).map(|(n, p)| (morton(*p, low, scale), n)).collect();
        keyed.par_sort_unstable();
        keyed.into_iter().map(|(_, index)| index).collect()
    }
}

/// Z-order of 16 bits per axis (Morton 1966).
fn morton(point: DVec3, low: DVec3, scale: f64) -> u64 {
    let at = (point - low) * scale;
    let spread = |value: f64| {
        let mut bits = value as u64 & 0xffff;
        bits = (bits | bits << 32) & 0x0000_ffff_0000_ffff & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x1249_2492_4924_9249
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// What is wrong with sample points.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SamplesError {
    /// No point at all.
    #[error("no sample points")]
    Empty,
    /// NaN or infinite.
    #[error("sample point {index} (counted from 0) is not finite")]
    NotFinite {
        /// Position in the list.
        index: usize,
    },
}
