//! The scene and the trajectory of a search.

use anyhow::{Context as _, bail};
use glam::DVec3;

use super::args::Args;
use crate::commands::scene_args::Operator;
use crate::commands::{Context, scene_file, wrong_usage};
use crate::recording::walk_text::WalkText;
use crate::simulate::prediction::grid_of;
use crate::simulate::view::{Shades, ViewSite};
use crate::simulate::walk::Walk;
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::LoadedScene;
use crate::world::trajectory::Trajectory;

/// Edge of a voxel where none is given, m.
const DEFAULT_VOXEL_M: f64 = 0.1;

/// Where is searched, what is odd about it, and where the trajectory comes from.
pub(super) fn site(args: &Args, context: Context) -> anyhow::Result<(ViewSite, Vec<String>, WalkSource)> {
    let scene_args = &args.scene;
    let (scene, room) = (scene_args.scene.as_deref(), scene_args.room);
    let loaded = scene_file::read_or_room(scene, room, &scene_args.mesh, &scene_args.map, context)?;
    let mut loaded = loaded.context("give --scene or --room")?;
    scene_args.quality.ensure_known_in(&loaded.scene)?;
    let (trajectory, source) = walk_of(args, context, &mut loaded)?;
    let voxel_m = args.experiment.of_scene().voxel_m.unwrap_or(DEFAULT_VOXEL_M);
    let grid = grid_of(&loaded.scene, voxel_m).map_err(wrong_usage)?;
    let operator = scene_args.operator.map(|Operator(capsule)| capsule);
    let shades = Shades { has_housings: !scene_args.ideal, operator };
    Ok((ViewSite { scene: loaded.scene, trajectory, grid, shades }, loaded.warnings, source))
}

/// Where the trajectory comes from.
pub(super) struct WalkSource {
    pub name: String,
    /// Of a walk that was planned here.
    pub corners_m: Vec<DVec3>,
    /// Where the local frame of scene and trajectory begins.
    pub origin: LocalOrigin,
}

fn walk_of(
    args: &Args,
    context: Context,
    loaded: &mut LoadedScene,
) -> anyhow::Result<(Trajectory, WalkSource)> {
    if !matches!(args.scene.trajectory, Some(WalkText::File(_))) {
        context.ensure_not_typed(&["rate"], "is about a trajectory in KITTI format, which is not given")?;
    }
    let source = args.scene.trajectory.as_ref();
    let Walk { trajectory, corners_m, doubts } =
        WalkText::walk_through(source, args.scene.rate, &loaded.scene, loaded.origin)?;
    let name = match source {
        None => format!("planned through the free floor, {} legs", corners_m.len() - 1),
        Some(WalkText::Waypoints(waypoints)) => format!("{} waypoints", waypoints.len()),
        Some(WalkText::File(path)) => path.display().to_string(),
    };
    loaded.warnings.extend(doubts);
    let scene = &loaded.scene;
    let placement = Placement::new(scene, &trajectory, 0.0, loaded.origin);
    if placement.is_wrong {
        bail!("{name}: {}", placement.doubts.join("; "));
    }
    loaded.warnings.extend(placement.doubts.iter().map(|doubt| format!("{name}: {doubt}")));
    let corners_m = corners_m.into_iter().map(|corner_m| loaded.origin.world(corner_m)).collect();
    Ok((trajectory, WalkSource { name, corners_m, origin: loaded.origin }))
}
