//! The scene and the trajectory through it: from files, or from the recording itself.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context as _, bail, ensure};

use super::Recorded;
use crate::base::geometry::Pose;
use crate::commands::Context;
use crate::commands::recorded_odometry::{self as odometry, OdometryArgs, OdometryResult};
use crate::commands::scene_args::{MeshArgs, Room, read_trajectory};
use crate::commands::scene_file::{self, Making, MapArgs};
use crate::commands::scene_placement::{self, Near, Placed, Walk};
use crate::verify::align::Alignment;
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
    /// A closed room instead: "x,y,z,x,y,z" of its minimum and maximum corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Room>,
    /// A map instead, made of these frames of the recording (A..B, from 0, B not included); the others are compared.
    #[arg(long, group = "place", value_name = "A..B")]
    map_frames: Option<Frames>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Trajectory of the body: TUM, EuRoC or another table with named columns, KITTI poses with --rate, `still` for a rig
    /// that does not move, or `odometry` for the one of the recording itself, which is placed in the scene; without it the
    /// session's own, and odometry where there is none.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// The trajectory begins in a frame of its own (SLAM, odometry): find where it lies in the scene.
    #[arg(long)]
    align: bool,
    /// Where the walk begins in the scene, about, where several places fit: m and degrees.
    #[arg(long, value_name = "X,Y[,YAW]", allow_hyphen_values = true)]
    align_near: Option<Near>,
    /// Poses per second of a trajectory in KITTI format; each pose is that of the middle of its revolution.
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

/// A scene, a trajectory, and what is odd about them.
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
    /// Where the trajectory lies in the scene, where that was looked for. One that is not placed is in its own frame still.
    pub alignment: Option<Alignment>,
    /// The trajectory was found from the recording.
    pub is_odometry: bool,
    pub notices: Vec<String>,
}

/// Refuses, before anything is read, what was asked for and does not fit together.
pub(crate) fn check(args: &PlaceArgs, context: Context) -> anyhow::Result<()> {
    let source = args.trajectory.as_ref().and_then(|path| path.to_str());
    if !matches!(source, None | Some("odometry")) {
        OdometryArgs::ensure_not_typed(context)?;
        if !args.align {
            context.ensure_not_typed(&["align_near"], "is about --align, which is not asked for")?;
        }
    }
    if args.align && matches!(args.time_offset, Offset::Search) {
        refuse!(
            "--time-offset search needs a trajectory in the scene's frame, and --align one on the recording's clock: give \
             seconds, or start"
        );
    }
    if matches!(source, None | Some("still" | "odometry")) {
        context.ensure_not_typed(
            &["rate"],
            "is about a file of poses in KITTI format: --trajectory names none",
        )?;
    }
    if args.map_frames.is_some() {
        scene_file::ensure_of_frames(context)?;
        context.ensure_not_typed(
            &["align", "align_near"],
            "is about a scene, and the map of --map-frames lies in the trajectory's own frame",
        )?;
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
    let found = trajectory(args, recorded, &mut notices)?;
    let is_odometry = matches!(found, Found::Odometry(_));
    let trajectory = found.trajectory();
    let from_start = || -> anyhow::Result<i64> {
        let first_ns = recorded.span_ns()?.context("no frame to take the start from")?[0];
        Ok(trajectory.time_span_ns()[0] as i64 - first_ns as i64)
    };
    let mut time_offset_ns = match args.time_offset {
        Offset::Seconds(seconds) => (seconds * 1e9).round() as i64,
        Offset::Start => from_start()?,
        // clocks that have nothing in common are assumed to have begun together
        Offset::Search if overlap(recorded.span_ns()?, trajectory.time_span_ns()) => 0,
        Offset::Search => from_start()?,
    };
    // a rig that stands has no poses to miss
    if args.trajectory.as_ref().is_none_or(|path| path.as_os_str() != "still") {
        notices.extend(suspicions(trajectory, "trajectory"));
    }
    let mapped = args.map_frames.as_ref().map_or(0..0, |frames| frames.0.clone());
    let loaded = match (&args.scene, &args.room) {
        (Some(path), _) => Some(scene_file::read(path, &args.mesh, &args.map, context)?),
        (None, Some(room)) => Some(LoadedScene::of_room(&room.scene())),
        (None, None) => None,
    };
    let origin =
        loaded.as_ref().map_or_else(|| LocalOrigin::of_box(trajectory.bounds_m()), |loaded| loaded.origin);
    let is_sought = mapped.is_empty() && (args.align || is_odometry);
    // one that is to be placed lies in a frame of its own
    let mut trajectory = match is_sought {
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
    let mut alignment = None;
    if args.align_near.is_some() && !is_sought {
        refuse!("--align-near is about --align: {} holds its own trajectory", recorded.what());
    }
    if is_sought {
        let placed = placed(args, recorded, &found, (&scene, origin), time_offset_ns)?;
        notices.extend(placed.notices);
        alignment = Some(placed.alignment);
        match placed.trajectory {
            Some(placed) => trajectory = placed,
            None => {
                return Ok(Place {
                    scene,
                    trajectory,
                    origin,
                    is_misplaced: false,
                    time_offset_ns,
                    time_offset: None,
                    mapped,
                    alignment,
                    is_odometry,
                    notices,
                });
            }
        }
    }
    let mut found = None;
    if matches!(args.time_offset, Offset::Search) {
        let found_offset = search(recorded, &scene, &trajectory, time_offset_ns)?;
        notices.push(format!(
            "time offset found: {:.4} s +- {:.4} s (95 %)",
            found_offset.seconds, found_offset.u95_s
        ));
        time_offset_ns = (found_offset.seconds * 1e9).round() as i64;
        found = Some(found_offset);
    }
    let mut placement = Placement::default();
    if mapped.is_empty() {
        placement = Placement::new(&scene, &trajectory, recorded.rig.mean_height_m(), origin);
        notices.append(&mut placement.doubts);
    }
    let is_misplaced = placement.is_wrong;
    Ok(Place {
        scene,
        trajectory,
        origin,
        is_misplaced,
        time_offset_ns,
        time_offset: found,
        mapped,
        alignment,
        is_odometry,
        notices,
    })
}

/// A trajectory, and what odometry read of the recording.
enum Found {
    Elsewhere(Trajectory),
    Odometry(Box<OdometryResult>),
}

impl Found {
    fn trajectory(&self) -> &Trajectory {
        match self {
            Self::Elsewhere(trajectory) => trajectory,
            Self::Odometry(result) => &result.walked.trajectory,
        }
    }
}

/// Where a trajectory of a frame of its own lies in the scene, which begins at `origin`.
fn placed(
    args: &PlaceArgs,
    recorded: &Recorded,
    found: &Found,
    (scene, origin): (&Scene, LocalOrigin),
    time_offset_ns: i64,
) -> anyhow::Result<Placed> {
    let walk = |rays, sensors, drifts| Walk {
        trajectory: found.trajectory(),
        rays,
        sensors,
        time_offset_ns,
        drifts,
    };
    match found {
        Found::Odometry(result) => scene_placement::in_scene(
            &walk(&result.rays[..], &result.mounted[..], true),
            scene,
            origin,
            args.align_near,
        ),
        Found::Elsewhere(_) => {
            let sample = recorded.rays(scene_placement::RAYS)?;
            scene_placement::in_scene(
                &walk(&sample.rays[..], &sample.sensors[..], false),
                scene,
                origin,
                args.align_near,
            )
        }
    }
}

/// Looks for the time offset with an even share of the recorded rays.
fn search(
    recorded: &Recorded,
    scene: &Scene,
    trajectory: &Trajectory,
    around_ns: i64,
) -> anyhow::Result<TimeOffset> {
    let sample = recorded.rays(SEARCH_RAYS)?;
    let field =
        Field { scene, trajectory, sensors: &sample.sensors, rays: &sample.rays, agree_within_m: 0.1 };
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

fn trajectory(args: &PlaceArgs, recorded: &Recorded, notices: &mut Vec<String>) -> anyhow::Result<Found> {
    let by_odometry = |notices: &mut Vec<String>| -> anyhow::Result<Found> {
        let result = odometry::of_rig(recorded, &args.odometry, args.map_frames.is_none())?;
        notices.extend(odometry::remarks(&result));
        Ok(Found::Odometry(Box::new(result)))
    };
    let Some(path) = &args.trajectory else {
        return match recorded.own_trajectory()? {
            Some(own) => Ok(Found::Elsewhere(own)),
            None if args.map_frames.is_some() => {
                bail!("give --trajectory (`odometry` finds one): {} holds none", recorded.what())
            }
            None => {
                notices.push(format!("{} holds no trajectory: odometry finds one", recorded.what()));
                by_odometry(notices)
            }
        };
    };
    let name = path.display().to_string();
    if name == "still" {
        return Ok(Found::Elsewhere(recorded.still()?));
    }
    if name == "odometry" {
        return by_odometry(notices);
    }
    let (poses, notes) = read_trajectory(path, args.rate)?;
    notices.extend(notes);
    if args.rate.is_none() {
        return Ok(Found::Elsewhere(poses));
    }
    let first_ns = recorded.span_ns()?.context("the recording holds no frame")?[0];
    let first_ns = first_ns + (0.5e9 / args.rate.unwrap_or(1.0)).round() as u64; // poses are those of the middles
    let stamped: Vec<(u64, Pose)> =
        poses.stamped().map(|(time_ns, pose)| (time_ns + first_ns, pose)).collect();
    Ok(Found::Elsewhere(Trajectory::of_revolutions(stamped)?))
}

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
