//! Where a recording was made: the scene and the trajectory through it, from files or from the recording itself.

mod args;
mod clocks;
mod found;

use std::sync::Arc;

use anyhow::ensure;

use crate::commands::Context;
use crate::commands::recorded::Recorded;
use crate::commands::scene_file::{self, Making};
use crate::verify::align::Alignment;
use crate::verify::compare::TimeOffset;
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::{LoadedScene, Scene, VoxelMap};
use crate::world::trajectory::{Trajectory, suspicions};
use args::Offset;
pub(super) use args::{PlaceArgs, check};
use clocks::time_offset_ns;
use found::{Found, find_trajectory, placed};

/// A scene, a trajectory, and what is odd about them.
pub(super) struct Place {
    pub scene: Scene,
    pub trajectory: Trajectory,
    /// Where the frame of both begins in that of the files.
    pub origin: LocalOrigin,
    /// Whether most of the trajectory lies outside the scene or below its floor.
    pub is_misplaced: bool,
    pub time_offset_ns: i64,
    /// Where it was looked for.
    pub time_offset: Option<TimeOffset>,
    /// Frames that made the map.
    pub mapped: std::ops::Range<u64>,
    /// Where the trajectory lies in the scene, where that was looked for. One that is not placed is in its own frame still.
    pub alignment: Option<Alignment>,
    /// The trajectory was found from the recording.
    pub is_odometry: bool,
    pub notices: Vec<String>,
}

/// Reads everything.
pub(super) fn read(args: &PlaceArgs, recorded: &Recorded, context: Context) -> anyhow::Result<Place> {
    let mut notices = Vec::new();
    let found = find_trajectory(args, recorded, &mut notices)?;
    let is_odometry = matches!(found, Found::Odometry(_));
    let trajectory = found.trajectory();
    let time_offset_ns = time_offset_ns(args.time_offset, recorded, trajectory)?;
    // a rig that stands has no poses to miss
    if args.trajectory.as_ref().is_none_or(|path| path.as_os_str() != "still") {
        notices.extend(suspicions(trajectory, "trajectory"));
    }
    let mapped = args.map_frames.as_ref().map_or(0..0, |frames| frames.0.clone());
    let loaded = loaded(args, context)?;
    let origin =
        loaded.as_ref().map_or_else(|| LocalOrigin::of_box(trajectory.bounds_m()), |loaded| loaded.origin);
    let is_sought = mapped.is_empty() && (args.align || is_odometry);
    // one that is to be placed lies in a frame of its own
    let trajectory = match is_sought {
        true => trajectory.clone(),
        false => origin.local_trajectory(trajectory.clone()),
    };
    let scene = match loaded {
        Some(loaded) => {
            notices.extend(loaded.warnings);
            loaded.scene
        }
        None => Scene::Voxels(Arc::new(map(args, recorded, &trajectory, time_offset_ns, &mapped)?)),
    };
    if args.align_near.is_some() && !is_sought {
        refuse!("--align-near is about --align: {} holds its own trajectory", recorded.what());
    }
    let mut place = Place {
        scene,
        trajectory,
        origin,
        is_misplaced: false,
        time_offset_ns,
        time_offset: None,
        mapped,
        alignment: None,
        is_odometry,
        notices,
    };
    if is_sought {
        let placed = placed(args, recorded, &found, (&place.scene, origin), time_offset_ns)?;
        place.notices.extend(placed.notices);
        place.alignment = Some(placed.alignment);
        let Some(trajectory) = placed.trajectory else { return Ok(place) };
        place.trajectory = trajectory;
    }
    if matches!(args.time_offset, Offset::Search) {
        place.search_time_offset(recorded)?;
    }
    if place.mapped.is_empty() {
        let height_m = recorded.rig.mean_height_m();
        let placement = Placement::new(&place.scene, &place.trajectory, height_m, origin);
        place.notices.extend(placement.doubts);
        place.is_misplaced = placement.is_wrong;
    }
    Ok(place)
}

/// The scene, where it is no map of the recording itself.
fn loaded(args: &PlaceArgs, context: Context) -> anyhow::Result<Option<LoadedScene>> {
    Ok(match (&args.scene, &args.room) {
        (Some(path), _) => Some(scene_file::read(path, &args.mesh, &args.map, context)?),
        (None, Some(room)) => Some(LoadedScene::of_room(&room.scene())),
        (None, None) => None,
    })
}

/// Makes a map of some frames.
fn map(
    args: &PlaceArgs,
    recorded: &Recorded,
    trajectory: &Trajectory,
    time_offset_ns: i64,
    frames: &std::ops::Range<u64>,
) -> anyhow::Result<VoxelMap> {
    let mut making = Making::new(&args.map)?;
    recorded.feed(&mut |mounted_frame| {
        if frames.contains(&mounted_frame.number) {
            making.add_frame(&recorded.rig, trajectory, time_offset_ns, &mounted_frame);
        }
    })?;
    let map = making.into_map();
    ensure!(
        map.counts()[1] > 0,
        "--map-frames {}..{}: no return of these frames lies within the trajectory's time",
        frames.start,
        frames.end
    );
    Ok(map)
}
