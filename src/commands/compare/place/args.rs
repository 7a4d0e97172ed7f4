//! The flags that name the scene and the trajectory.

use std::path::PathBuf;
use std::str::FromStr;

use crate::commands::Context;
use crate::commands::recorded_odometry::OdometryArgs;
use crate::commands::scene_args::{MeshArgs, Room};
use crate::commands::scene_file::{self, MapArgs};
use crate::commands::scene_placement::Near;

/// Where the recording was made.
#[derive(clap::Args, Debug)]
pub struct PlaceArgs {
    /// Surface (.ply, .obj, .stl, .off, .gltf or .glb), or what a map is made of: another session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las, .laz, .e57 or text).
    #[arg(long, group = "place", value_name = "PATH")]
    pub(super) scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its minimum and maximum corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    pub(super) room: Option<Room>,
    /// A map instead, made of these frames of the recording (A..B, from 0, B not included); the others are compared.
    #[arg(long, group = "place", value_name = "A..B")]
    pub(super) map_frames: Option<Frames>,
    #[command(flatten)]
    pub(super) mesh: MeshArgs,
    #[command(flatten)]
    pub(super) map: MapArgs,
    /// Trajectory of the body: TUM, EuRoC or another table with named columns, KITTI poses with --rate, `still` for a rig
    /// that does not move, or `odometry` for the one of the recording itself, which is placed in the scene; without it the
    /// session's own, and odometry where there is none.
    #[arg(long, value_name = "FILE")]
    pub(super) trajectory: Option<PathBuf>,
    /// The trajectory begins in a frame of its own (SLAM, odometry): find where it lies in the scene.
    #[arg(long)]
    pub(super) align: bool,
    /// Where the walk begins in the scene, about, where several places fit: m and degrees.
    #[arg(long, value_name = "X,Y[,YAW]", allow_hyphen_values = true)]
    pub(super) align_near: Option<Near>,
    /// Poses per second of a trajectory in KITTI format; each pose is that of the middle of its revolution.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    pub(super) rate: Option<f64>,
    /// Added to the recording's times to get those of the trajectory, s; `start` lets both begin together, `search` looks
    /// for the one at which the rays end where the scene is: up to 2 s from 0, or, where the two have no time in common, up
    /// to 2 s from the one at which both begin together, however large that is.
    #[arg(long, value_name = "S", allow_hyphen_values = true, default_value = "0")]
    pub(super) time_offset: Offset,
    #[command(flatten)]
    pub(super) odometry: OdometryArgs,
}

/// Frames that make a map.
#[derive(Clone, Debug)]
pub(super) struct Frames(pub(super) std::ops::Range<u64>);

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
pub(super) enum Offset {
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
