//! The walk of `odometry`: found, placed in a scene, in KITTI format.

use std::path::Path;

use super::Args;
use crate::base::geometry::Pose;
use crate::commands::{Context, scene_file, stage};
use crate::recording::Recording;
use crate::recording::mounted::MountedRecording;
use crate::verify::walk::{self, OdometryResult, Placed, Walk};
use crate::world::trajectory::Trajectory;

/// Runs the odometry; what came of it, and what is odd.
pub(super) fn walked(args: &Args, context: Context) -> anyhow::Result<(OdometryResult, Vec<String>)> {
    let is_placed = args.scene.is_some();
    let mut problems = Vec::new();
    let (spec, settings) = (args.recorded.spec(context), args.settings.spec());
    let result = match MountedRecording::open_if_mounted(&spec)? {
        Some(recorded) => {
            problems.clone_from(&recorded.notices);
            OdometryResult::of_rig(&recorded, &settings, is_placed)?
        }
        None => OdometryResult::of_one(&Recording::open(&spec.recording)?, &settings, is_placed)?,
    };
    problems.extend(result.notices.iter().cloned());
    problems.extend(result.remarks());
    Ok((result, problems))
}

/// The poses of the revolutions that have one, in KITTI format.
pub(super) fn kitti(
    revolutions_ns: &[u64],
    trajectory: &Trajectory,
    problems: &mut Vec<String>,
) -> anyhow::Result<String> {
    let placed = revolutions_ns.iter().filter_map(|at| Some((*at, trajectory.at(*at)?)));
    let begun: Vec<(u64, Pose)> = placed.collect();
    let missing = revolutions_ns.len() - begun.len();
    if missing > 0 {
        problems.push(format!("{missing} revolutions have no pose in the KITTI file"));
    }
    Ok(Trajectory::new(begun)?.to_kitti())
}

/// The trajectory in a scene's frame. Where no place is sure, that is a problem, and nothing is written.
pub(super) fn in_scene(
    args: &Args,
    scene: &Path,
    result: &OdometryResult,
    problems: &mut Vec<String>,
    context: Context,
) -> anyhow::Result<Placed> {
    let read = scene_file::read(scene, &args.mesh, &args.scene_map, context)?;
    problems.extend(read.warnings);
    let walk = Walk {
        trajectory: &result.walked.trajectory,
        rays: &result.rays,
        sensors: &result.mounted,
        time_offset_ns: 0,
        drifts: true,
    };
    let mut placed = walk::in_scene(&walk, &read.scene, read.origin, args.align_near, stage::observer())?;
    placed.trajectory = placed.trajectory.map(|local| local.moved(read.origin.world_m()));
    problems.extend(placed.notices.iter().cloned());
    if placed.trajectory.is_none() {
        problems.push(placed.alignment.words());
        let asked = args.out.is_some() || args.kitti.is_some() || args.map.is_some();
        problems
            .extend(asked.then(|| "no trajectory is written: it has no sure place in the scene".to_owned()));
    }
    Ok(placed)
}
