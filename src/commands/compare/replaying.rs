//! The coverages that `compare` judges: of the recording, and of the planned trajectory.

use anyhow::bail;

use super::Args;
use super::place::Place;
use crate::commands::output;
use crate::commands::recorded::Recorded;
use crate::commands::recorded::pass_summary::{PassSummary, SensorSummary};
use crate::commands::trajectory_args::read_trajectory;
use crate::rig::Rig;
use crate::simulate::scan::{Scanner, Spin};
use crate::verify::compare::{Gate, Patches, Replay, Replayed};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Samples of the surface.
const SAMPLES: usize = 200_000;
/// Distance between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 0.5;
/// Most frames after which what was found is dropped from the search.
const SETTLE_EVERY: u64 = 16;
/// Most cells of a comparison, each of which is a bit of several bitmaps (2 GiB each).
const MOST_CELLS: f64 = 17_179_869_184.0;

pub(super) fn grid(args: &Args, scene: &Scene) -> anyhow::Result<VoxelGrid> {
    let bounds_m = scene.bounds_m();
    let cells = (bounds_m[1] - bounds_m[0]) / args.voxel + 2.0;
    if cells.max_element() > f64::from(1 << 23) || cells.element_product() > MOST_CELLS {
        bail!(
            "--voxel {} makes {cells:.0} cells of this scene, expected {MOST_CELLS:.0} in all at most; is the mesh in metres?",
            args.voxel
        );
    }
    Ok(VoxelGrid::centred_on(bounds_m, args.voxel))
}

/// The surface that can be seen from the trajectory.
pub(super) fn patches(args: &Args, scene: &Scene, rig: &Rig, trajectory: &Trajectory) -> Option<Patches> {
    let height_m = rig.mean_height_m();
    let stations: Vec<_> =
        trajectory.stations_m(STATION_STEP_M).into_iter().map(|at| at + height_m * glam::DVec3::Z).collect();
    Patches::of_scene(scene, SAMPLES, args.seed, &stations)
}

/// Replays all frames but those that made the map.
pub(super) fn replayed(
    args: &Args,
    recorded: &Recorded,
    place: &Place,
    grid: &VoxelGrid,
    patches: Option<&Patches>,
) -> anyhow::Result<(Replayed, PassSummary)> {
    let gate = Gate { agree_within_m: args.gate, time_offset_ns: place.time_offset_ns, ..Gate::default() };
    let sensors = recorded.rig.sensors.clone();
    let mut replay = Replay::new(&place.scene, &place.trajectory, sensors, grid, gate);
    if let Some(patches) = patches {
        replay = replay.with_surface(patches);
    }
    let mapped = &place.mapped;
    let mut frames = 0_u64;
    let pass = recorded.feed(&mut |mounted_frame| {
        if mapped.contains(&mounted_frame.number) {
            return;
        }
        replay.set_model(mounted_frame.sensor, mounted_frame.model);
        let pitch = mounted_frame.pitch_or(&recorded.rig.sensors[mounted_frame.sensor].mount);
        replay.add_pitched_frame(mounted_frame.sensor, &pitch, mounted_frame.frame);
        frames += 1;
        // often at first, when most is found
        if frames.is_power_of_two() || frames.is_multiple_of(SETTLE_EVERY * 8) {
            replay.settle();
        }
    })?;
    // silent because nothing of it was left, not because it is dead
    let used_up = pass.sensors.iter().find(|s| s.frames > 0 && mapped.start == 0 && s.frames <= mapped.end);
    if let Some(SensorSummary { sensor, frames, .. }) = used_up {
        bail!(
            "--map-frames 0..{} leaves nothing to compare: {sensor} recorded {frames} revolutions",
            mapped.end
        );
    }
    Ok((replay.finish(), pass))
}

/// What the nominal mounts cover on the planned trajectory.
pub(super) fn planned(
    args: &Args,
    scene: &Scene,
    rig: &Rig,
    grid: &VoxelGrid,
    origin: LocalOrigin,
) -> anyhow::Result<Option<Coverage>> {
    let Some(path) = &args.planned else { return Ok(None) };
    let (trajectory, notes) = read_trajectory(path, None)?;
    notes.iter().for_each(|note| output::say_notice(note));
    let trajectory = origin.local_trajectory(trajectory);
    let mut scanner = Scanner::new(scene, &trajectory, rig, Spin::default());
    // a replay lets beams pass through the other sensors too
    scanner.occluders.iter_mut().for_each(Vec::clear);
    let mut coverage = Coverage::new(grid.clone(), rig.sensors.len());
    scanner.cover(&mut coverage);
    Ok(Some(coverage))
}
