//! The flags that name the scene and the trajectory.

use std::path::{Path, PathBuf};

use crate::commands::odometry_args::OdometryArgs;
use crate::commands::scene_args::{MeshArgs, Room};
use crate::commands::scene_file::{self, MapArgs};
use crate::commands::{Context, ensure_consistent, output, stage};
use crate::recording::{TrajectorySource, read_trajectory};
use crate::rig::Rig;
use crate::verify::align::Hint;
use crate::verify::compare::cover_planned;
use crate::verify::walk::{Frames, Offset, WalkSite, WalkSiteSpec};
use crate::world::coverage::{Coverage, VoxelGrid};

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
    trajectory: Option<TrajectorySource>,
    /// The trajectory begins in a frame of its own (SLAM, odometry): find where it lies in the scene.
    #[arg(long)]
    align: bool,
    /// Where the walk begins in the scene, about, where several places fit: m and degrees.
    #[arg(long, value_name = "X,Y[,YAW]", allow_hyphen_values = true)]
    align_near: Option<Hint>,
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

impl PlaceArgs {
    /// What is given, the scene read.
    pub(super) fn spec(&self, context: Context) -> anyhow::Result<WalkSiteSpec> {
        let scene = self.scene.as_deref();
        Ok(WalkSiteSpec {
            scene: scene_file::read_or_room(scene, self.room, &self.mesh, &self.map, context)?,
            map_of: self.map_frames.clone().map(|frames| (frames.0, self.map.spec())),
            trajectory: self.trajectory.clone(),
            rate_hz: self.rate,
            odometry: self.odometry.spec(),
            is_aligned: self.align,
            near: self.align_near,
            time_offset: self.time_offset,
            observer: stage::observer(),
        })
    }
}

/// Refuses, before anything is read, what was asked for and does not fit together.
pub(super) fn check(args: &PlaceArgs, context: Context) -> anyhow::Result<()> {
    let source = args.trajectory.as_ref();
    if !matches!(source, None | Some(TrajectorySource::Odometry)) {
        OdometryArgs::ensure_not_typed(context)?;
        if !args.align {
            context.ensure_not_typed(&["align_near"], "is about --align, which is not asked for")?;
        }
    }
    let is_searched = matches!(args.time_offset, Offset::Search);
    let words = "--time-offset search needs a trajectory in the scene's frame, and --align one on the recording's clock: give \
                 seconds, or start";
    ensure_consistent([(args.align && is_searched, words.into())])?;
    if !matches!(source, Some(TrajectorySource::File(_))) {
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
        let words = "--time-offset search needs a scene: a map of the recording itself fits at any";
        ensure_consistent([(is_searched, words.into())])?;
    }
    match &args.room {
        Some(_) => scene_file::ensure_none_typed(context, "the scene is a room"),
        None => Ok(()),
    }
}

/// What the nominal mounts cover on the planned trajectory of a file (TUM), where one is given.
pub(super) fn planned(
    path: Option<&Path>,
    site: &WalkSite,
    rig: &Rig,
    grid: &VoxelGrid,
) -> anyhow::Result<Option<Coverage>> {
    let Some(path) = path else { return Ok(None) };
    let (trajectory, notes) = read_trajectory(path, None)?;
    notes.iter().for_each(|note| output::say_notice(note));
    let trajectory = site.origin.local_trajectory(trajectory);
    Ok(Some(cover_planned(&site.scene, &trajectory, rig, grid)))
}
