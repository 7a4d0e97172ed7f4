//! `outrigger odometry`: where the rig went, from its own recording.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use serde::Serialize;

use super::recorded::{Recorded, RecordedArgs};
use super::recorded_odometry::{OdometryArgs, OdometryResult, of_one, of_rig, remarks};
use super::recording::Recording;
use super::registered::mounts::Mounts;
use super::registered::{MountedFrame, each_frame};
use super::scene_args::MeshArgs;
use super::scene_file::{self, MapArgs};
use super::scene_placement::{self, Near, Placed, Walk};
use super::{Context, Outcome, output, sensor_ids};
use crate::base::files::write_whole;
use crate::base::geometry::Pose;
use crate::design::registration::RegistrationQuality;
use crate::recording::export::{Cloud, Export, FileFrame, Format, Source};
use crate::recording::packet_reader::is_stream;
use crate::recording::registered::{PointFilter, Registration, Target, TimeOffset, VoxelThinning};
use crate::verify::align::Alignment;
use crate::verify::odometry::Step;
use crate::world::trajectory::Trajectory;

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
    align_near: Option<Near>,
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

/// The document that `odometry` prints.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    sensors: Vec<String>,
    sweeps: usize,
    duration_s: f64,
    length_m: f64,
    voxel_m: f64,
    registration: Option<RegistrationQuality>,
    /// Sweeps along which a direction was a guess.
    #[serde(rename = "loose_sweeps")]
    degenerate_sweeps: usize,
    steps: Vec<Step>,
    /// Where the walk lies in the scene; null without one.
    alignment: Option<Alignment>,
    /// What is odd or was lost.
    problems: Vec<String>,
    files: Vec<String>,
    wall_s: f64,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    args.settings.check()?;
    args.recorded.check_places([&args.out, &args.kitti, &args.map])?;
    let map = args.map.as_deref().map(|path| map_of(args, path)).transpose()?;
    if args.scene.is_none() {
        scene_file::ensure_none_typed(context, "--scene names none")?;
    }
    let mut notices = Vec::new();
    let result = match Recorded::open_if_mounted(&args.recorded, context)? {
        Some(recorded) => {
            notices.clone_from(&recorded.notices);
            of_rig(&recorded, &args.settings, args.scene.is_some())?
        }
        None => {
            let RecordedArgs { recording, sensors, .. } = &args.recorded;
            of_one(
                &Recording::open(recording, &sensors.of(context, recording))?,
                &args.settings,
                args.scene.is_some(),
            )?
        }
    };
    let mut problems = notices;
    problems.extend(result.notices.iter().cloned());
    problems.extend(remarks(&result));
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
        let placed = result.revolutions_ns.iter().filter_map(|at| Some((*at, trajectory.at(*at)?)));
        let begun: Vec<(u64, Pose)> = placed.collect();
        let missing = result.revolutions_ns.len() - begun.len();
        if missing > 0 {
            problems.push(format!("{missing} revolutions have no pose in the KITTI file"));
        }
        write(path, Trajectory::new(begun)?.to_kitti())?;
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
    output::print_result(context.json, &document, || text(&document), &document.problems)?;
    Ok(if result.losses.is_empty() && is_placed { Outcome::Done } else { Outcome::DataLost })
}

/// Where the map goes, and in which format; refused before the work.
fn map_of<'a>(args: &Args, path: &'a Path) -> anyhow::Result<(&'a Path, Format)> {
    let format = Format::of_path(path).filter(|format| !matches!(format, Format::Mcap | Format::Foxglove));
    let Some(format) = format else {
        refuse!(
            "--map {}: expected a name that ends in .laz, .las, .e57, .ply, .pcd, .csv or .npy",
            path.display()
        );
    };
    if is_stream(&args.recorded.recording) {
        refuse!(
            "--map reads the recording twice, and {} can be read but once: save it as a file first",
            args.recorded.recording.display()
        );
    }
    Ok((path, format))
}

/// Reads the recording again and puts its returns where the trajectory says; how many, and what was lost.
fn write_map(
    args: &Args,
    context: Context,
    trajectory: &Trajectory,
    path: &Path,
    format: Format,
) -> anyhow::Result<(u64, Option<String>)> {
    let RecordedArgs { recording, sensors, mount, zeros } = &args.recorded;
    let recording = Recording::open(recording, &sensors.of(context, recording))?;
    let mut mounts = Mounts::of(&recording, mount.as_deref(), zeros)?;
    let filter = PointFilter { voxels: args.voxel.map(VoxelThinning::new), ..PointFilter::default() };
    let target = Target::World { trajectory: trajectory.clone(), offset: TimeOffset::Fixed(0) };
    let mut registration = Registration::new(target, filter);
    let frame = FileFrame { name: registration.frame_name(), origin: registration.origin(), wkt: None };
    let mut export = Export::create_in(&frame, path, format, true)?;
    let (mut ids, mut clouds) = (Vec::new(), BTreeMap::new());
    each_frame(&recording, &mut mounts, &mut |mounted| {
        let MountedFrame { at, sensor, model, body_from_sensor, frame, .. } = mounted;
        let cloud = clouds.entry(at).or_insert_with(|| {
            Cloud::new(Arc::new(Source::of(sensor, sensor_ids::next_id(sensor, &mut ids), at)), model)
        });
        cloud.fill(model, frame);
        registration.apply(at, cloud, body_from_sensor);
        Ok(export.add(cloud)?)
    })?;
    Ok((export.finish()?.points, registration.losses()))
}

/// The trajectory in a scene's frame. Where no place is sure, that is a problem, and nothing is written.
fn in_scene(
    args: &Args,
    scene: &std::path::Path,
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
    let mut placed = scene_placement::in_scene(&walk, &read.scene, read.origin, args.align_near)?;
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

fn text(document: &Document) -> String {
    let mut text = format!(
        "{} of {} in {:.1} s: {:.3} m travelled, map voxels {:.2} m\n",
        output::counted(document.sweeps as u64, "revolution"),
        document.sensors.join(", "),
        document.duration_s,
        document.length_m,
        document.voxel_m
    );
    if let Some(quality) = &document.registration {
        text.push_str(&quality.line());
    }
    for file in &document.files {
        let _ = writeln!(text, "{file}");
    }
    text
}
