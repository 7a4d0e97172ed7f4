//! A real scene at any fineness.

use std::convert::Infallible;

use sensors::SensorModel;

use super::Ladder;
use crate::coverage::VoxelGrid;
use crate::rig::Mount;
use crate::scene::Scene;
use crate::simulate::fan::BeamFan;
use crate::trajectory::Trajectory;

/// Sensors carried through a scene, from few columns and scans to as many as a real one takes; scored by the voxels
/// that they see.
#[derive(Clone, Debug)]
pub struct SceneLadder {
    scene: Scene,
    trajectory: Trajectory,
    grid: VoxelGrid,
    fans: Vec<(String, BeamFan)>,
}

/// Columns per revolution and revolutions per second, level by level.
const LEVELS: [(usize, f64); 7] =
    [(90, 1.25), (90, 2.5), (180, 2.5), (180, 5.0), (360, 5.0), (360, 10.0), (720, 10.0)];

impl SceneLadder {
    /// The levels of a sensor model along a trajectory; voxels of `voxel_m`, the planes of the scene's bounds through
    /// their centres.
    pub fn new(scene: Scene, trajectory: Trajectory, model: &SensorModel, voxel_m: f64) -> Self {
        let grid = VoxelGrid::centred_on(scene.bounds_m(), voxel_m);
        let fan = |(columns, rate_hz)| {
            let name = format!("{columns} columns, {rate_hz} scans per second");
            (name, BeamFan::nominal(model, columns, rate_hz))
        };
        Self { scene, trajectory, grid, fans: LEVELS.into_iter().map(fan).collect() }
    }

    /// Voxels that mounts see with beams of any fineness.
    pub fn voxels(&self, fan: &BeamFan, mounts: &[Mount]) -> u64 {
        fan.coverage(&self.scene, &self.trajectory, mounts, &self.grid).0.union_count()
    }

    /// Rays that this takes.
    pub fn rays_of(&self, fan: &BeamFan, mounts: &[Mount]) -> u64 {
        fan.scans(&self.trajectory) * mounts.len() as u64 * fan.rays_per_scan()
    }
}

impl Ladder for SceneLadder {
    type Candidate = Vec<Mount>;
    type Error = Infallible;

    fn levels(&self) -> usize {
        self.fans.len()
    }

    fn rays(&self, level: usize, mounts: &Vec<Mount>) -> u64 {
        self.rays_of(&self.fans[level].1, mounts)
    }

    fn name(&self, level: usize) -> String {
        self.fans[level].0.clone()
    }

    fn score(&self, level: usize, mounts: &Vec<Mount>) -> Result<f64, Infallible> {
        Ok(self.voxels(&self.fans[level].1, mounts) as f64)
    }
}
