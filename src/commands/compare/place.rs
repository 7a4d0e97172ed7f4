//! The scene and the way through it: from files, or from the recording itself.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context as _, bail, ensure};
use glam::DVec3;

use super::Source;
use crate::commands::ground::MeshArgs;
use crate::commands::scene_file::{self, Making, MapArgs};
use crate::geometry::Pose;
use crate::rig::Rig;
use crate::scene::{BoxScene, Scene, VoxelMap};
use crate::trajectory::{Trajectory, WalkLimits};

/// Where the recording was made.
#[derive(clap::Args, Debug)]
pub struct PlaceArgs {
    /// Surface (.ply, .obj, .stl, .gltf or .glb), or what a map is made of: another session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las or .laz).
    #[arg(long, group = "place", value_name = "PATH")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its least and greatest corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Corners>,
    /// A map instead, made of these frames of the recording (A..B, from 0, B not included); the others are compared.
    #[arg(long, group = "place", value_name = "A..B")]
    map_frames: Option<Frames>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Way of the body: TUM format, KITTI poses with --rate, or `still` for a rig that does not move; without it the
    /// session's own.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Poses per second of a trajectory in KITTI format; the first pose is that of the first column.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Added to the recording's times to get those of the trajectory, s; `start` lets both begin together.
    #[arg(long, value_name = "S", allow_hyphen_values = true, default_value = "0")]
    time_offset: TimeOffset,
}

/// The two corners of a room.
#[derive(Clone, Copy, Debug)]
struct Corners([DVec3; 2]);

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> =
            text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let [x0, y0, z0, x1, y1, z1] = numbers
            .and_then(|numbers| <[f64; 6]>::try_from(numbers).ok())
            .ok_or("expected six finite numbers x,y,z,x,y,z")?;
        let [low, high] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        if !low.cmplt(high).all() {
            return Err("the first corner must lie below the second in x, y and z".into());
        }
        Ok(Self([low, high]))
    }
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
enum TimeOffset {
    Seconds(f64),
    Start,
}

impl FromStr for TimeOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "start" {
            return Ok(Self::Start);
        }
        let seconds = text.parse().ok().filter(|value: &f64| value.is_finite() && value.abs() < 9e9);
        seconds.map(Self::Seconds).ok_or_else(|| format!("{text:?}: expected seconds, or start"))
    }
}

/// A scene, a way, and what is odd about them.
pub struct Place {
    pub scene: Scene,
    pub trajectory: Trajectory,
    pub time_offset_ns: i64,
    /// Frames that made the map.
    pub mapped: std::ops::Range<u64>,
    pub notices: Vec<String>,
}

/// Reads everything.
pub fn read(args: &PlaceArgs, source: &Source, rig: &Rig) -> anyhow::Result<Place> {
    ensure!(
        args.scene.is_some() || !args.mesh.is_stated(),
        "--mesh-unit and --up speak of the mesh behind --scene, and there is none"
    );
    let mut notices = Vec::new();
    let span = || recorded_span(source, rig);
    let trajectory = trajectory(args, source, &span)?;
    let time_offset_ns = match args.time_offset {
        TimeOffset::Seconds(seconds) => (seconds * 1e9).round() as i64,
        TimeOffset::Start => {
            let first_ns = span()?.context("no frame to take the start from")?[0];
            trajectory.time_span_ns()[0] as i64 - first_ns as i64
        }
    };
    let suspicions = trajectory.suspicions(&WalkLimits::default());
    notices.extend(suspicions.iter().take(3).map(|suspicion| format!("trajectory: {suspicion}")));
    if suspicions.len() > 3 {
        notices.push(format!("trajectory: {} more gaps, jumps or spins", suspicions.len() - 3));
    }
    let mapped = args.map_frames.as_ref().map_or(0..0, |frames| frames.0.clone());
    let scene = match (&args.scene, &args.room) {
        (Some(path), _) => {
            let read = scene_file::read(path, &args.mesh, &args.map)?;
            notices.extend(read.warnings);
            read.scene
        }
        (None, Some(Corners([low, high]))) => Scene::Box(BoxScene::closed(*low, *high)),
        (None, None) => {
            Scene::Voxels(Arc::new(map(args, source, rig, &trajectory, time_offset_ns, &mapped)?))
        }
    };
    let [low, high] = scene.bounds_m();
    let stations = trajectory.stations_m(0.5);
    let outside = stations.iter().filter(|at| at.cmplt(low).any() || at.cmpgt(high).any()).count();
    if outside > 0 && mapped.is_empty() {
        notices.push(format!(
            "{outside} of {} points of the path lie outside the scene; do both use the same frame, unit and up axis?",
            stations.len()
        ));
    }
    Ok(Place { scene, trajectory, time_offset_ns, mapped, notices })
}

fn trajectory(
    args: &PlaceArgs,
    source: &Source,
    span: &dyn Fn() -> anyhow::Result<Option<[u64; 2]>>,
) -> anyhow::Result<Trajectory> {
    let Some(path) = &args.trajectory else {
        let Source::Session(session, _) = source else { bail!("give --trajectory: a capture holds none") };
        return session.trajectory()?.context("give --trajectory: the session holds none");
    };
    let name = path.display().to_string();
    if name == "still" {
        let [first_ns, last_ns] = span()?.context("the recording holds no frame")?;
        return Ok(Trajectory::new(vec![(first_ns, Pose::IDENTITY), (last_ns + 1, Pose::IDENTITY)])?);
    }
    let text = std::fs::read_to_string(path).with_context(|| name.clone())?;
    let Some(rate_hz) = args.rate else { return Trajectory::from_tum(&text).context(name) };
    let poses = Trajectory::from_kitti(&text, rate_hz).context(name)?;
    let first_ns = span()?.context("the recording holds no frame")?[0];
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

/// Times of the first and the last column of any sensor, ns.
fn recorded_span(source: &Source, rig: &Rig) -> anyhow::Result<Option<[u64; 2]>> {
    let mut span: Option<[u64; 2]> = None;
    source.feed(rig, &mut |taken| {
        if let Some([first, last]) = taken.frame.time_span_ns() {
            let known = span.unwrap_or([first, last]);
            span = Some([known[0].min(first), known[1].max(last)]);
        }
    })?;
    Ok(span)
}

fn map(
    args: &PlaceArgs,
    source: &Source,
    rig: &Rig,
    trajectory: &Trajectory,
    time_offset_ns: i64,
    frames: &std::ops::Range<u64>,
) -> anyhow::Result<VoxelMap> {
    let mut making = Making::new(&args.map)?;
    source.feed(rig, &mut |taken| {
        if frames.contains(&taken.number) {
            making.add_frame(rig, trajectory, time_offset_ns, &taken);
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
