//! The scene and the way through it: from files, or from the recording itself.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context as _, ensure};

use super::Recorded;
use crate::base::geometry::Pose;
use crate::commands::Context;
use crate::commands::recorded_odometry::{self as odometry, OdometryArgs};
use crate::commands::scene_args::{MeshArgs, Room, read_trajectory};
use crate::commands::scene_file::{self, Making, MapArgs};
use crate::verify::compare::{Field, TimeOffset, time_offset};
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::{LoadedScene, Scene, VoxelMap};
use crate::world::trajectory::{Trajectory, suspicions};

/// Rays among which the time offset is looked for, and how far to each side.
const SEARCH_RAYS: usize = 20_000;
const SEARCH_NS: i64 = 2_000_000_000;

/// Where the recording was made.
#[derive(clap::Args, Debug)]
pub struct PlaceArgs {
    /// Surface (.ply, .obj, .stl, .off, .gltf or .glb), or what a map is made of: another session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las, .laz, .e57 or text).
    #[arg(long, group = "place", value_name = "PATH")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its least and greatest corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Room>,
    /// A map instead, made of these frames of the recording (A..B, from 0, B not included); the others are compared.
    #[arg(long, group = "place", value_name = "A..B")]
    map_frames: Option<Frames>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Way of the body: TUM, EuRoC or another table whose header names its columns, KITTI poses with --rate, `still` for a rig that does not move, or `odometry` (with
    /// --map-frames) for the way that the recording itself tells; without it the session's own.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Poses per second of a trajectory in KITTI format; the first pose is that of the first column.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    rate: Option<f64>,
    /// Added to the recording's times to get those of the trajectory, s; `start` lets both begin together, `search` looks
    /// for the one at which the rays end where the scene is: up to 2 s from 0, or, where the two have no time in common, up
    /// to 2 s from the one at which both begin together, however large that is.
    #[arg(long, value_name = "S", allow_hyphen_values = true, default_value = "0")]
    time_offset: Offset,
    #[command(flatten)]
    odometry: OdometryArgs,
}

/// Frames that make a map.
#[derive(Clone, Debug)]
struct Frames(std::ops::Range<u64>);

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ends = text.split_once("..").and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        match ends {
            Some((from, to)) if from < to => Ok(Self(from..to)),
            _ => Err(format!("{text:?}: expected two numbers of frames that ascend, like 0..2")),
        }
    }
}

/// How the clocks stand to each other.
#[derive(Clone, Copy, Debug)]
enum Offset {
    Seconds(f64),
    Start,
    Search,
}

impl FromStr for Offset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "start" => return Ok(Self::Start),
            "search" => return Ok(Self::Search),
            _ => {}
        }
        let seconds = text.parse().ok().filter(|value: &f64| value.is_finite() && value.abs() < 9e9);
        seconds.map(Self::Seconds).ok_or_else(|| format!("{text:?}: expected seconds, start or search"))
    }
}

/// A scene, a way, and what is odd about them.
pub struct Place {
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
    pub notices: Vec<String>,
}

/// Refuses, before anything is read, what was asked for and does not fit together.
pub(crate) fn check(args: &PlaceArgs, context: Context) -> anyhow::Result<()> {
    let way = args.trajectory.as_ref().and_then(|path| path.to_str());
    if way == Some("odometry") {
        if args.map_frames.is_none() {
            refuse!(
                "--trajectory odometry begins a world of its own, which lies nowhere in a scene: it needs --map-frames"
            );
        }
    } else {
        OdometryArgs::ensure_not_typed(context)?;
    }
    if matches!(way, None | Some("still" | "odometry")) {
        context.ensure_not_typed(
            &["rate"],
            "is about a file of poses in KITTI format: --trajectory names none",
        )?;
    }
    if args.map_frames.is_some() {
        scene_file::ensure_of_frames(context)?;
        if matches!(args.time_offset, Offset::Search) {
            refuse!("--time-offset search needs a scene: a map of the recording itself fits at any");
        }
    }
    match &args.room {
        Some(_) => scene_file::ensure_none_typed(context, "the scene is a room"),
        None => Ok(()),
    }
}

/// Reads everything.
pub(crate) fn read(args: &PlaceArgs, recorded: &Recorded, context: Context) -> anyhow::Result<Place> {
    let mut notices = Vec::new();
    let trajectory = trajectory(args, recorded, &mut notices)?;
    let from_start = || -> anyhow::Result<i64> {
        let first_ns = recorded.span_ns()?.context("no frame to take the start from")?[0];
        Ok(trajectory.time_span_ns()[0] as i64 - first_ns as i64)
    };
    let mut time_offset_ns = match args.time_offset {
        Offset::Seconds(seconds) => (seconds * 1e9).round() as i64,
        Offset::Start => from_start()?,
        // clocks that have nothing in common are taken to have begun together
        Offset::Search if overlap(recorded.span_ns()?, trajectory.time_span_ns()) => 0,
        Offset::Search => from_start()?,
    };
    // a rig that stands has no poses to miss
    if args.trajectory.as_ref().is_none_or(|path| path.as_os_str() != "still") {
        notices.extend(suspicions(&trajectory, "trajectory"));
    }
    let mapped = args.map_frames.as_ref().map_or(0..0, |frames| frames.0.clone());
    let loaded = match (&args.scene, &args.room) {
        (Some(path), _) => Some(scene_file::read(path, &args.mesh, &args.map, context)?),
        (None, Some(room)) => Some(LoadedScene::of_room(&room.scene())),
        (None, None) => None,
    };
    let origin =
        loaded.as_ref().map_or_else(|| LocalOrigin::of_box(trajectory.bounds_m()), |loaded| loaded.origin);
    let trajectory = origin.local_trajectory(trajectory);
    let scene = match loaded {
        Some(loaded) => {
            notices.extend(loaded.warnings);
            loaded.scene
        }
        None => Scene::Voxels(Arc::new(map(args, recorded, &trajectory, time_offset_ns, &mapped)?)),
    };
    let mut found = None;
    if matches!(args.time_offset, Offset::Search) {
        let told = search(recorded, &scene, &trajectory, time_offset_ns)?;
        notices.push(format!("time offset found: {:.4} s +- {:.4} s (95 %)", told.seconds, told.u95_s));
        time_offset_ns = (told.seconds * 1e9).round() as i64;
        found = Some(told);
    }
    let mut placement = Placement::default();
    if mapped.is_empty() {
        placement = Placement::new(&scene, &trajectory, recorded.rig.mean_height_m(), origin);
        notices.append(&mut placement.doubts);
    }
    let is_misplaced = placement.is_wrong;
    Ok(Place { scene, trajectory, origin, is_misplaced, time_offset_ns, time_offset: found, mapped, notices })
}

/// Looks for the time offset with an even share of the recorded rays.
fn search(
    recorded: &Recorded,
    scene: &Scene,
    trajectory: &Trajectory,
    around_ns: i64,
) -> anyhow::Result<TimeOffset> {
    let kept = recorded.rays(SEARCH_RAYS)?;
    let field = Field { scene, trajectory, sensors: &kept.sensors, rays: &kept.rays, agree_within_m: 0.1 };
    time_offset(&field, around_ns, SEARCH_NS).with_context(|| {
        format!(
            "--time-offset search looked {} s to each side of {:.2} s; for clocks farther apart it takes seconds, or start",
            SEARCH_NS as f64 * 1e-9,
            around_ns as f64 * 1e-9
        )
    })
}

fn overlap(recorded: Option<[u64; 2]>, walked: [u64; 2]) -> bool {
    recorded.is_some_and(|[first_ns, last_ns]| first_ns <= walked[1] && walked[0] <= last_ns)
}

fn trajectory(
    args: &PlaceArgs,
    recorded: &Recorded,
    notices: &mut Vec<String>,
) -> anyhow::Result<Trajectory> {
    let Some(path) = &args.trajectory else {
        let own = recorded.own_trajectory()?;
        return own.with_context(|| format!("give --trajectory: {} holds none", recorded.what()));
    };
    let name = path.display().to_string();
    if name == "still" {
        return recorded.still();
    }
    if name == "odometry" {
        let way = odometry::of_rig(recorded, &args.odometry)?;
        notices.extend(odometry::remarks(&way));
        return Ok(way.walked.trajectory);
    }
    let (poses, notes) = read_trajectory(path, args.rate)?;
    notices.extend(notes);
    if args.rate.is_none() {
        return Ok(poses);
    }
    let first_ns = recorded.span_ns()?.context("the recording holds no frame")?[0];
    let stamped: Vec<(u64, Pose)> =
        poses.stamped().map(|(time_ns, pose)| (time_ns + first_ns, pose)).collect();
    going_on(stamped)
}

/// Poses of revolutions say where each began: during the last one the body goes on as before.
fn going_on(mut stamped: Vec<(u64, Pose)>) -> anyhow::Result<Trajectory> {
    if let [.., (before_ns, before), (last_ns, last)] = stamped[..] {
        stamped.push((2 * last_ns - before_ns, last * (before.inverse() * last)));
    }
    Ok(Trajectory::new(stamped)?)
}

fn map(
    args: &PlaceArgs,
    recorded: &Recorded,
    trajectory: &Trajectory,
    time_offset_ns: i64,
    frames: &std::ops::Range<u64>,
) -> anyhow::Result<VoxelMap> {
    let mut making = Making::new(&args.map)?;
    recorded.feed(&mut |taken| {
        if frames.contains(&taken.number) {
            making.add_frame(&recorded.rig, trajectory, time_offset_ns, &taken);
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
