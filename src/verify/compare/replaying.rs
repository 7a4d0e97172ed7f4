//! A recording laid against a scene: the coverages that are judged.

use std::ops::Range;

use super::{Gate, Patches, Replay, Replayed};
use crate::base::numbers::counted;
use crate::recording::RecordingError;
use crate::recording::mounted::{MountedFrame, PassSummary};
use crate::rig::Rig;
use crate::simulate::scan::{Scanner, Spin};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Most frames after which what was found is dropped from the search.
const SETTLE_EVERY: u64 = 16;
/// Most voxels of a comparison, each of which is a bit of several bitmaps (2 GiB each).
const MAX_VOXELS: f64 = 17_179_869_184.0;

/// A grid over a scene.
pub(crate) fn grid_over(scene: &Scene, voxel_m: f64) -> Result<VoxelGrid, TooManyVoxels> {
    let bounds_m = scene.bounds_m();
    let voxels = (bounds_m[1] - bounds_m[0]) / voxel_m + 2.0;
    if voxels.max_element() > f64::from(1 << 23) || voxels.element_product() > MAX_VOXELS {
        return Err(TooManyVoxels { voxel_m, voxels });
    }
    Ok(VoxelGrid::centred_on(bounds_m, voxel_m))
}

/// A grid that no memory holds.
#[derive(Debug, thiserror::Error)]
#[error(
    "--voxel {voxel_m} makes {voxels:.0} cells of this scene, expected {MAX_VOXELS:.0} in all at most; is the mesh in metres?"
)]
pub(crate) struct TooManyVoxels {
    voxel_m: f64,
    voxels: glam::DVec3,
}

/// Samples of the surface that can be seen from points of the trajectory so far apart, m.
pub(crate) fn seen_patches(
    scene: &Scene,
    rig_height_m: f64,
    trajectory: &Trajectory,
    (samples, step_m, seed): (usize, f64, u64),
) -> Option<Patches> {
    let up_m = rig_height_m * glam::DVec3::Z;
    let stations_m: Vec<_> = trajectory.stations_m(step_m).into_iter().map(|at_m| at_m + up_m).collect();
    Patches::of_scene(scene, samples, seed, &stations_m)
}

/// What a recording is laid against.
pub(crate) struct Replaying<'a> {
    pub scene: &'a Scene,
    pub trajectory: &'a Trajectory,
    pub rig: &'a Rig,
    pub grid: &'a VoxelGrid,
    pub gate: Gate,
    pub patches: Option<&'a Patches>,
    /// Frames of each sensor that are left out: they made the map.
    pub mapped: Range<u64>,
}

/// Why nothing is left to compare.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReplayingError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Silent because nothing of it was left, not because it is dead.
    #[error(
        "--map-frames 0..{mapped} leaves nothing to compare, {sensor} recorded {}: expected fewer in the map; a single one \
         can be compared with another session or a mesh (--scene)",
        counted(*.frames, "revolution")
    )]
    UsedUp { sensor: String, frames: u64, mapped: u64 },
}

impl Replaying<'_> {
    /// Replays the frames that `feed` hands out.
    pub(crate) fn run(
        &self,
        feed: impl FnOnce(&mut dyn FnMut(MountedFrame<'_>)) -> Result<PassSummary, RecordingError>,
    ) -> Result<(Replayed, PassSummary), ReplayingError> {
        let sensors = self.rig.sensors.clone();
        let mut replay = Replay::new(self.scene, self.trajectory, sensors, self.grid, self.gate);
        if let Some(patches) = self.patches {
            replay = replay.with_surface(patches);
        }
        let mut frames = 0_u64;
        let pass = feed(&mut |mounted| {
            if self.mapped.contains(&mounted.number) {
                return;
            }
            replay.set_model(mounted.sensor, mounted.model);
            let pitch = mounted.pitch_or(&self.rig.sensors[mounted.sensor].mount);
            replay.add_pitched_frame(mounted.sensor, &pitch, mounted.frame);
            frames += 1;
            // often at first, when most is found
            if frames.is_power_of_two() || frames.is_multiple_of(SETTLE_EVERY * 8) {
                replay.settle();
            }
        })?;
        let mapped = self.mapped.end;
        let is_used_up = |frames: u64| frames > 0 && self.mapped.start == 0 && frames <= mapped;
        if let Some(sensor) = pass.sensors.iter().find(|sensor| is_used_up(sensor.frames)) {
            let (sensor, frames) = (sensor.sensor.clone(), sensor.frames);
            return Err(ReplayingError::UsedUp { sensor, frames, mapped });
        }
        Ok((replay.finish(), pass))
    }
}

/// What the nominal mounts cover on a planned trajectory.
pub(crate) fn cover_planned(scene: &Scene, trajectory: &Trajectory, rig: &Rig, grid: &VoxelGrid) -> Coverage {
    let mut scanner = Scanner::new(scene, trajectory, rig, Spin::default());
    // a replay lets beams pass through the other sensors too
    scanner.occluders.iter_mut().for_each(Vec::clear);
    let mut coverage = Coverage::new(grid.clone(), rig.sensors.len());
    scanner.cover(&mut coverage);
    coverage
}
