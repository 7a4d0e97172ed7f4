//! The returns of a walk in the frame of its trajectory.

use glam::DVec3;
use rayon::prelude::*;

use crate::base::geometry::Pose;
use crate::rig::MountedSensor;
use crate::verify::compare::RecordedRay;
use crate::world::trajectory::Trajectory;

/// Nearer returns come from the rig and its operator, m.
const NEAREST_M: f64 = 0.5;

/// One return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkReturn {
    /// Where its beam started, m.
    pub origin_m: DVec3,
    /// Where it ended, m.
    pub point_m: DVec3,
    /// On the trajectory's clock.
    pub time_ns: u64,
}

impl WalkReturn {
    pub(super) fn moved(&self, by: &Pose) -> Self {
        let [origin_m, point_m] = [self.origin_m, self.point_m].map(|at_m| by.transform_point(at_m));
        Self { origin_m, point_m, ..*self }
    }

    pub(super) fn range_m(&self) -> f64 {
        self.origin_m.distance(self.point_m)
    }
}

/// The returns of recorded rays (in order of time) that lie within the trajectory's time.
pub fn walk_returns(
    rays: &[RecordedRay],
    sensors: &[MountedSensor],
    trajectory: &Trajectory,
) -> Vec<WalkReturn> {
    let placed = |ray: &RecordedRay| {
        let range_m = ray.range_m?;
        let placed = ray.place_on(sensors, trajectory, ray.time_ns)?;
        let found =
            WalkReturn { origin_m: placed.origin_m, point_m: placed.at_range(range_m), time_ns: ray.time_ns };
        (found.point_m.is_finite() && found.range_m() >= NEAREST_M).then_some(found)
    };
    let found: Vec<Option<WalkReturn>> = rays.par_iter().map(placed).collect();
    found.into_iter().flatten().collect()
}

/// At most so many, evenly spread.
pub(super) fn evenly<T: Copy>(items: &[T], most: usize) -> Vec<T> {
    let count = items.len().min(most);
    (0..count).map(|at| items[at * items.len() / count]).collect()
}
