//! Mounts, scene and trajectory, as far as they are known.

use std::path::PathBuf;

use crate::commands::scene_args::{MeshArgs, Room};
use crate::commands::scene_file::MapArgs;

/// What the live view knows of mounts, scene and trajectory. Each is that of `[predict]` where `[daemon]` names none.
#[derive(clap::Args, Debug)]
pub struct SiteArgs {
    /// Sensors of the rig, in the order of its axes: places their points, and has the pitches to apply.
    #[arg(long, value_name = "FILE")]
    pub(super) mount: Option<PathBuf>,
    /// What is around, for the prediction: a mesh (.ply, .obj, .stl, .off, .gltf or .glb), or what a map is made of: a session, or
    /// a point cloud (.ply without faces, .pcd, .las, .laz, .e57 or text).
    #[arg(long, value_name = "PATH", conflicts_with = "room")]
    pub(super) scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its min and max corner, m.
    #[arg(long, allow_hyphen_values = true, value_name = "CORNERS")]
    pub(super) room: Option<Room>,
    #[command(flatten)]
    pub(super) mesh: MeshArgs,
    #[command(flatten)]
    pub(super) map: MapArgs,
    /// Trajectory of the platform: TUM, EuRoC or another table with named columns, or KITTI poses with --rate; without it the platform stands at the origin.
    #[arg(long, value_name = "FILE")]
    pub(super) trajectory: Option<PathBuf>,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    pub(super) rate: Option<f64>,
    /// The trajectory begins when recording does, whatever times it names.
    #[arg(long)]
    pub(super) trajectory_starts_with_recording: bool,
    /// Edge of a cell of the live coverage, m.
    #[arg(long, value_name = "M", default_value_t = 0.25, value_parser = crate::commands::ranges::within(0.01, 100.0))]
    pub(super) cell: f64,
}

/// Keys that `[daemon]` takes from `[predict]`.
pub const FROM_PREDICT: [&str; 10] =
    ["mount", "scene", "room", "mesh_unit", "up", "map_voxel", "map_hits", "map_path", "trajectory", "rate"];
