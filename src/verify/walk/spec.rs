//! What is given of where a recording was made.

use std::ops::Range;

use super::by_odometry::OdometrySpec;
use super::clocks::Offset;
use crate::recording::scene::MapSpec;
use crate::recording::{Observer, TrajectorySource};
use crate::verify::align::Hint;
use crate::world::scene::LoadedScene;

/// Where a recording was made, as far as it is given.
pub(crate) struct WalkSiteSpec {
    /// None where the map is made of frames of the recording.
    pub scene: Option<LoadedScene>,
    /// Frames that make a map, and how.
    pub map_of: Option<(Range<u64>, MapSpec)>,
    /// None for the recording's own, and odometry where it holds none.
    pub trajectory: Option<TrajectorySource>,
    /// Poses per second of a file without times.
    pub rate_hz: Option<f64>,
    pub odometry: OdometrySpec,
    /// The trajectory lies in a frame of its own.
    pub is_aligned: bool,
    /// Where the walk begins in the scene, about.
    pub near: Option<Hint>,
    pub time_offset: Offset,
    pub observer: Observer,
}
