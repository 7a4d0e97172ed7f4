//! `outrigger odometry`: where the rig went, from its own recording.

mod document;
mod map;
mod walk;

use std::path::PathBuf;

use anyhow::Context as _;

use super::odometry_args::OdometryArgs;
use super::recorded_args::RecordedArgs;
use super::scene_args::MeshArgs;
use super::scene_file::{self, MapArgs};
use super::{Context, Outcome, output};
use crate::base::files::write_whole;
use crate::verify::align::Hint;
use crate::verify::walk::Placed;
use document::{Document, report};
use map::{map_of, write_map};
use walk::{in_scene, kitti, walked};

/// Arguments of `odometry`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "The world is the body at the first return, or with --scene the scene: the walk is placed in it and laid against \
                  it piece by piece, which corrects the drift of the odometry. A recording of several sensors needs their mounts; with one \
                  sensor and no mount, the body is the sensor. Sweeps of one revolution are laid against a map of those \
                  before (iterated closest points, each return at its own time). Where the surfaces leave a direction \
                  open, as a straight corridor does, the last velocity holds along it, with a note: such a trajectory is \
                  no measurement there.\n\
                  Exit codes: 0 done, 1 failed, 3 done, but data was lost."
)]
pub struct Args {
    #[command(flatten)]
    recorded: RecordedArgs,
    #[command(flatten)]
    settings: OdometryArgs,
    /// The scene to place the trajectory in: a mesh, a point cloud, or another session.
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    scene_map: MapArgs,
    /// Where the walk begins in the scene, about, where several places fit: m and degrees.
    #[arg(long, value_name = "X,Y[,YAW]", requires = "scene", allow_hyphen_values = true)]
    align_near: Option<Hint>,
    /// Write the trajectory in TUM format: poses at the middle of every revolution and at both ends, on the recording's clock.
    #[arg(short, long, value_name = "FILE.tum")]
    out: Option<PathBuf>,
    /// Write the map: the returns of all sensors in the frame of the trajectory, each at its own time (.laz, .las, .e57, .ply,
    /// .csv, .npy or .pcd; a file that exists is replaced).
    #[arg(long, value_name = "FILE.laz")]
    map: Option<PathBuf>,
    /// One point of the map per voxel of this edge: the first that was measured.
    #[arg(long, value_name = "M", requires = "map", value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    voxel: Option<f64>,
    /// Write the pose in the middle of every revolution of the first sensor, in KITTI format.
    #[arg(long, value_name = "FILE")]
    kitti: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    args.settings.spec().check()?;
    args.recorded.check_places([&args.out, &args.kitti, &args.map])?;
    let map = args.map.as_deref().map(|path| map_of(args, path)).transpose()?;
    if args.scene.is_none() {
        scene_file::ensure_none_typed(context, "--scene names none")?;
    }
    let (result, mut problems) = walked(args, context)?;
    let placed = args
        .scene
        .as_ref()
        .map(|scene| in_scene(args, scene, &result, &mut problems, context))
        .transpose()?;
    let (alignment, trajectory) = match placed {
        None => (None, Some(result.walked.trajectory.clone())),
        Some(Placed { alignment, trajectory, .. }) => (Some(alignment), trajectory),
    };
    let is_placed = trajectory.is_some();
    let mut files = Vec::new();
    let trajectory = &trajectory.unwrap_or_else(|| result.walked.trajectory.clone());
    let mut write = |path: &PathBuf, text: String| {
        files.push(path.display().to_string());
        write_whole(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    };
    if let Some(path) = args.out.as_ref().filter(|_| is_placed) {
        write(path, trajectory.to_tum())?;
    }
    if let Some(path) = args.kitti.as_ref().filter(|_| is_placed) {
        write(path, kitti(&result.revolutions_ns, trajectory, &mut problems)?)?;
    }
    if let Some((path, format)) = map.filter(|_| is_placed) {
        let (points, losses) = write_map(args, context, trajectory, path, format)?;
        files.push(format!("{} ({points} points)", path.display()));
        problems.extend(losses);
    }
    let [first_ns, last_ns] = trajectory.time_span_ns();
    let document = Document {
        format: "outrigger-odometry/1",
        sensors: result.sensors,
        sweeps: result.walked.steps.len(),
        duration_s: (last_ns - first_ns) as f64 * 1e-9,
        length_m: trajectory.length_m(),
        voxel_m: result.walked.voxel_m,
        degenerate_sweeps: result.walked.steps.iter().filter(|step| step.is_degenerate()).count(),
        registration: result.walked.quality,
        steps: result.walked.steps,
        alignment,
        problems,
        files,
        wall_s: start.elapsed().as_secs_f64(),
    };
    output::print_result(context.json, &document, &report(&document), &document.problems)?;
    Ok(if result.losses.is_empty() && is_placed { Outcome::Done } else { Outcome::DataLost })
}
