//! What rigs see of one site: a scene, a trajectory through it and the grid that counts.
//!
//! Several views answer: [`CastView`] casts every beam and is exact; [`CellView`] looks at the voxels from the sensor's side,
//! has a stated error, and takes a hundredth of the time; [`super::published::PublishedBox`] is the published experiment to
//! the bit; `MapView` looks at a map that is being recorded. Candidates come in batches: that is what makes it fast.

mod at_rest;
mod cast;
mod cells;
mod fan;
mod map;
mod scans;
mod sites;
mod sphere;
mod tiles;

pub(crate) use at_rest::BeamAtRest;
pub use cast::{CastView, Precision};
pub(crate) use cells::CellHasher;
pub use cells::{BuildCost, CellView, Fineness};
pub use fan::{Fan, Sampling};
pub use map::MapCells;
pub(crate) use map::MapView;
pub use scans::Scans;
pub(crate) use sites::{CastSites, CellSites};

pub use super::quality::Quality;

use super::occluder::Occluder;
use crate::rig::Rig;
use crate::world::coverage::Counts;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Where rigs are judged.
#[derive(Clone, Debug)]
pub struct ViewSite {
    /// What the beams meet.
    pub scene: Scene,
    /// Poses of the body.
    pub trajectory: Trajectory,
    /// What counts it.
    pub grid: crate::world::coverage::VoxelGrid,
    /// What moves with the body and shades.
    pub shades: Shades,
}

/// What of the rig and its operator blocks beams.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shades {
    /// Housings of the other sensors.
    pub has_housings: bool,
    /// Who carries the rig, in the frame of the body.
    pub operator: Option<Occluder>,
}

/// Most voxels of a grid with bitmaps held whole (32 MiB each).
const MOST_VOXELS: usize = 1 << 28;

impl ViewSite {
    fn check(&self) -> Result<(), ViewError> {
        let (cells, voxel_m) = (self.grid.len(), self.grid.voxel_m);
        match cells <= MOST_VOXELS {
            true => Ok(()),
            false => Err(ViewError::TooManyVoxels { voxel_m, cells, most: MOST_VOXELS }),
        }
    }
}

/// What a rig sees. Counts of a model are expectations.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Seen {
    /// Voxels seen by each sensor.
    pub per_sensor: Vec<f64>,
    /// Voxels seen by one sensor or more.
    pub union: f64,
    /// Voxels seen by two sensors or more.
    pub overlap: f64,
    /// Standard deviation of the union's error, voxels; 0 where every beam was cast, none where it was not measured.
    pub sd_voxels: Option<f64>,
    /// Beams cast.
    pub rays: u64,
    /// The same of each site, where there are several; the counts above are their weighted mean then.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_site: Vec<Seen>,
}

impl Seen {
    /// Share of the voxels seen that two sensors or more see; 0 where none is seen.
    pub fn overlap_ratio(&self) -> f64 {
        if self.union > 0.0 { self.overlap / self.union } else { 0.0 }
    }

    /// What was counted, by so many rays.
    pub fn exact(counts: &Counts, rays: u64) -> Self {
        Self {
            per_sensor: counts.per_sensor.iter().map(|count| *count as f64).collect(),
            union: counts.union as f64,
            overlap: counts.overlap as f64,
            sd_voxels: Some(0.0),
            rays,
            by_site: Vec::new(),
        }
    }
}

/// The one answer to "what does this rig see here?".
pub trait View: Sync {
    /// Voxels that some sensor could see from the trajectory.
    fn observable(&self) -> u64;

    /// What each of these rigs sees, in their order. The same on any number of threads and with any instructions.
    fn see(&self, rigs: &[Rig]) -> Vec<Seen>;
}

impl ViewError {
    /// Whether another command line would do.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::Ranges { .. } | Self::TooManyVoxels { .. })
    }
}

/// Why a site cannot be viewed.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// Not one revolution.
    #[error(
        "the trajectory is {duration_s} s long, expected at least one revolution of {revolution_s} s; the trajectory of a rig \
         that stands is the same pose twice"
    )]
    NoRevolution {
        /// Of the trajectory, s.
        duration_s: f64,
        /// Of the slowest sensor, s.
        revolution_s: f64,
    },
    /// A bitmap of the grid takes too much memory.
    #[error(
        "a voxel of {voxel_m} m makes {cells} voxels of this scene, expected {most} at most: give a larger --voxel"
    )]
    TooManyVoxels {
        /// Edge, m.
        voxel_m: f64,
        /// Of the grid.
        cells: usize,
        /// Allowed.
        most: usize,
    },
    /// Range limits out of order.
    #[error(
        "{model}: ranges from {min_range_m} to {max_range_m} m, expected 0 or more, ascending: give a larger --max-range"
    )]
    Ranges {
        /// Of which sensor.
        model: String,
        /// Minimum, m.
        min_range_m: f64,
        /// Maximum, m.
        max_range_m: f64,
    },
    /// Nothing of the scene lies within the sensors' ranges.
    #[error(
        "no surface of the scene can be seen from the trajectory within the limits of range and angle: do scene and trajectory share \
         a frame, and is --max-range large enough? The scene spans {bounds}"
    )]
    NothingVisible {
        /// Bounds of the scene, in words.
        bounds: String,
    },
}
