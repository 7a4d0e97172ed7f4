//! Mounts, scene and way, as far as they are known.

use std::path::PathBuf;

use anyhow::{Context as _, bail};

use crate::commands::ground::{MeshArgs, Room, read_trajectory};
use crate::commands::scene_file::{self, MapArgs};
use crate::daemon::Place;
use crate::rig::MountFile;

/// What the live view knows of mounts, scene and way. Each is that of `[predict]` where `[daemon]` names none.
#[derive(clap::Args, Debug)]
pub struct PlaceArgs {
    /// Sensors of the rig, in the order of its axes: places their points, and has the pitches to apply.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
    /// What is around, for the prediction: a mesh (.ply, .obj, .stl, .gltf or .glb), or what a map is made of: a session, or
    /// a point cloud (.ply without faces, .pcd, .las or .laz).
    #[arg(long, value_name = "PATH", conflicts_with = "room")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its least and greatest corner, m.
    #[arg(long, allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Room>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Way of the platform: TUM format, or KITTI poses with --rate; without it the platform stands at the origin.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// The trajectory begins when recording does, whatever times it names.
    #[arg(long)]
    trajectory_starts_with_recording: bool,
    /// Edge of a cell of the live coverage, m.
    #[arg(long, value_name = "M", default_value_t = 0.25)]
    cell: f64,
}

/// Keys that `[daemon]` takes from `[predict]`.
pub const FROM_PREDICT: [&str; 10] =
    ["mount", "scene", "room", "mesh_unit", "up", "map_voxel", "map_hits", "map_path", "trajectory", "rate"];

/// Reads what is named.
pub fn place(args: &PlaceArgs) -> anyhow::Result<Place> {
    if !(args.cell.is_finite() && (0.01..=10.0).contains(&args.cell)) {
        bail!("--cell {}, expected 0.01 to 10 m", args.cell);
    }
    let mut place = Place { voxel_m: args.cell, ..Place::default() };
    if let Some(path) = &args.mount {
        let file = MountFile::read(path)?;
        let units = file.units(&[])?;
        place.rig = file.rig_of(&units);
        place.calibrations = file.calibration_files()?;
        place.mount = Some(file);
    }
    place.scene = match (&args.scene, &args.room) {
        (Some(_), Some(_)) => bail!("--scene and --room are both given: which of the two is it?"),
        (Some(path), None) => {
            let read = scene_file::read(path, &args.mesh, &args.map)?;
            read.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
            Some(read.scene)
        }
        (None, Some(room)) => Some(room.scene()),
        (None, None) => None,
    };
    let cells = place.grid().cells.iter().map(|count| *count as f64).product::<f64>();
    if cells > f64::from(1 << 27) {
        bail!("--cell {} makes {cells:.0} cells of this scene: take larger ones", args.cell);
    }
    if let Some(path) = &args.trajectory {
        place.trajectory =
            Some(read_trajectory(path, args.rate).with_context(|| path.display().to_string())?);
    }
    if args.trajectory_starts_with_recording && args.trajectory.is_none() {
        bail!(
            "--trajectory-starts-with-recording: no trajectory; expected --trajectory, or one in the rig.toml"
        );
    }
    place.starts_with_recording = args.trajectory_starts_with_recording;
    Ok(place)
}
