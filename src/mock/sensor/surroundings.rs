//! What is around a mock sensor.

use crate::base::geometry::Pose;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Where a mock sensor is and what it sees there.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// What stands around it.
    pub scene: &'a Scene,
    /// Where the platform is. The sensor's clock shows this trajectory's times.
    pub trajectory: &'a Trajectory,
    /// Where the sensor sits on the platform, at a time in ns.
    pub body_from_sensor: &'a (dyn Fn(u64) -> Pose + Sync),
    /// Standard deviation of the range noise, m.
    pub noise_m: f64,
    /// Seed of the noise.
    pub seed: u64,
}
