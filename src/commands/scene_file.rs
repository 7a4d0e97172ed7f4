//! The flags about what lies behind `--scene`: a mesh, or a map of voxels made of a recording or of a point cloud.

use std::path::{Path, PathBuf};

use super::scene_args::{MeshArgs, Room};
use super::{Context, stage};
use crate::recording::scene::{MapSpec, SceneKind, SceneSpec};
use crate::world::scene::LoadedScene;

/// How a recording or a cloud becomes a map.
#[derive(clap::Args, Debug, Clone)]
pub struct MapArgs {
    /// Edge of a cell of a map that is made of a recording or a cloud.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    map_voxel: f64,
    /// Points that make a cell of such a map occupied.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    map_hits: u8,
    /// Trajectory of the sensor that recorded the cloud behind --scene (TUM, by the clock of the cloud's times): what lies
    /// between it and the points is free. Not needed where the points have vp_x, vp_y, vp_z. Of a recorded session the trajectory
    /// of the rig, where the session does not hold it itself.
    #[arg(long, value_name = "FILE")]
    map_path: Option<PathBuf>,
}

impl MapArgs {
    pub(crate) fn spec(&self) -> MapSpec {
        MapSpec { voxel_m: self.map_voxel, hits: self.map_hits, trajectory: self.map_path.clone() }
    }
}

/// Arguments about a mesh, and about a map.
const OF_A_MESH: [&str; 2] = ["mesh_unit", "up"];
const OF_A_MAP: [&str; 3] = ["map_voxel", "map_hits", "map_path"];

/// Refuses what was typed about a mesh or a map where the scene is neither; `what` it is, in words.
pub(crate) fn ensure_none_typed(context: Context, what: &str) -> anyhow::Result<()> {
    context.ensure_not_typed(&OF_A_MESH, format!("is about the mesh behind --scene, and {what}"))?;
    context.ensure_not_typed(
        &OF_A_MAP,
        format!("is about a map that is made of a recording or a cloud, and {what}"),
    )
}

/// Refuses what was typed about a scene behind `--scene` where the map is made of frames of the recording itself.
pub(crate) fn ensure_of_frames(context: Context) -> anyhow::Result<()> {
    let of_another = ["mesh_unit", "up", "map_path"];
    context.ensure_not_typed(
        &of_another,
        "is about what lies behind --scene, and the map is made of --map-frames",
    )
}

/// Reads what the path names, or makes the room; none where there is neither.
pub(crate) fn read_or_room(
    scene: Option<&Path>,
    room: Option<Room>,
    mesh: &MeshArgs,
    map: &MapArgs,
    context: Context,
) -> anyhow::Result<Option<LoadedScene>> {
    match (scene, room) {
        (Some(path), _) => read(path, mesh, map, context).map(Some),
        (None, Some(room)) => {
            ensure_none_typed(context, "the scene is a room")?;
            Ok(Some(LoadedScene::of_room(&room.scene())))
        }
        (None, None) => Ok(None),
    }
}

/// Reads whatever the path names.
pub(crate) fn read(
    path: &Path,
    mesh: &MeshArgs,
    map: &MapArgs,
    context: Context,
) -> anyhow::Result<LoadedScene> {
    match SceneKind::of(path)? {
        SceneKind::Mesh => context.ensure_not_typed(
            &OF_A_MAP,
            format!("is about a map that is made of a session or a cloud, and {} is neither", path.display()),
        )?,
        SceneKind::Session | SceneKind::Cloud => context.ensure_not_typed(
            &OF_A_MESH,
            format!("is about a mesh, and {} is none: maps are in metres, z up", path.display()),
        )?,
    }
    let MeshArgs { mesh_unit, up } = *mesh;
    let spec =
        SceneSpec { path: path.to_owned(), mesh_unit, up, map: map.spec(), observer: stage::observer() };
    Ok(spec.read()?)
}
