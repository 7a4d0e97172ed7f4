//! A real scene at any fineness.

use std::convert::Infallible;

use sensors::SensorModel;

use super::{LEVELS, Ladder};
use crate::coverage::{Coverage, VoxelGrid};
use crate::rig::{Mount, MountedSensor, Rig};
use crate::scene::Scene;
use crate::simulate::fan::BeamFan;
use crate::simulate::published::Phase;
use crate::simulate::scan::{Flaws, Scanner, Spin};
use crate::trajectory::Trajectory;

/// Sensors carried through a scene, scored by the voxels that they see: from the rays of the published sampling on this
/// way (180 columns once per metre) to 64 times as many, spread like those of the published box.
#[derive(Clone, Debug)]
pub struct SceneLadder {
    scene: Scene,
    trajectory: Trajectory,
    grid: VoxelGrid,
    model: SensorModel,
    fans: Vec<(String, BeamFan)>,
}

/// Columns per revolution of the published sampling, which has one revolution per metre.
const AZIMUTHS: usize = 180;

impl SceneLadder {
    /// The levels of a sensor model along a trajectory; voxels of `voxel_m`, the planes of the scene's bounds through
    /// their centres.
    pub fn new(scene: Scene, trajectory: Trajectory, model: &SensorModel, voxel_m: f64) -> Self {
        let grid = VoxelGrid::centred_on(scene.bounds_m(), voxel_m);
        let mut ladder = Self { scene, trajectory, grid, model: model.clone(), fans: Vec::new() };
        ladder.fans = LEVELS
            .into_iter()
            .map(|(azimuths, sub_poses)| {
                let (azimuths, per_m) = (AZIMUTHS * azimuths, sub_poses as f64);
                let name = format!("{azimuths} azimuths, {sub_poses} poses per metre");
                (name, ladder.fan(azimuths, per_m, Phase::Free))
            })
            .collect();
        ladder
    }

    /// Columns per revolution, and revolutions spread evenly over the time of the way: so many per metre, at least one.
    pub fn fan(&self, azimuths: usize, per_metre: f64, phase: Phase) -> BeamFan {
        let [start_ns, end_ns] = self.trajectory.time_span_ns();
        let revolutions = (self.trajectory.length_m() * per_metre).ceil().max(1.0);
        let rate_hz = revolutions / ((end_ns - start_ns) as f64 * 1e-9).max(1e-9);
        let mut fan = BeamFan::nominal(&self.model, azimuths, rate_hz);
        fan.phase = phase;
        fan
    }

    /// Voxels that mounts see with beams of any fineness.
    pub fn voxels(&self, fan: &BeamFan, mounts: &[Mount]) -> u64 {
        fan.coverage(&self.scene, &self.trajectory, mounts, &self.grid).0.union_count()
    }

    /// The same way with other voxels.
    pub fn with_voxels(&self, voxel_m: f64) -> Self {
        Self { grid: VoxelGrid::centred_on(self.scene.bounds_m(), voxel_m), ..self.clone() }
    }

    /// Edge of a voxel, m.
    pub fn voxel_m(&self) -> f64 {
        self.grid.voxel_m
    }

    /// Voxels that mounts see by the whole sensor model (beam offsets, firing times) with as many columns and revolutions
    /// as the fan has.
    pub fn voxels_sensed(&self, fan: &BeamFan, mounts: &[Mount], flaws: Flaws, with_housings: bool) -> u64 {
        let sensor = |(index, mount): (usize, &Mount)| MountedSensor {
            name: format!("{}", index + 1),
            model: self.model.clone(),
            mount: *mount,
        };
        let rig = Rig { sensors: mounts.iter().enumerate().map(sensor).collect() };
        let spin = Spin { rate_hz: fan.rate_hz, columns: fan.columns() as u32, ..Spin::default() };
        let mut scanner = Scanner { flaws, ..Scanner::new(&self.scene, &self.trajectory, &rig, spin) };
        if !with_housings {
            scanner.occluders.iter_mut().for_each(Vec::clear);
        }
        let mut coverage = Coverage::new(self.grid.clone(), mounts.len());
        scanner.cover(&mut coverage);
        coverage.union_count()
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
