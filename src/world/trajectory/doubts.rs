//! What makes a trajectory doubtful, alone and in a scene; where sensors look from along it.

use glam::DVec3;

use super::{Trajectory, WalkLimits};

/// Distance travelled between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 0.5;
/// Gaps, jumps and spins that are listed one by one.
const LISTED: usize = 3;

/// What is odd about a trajectory in itself, each line after its name.
pub(crate) fn suspicions(trajectory: &Trajectory, name: &str) -> Vec<String> {
    let found = trajectory.suspicions(&WalkLimits::default());
    let listed = found.iter().take(LISTED).map(|suspicion| format!("{name}: {suspicion}"));
    let more = found.len().saturating_sub(LISTED);
    listed.chain((more > 0).then(|| format!("{name}: {more} more gaps, jumps or spins"))).collect()
}

impl Trajectory {
    /// Points of the path, lifted to a height above the body's origin, from which lines of sight are drawn.
    pub(crate) fn sight_stations_m(&self, height_m: f64) -> Vec<DVec3> {
        self.stations_m(STATION_STEP_M).into_iter().map(|at| at + height_m * DVec3::Z).collect()
    }
}
