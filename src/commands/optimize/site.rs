//! The scenes and the trajectories of a search.

use std::path::Path;

use anyhow::{Context as _, bail};

use super::args::Args;
use crate::commands::scene_args::Operator;
use crate::commands::{Context, ensure_consistent, scene_file, wrong_usage};
use crate::recording::walk_text::WalkText;
use crate::report::scene_search::SiteSource;
use crate::simulate::prediction::grid_of;
use crate::simulate::view::{Shades, ViewSite};
use crate::simulate::walk::Walk;
use crate::world::placement::Placement;
use crate::world::scene::{LoadedScene, Scene};
use crate::world::trajectory::Trajectory;

/// Edge of a voxel where none is given, m.
const DEFAULT_VOXEL_M: f64 = 0.1;

/// Where is searched, and what is odd about it.
pub(super) fn sites(args: &Args, context: Context) -> anyhow::Result<(Vec<Found>, Vec<String>)> {
    let of = &args.scene;
    let mut places: Vec<Place<'_>> =
        of.site.iter().map(|site| (Some(site.scene.as_path()), site.trajectory.as_ref())).collect();
    if places.is_empty() {
        places.push((of.scene.as_deref(), of.trajectory.as_ref()));
    }
    if !places.iter().any(|(_, walk)| matches!(walk, Some(WalkText::File(_)))) {
        context.ensure_not_typed(&["rate"], "is about a trajectory in KITTI format, which is not given")?;
    }
    if places.len() > 1 {
        let why = "writes one trajectory, and there are several --site: give one of them by --scene and --trajectory";
        context.ensure_not_typed(&["trajectory_out"], why)?;
    }
    let is_registration_asked = args.experiment.registration()? != (0.0, 0.0);
    let words =
        "--registration-weight and --min-conditioning are about one scene, and there are several --site";
    ensure_consistent([(is_registration_asked && places.len() > 1, words.into())])?;
    let mut warnings = Vec::new();
    let mut sites = Vec::new();
    for place in places {
        let (site, more, source) = site(args, context, place)?;
        warnings.extend(more);
        sites.push((site, source));
    }
    Ok((sites, warnings))
}

/// Where is searched, and where that comes from.
type Found = (ViewSite, SiteSource);

/// A scene, unless it is the room, and a trajectory.
type Place<'a> = (Option<&'a Path>, Option<&'a WalkText>);

fn site(
    args: &Args,
    context: Context,
    (scene, walk): Place<'_>,
) -> anyhow::Result<(ViewSite, Vec<String>, SiteSource)> {
    let scene_args = &args.scene;
    let loaded =
        scene_file::read_or_room(scene, scene_args.room, &scene_args.mesh, &scene_args.map, context)?;
    let mut loaded = loaded.context("give --scene or --room")?;
    scene_args.quality.ensure_known_in(&loaded.scene)?;
    let is_map = matches!(loaded.scene, Scene::Voxels(_));
    let is_registration_asked = args.experiment.registration()? != (0.0, 0.0);
    let words = "--registration-weight and --min-conditioning are about surface normals, which a map of voxels does not have: give \
                 a mesh behind --scene";
    ensure_consistent([(is_registration_asked && is_map, words.into())])?;
    let (trajectory, source) = walk_of(args, (scene, walk), &mut loaded)?;
    let voxel_m = args.experiment.of_scene().voxel_m.unwrap_or(DEFAULT_VOXEL_M);
    let grid = grid_of(&loaded.scene, voxel_m).map_err(wrong_usage)?;
    let operator = scene_args.operator.map(|Operator(capsule)| capsule);
    let shades = Shades { has_housings: !scene_args.ideal, operator };
    Ok((ViewSite { scene: loaded.scene, trajectory, grid, shades }, loaded.warnings, source))
}

fn walk_of(
    args: &Args,
    (path, source): Place<'_>,
    loaded: &mut LoadedScene,
) -> anyhow::Result<(Trajectory, SiteSource)> {
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
    let place = path.map_or("room".into(), |path| path.display().to_string());
    Ok((trajectory, SiteSource { scene: place, name, corners_m, origin: loaded.origin }))
}
