//! The scene behind `--scene`: a mesh, or a map of cells made of a recording or of a point cloud.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};

use super::recorded::axes::tilts;
use super::recorded::axis_zeros::AxisZeros;
use super::recorded::feed::MountedFrame;
use super::recorded::host_clock;
use super::recorded::session::{MountedSession, feed_session};
use super::scene_args::MeshArgs;
use super::stage::Stage;
use super::trajectory_args::read_trajectory;
use super::{Context, wrong_usage};
use crate::recording::Session;
use crate::rig::Rig;
use crate::world::scene::{
    CLOUD_ENDINGS, LoadedScene, MESH_ENDINGS, MapBuilder, MeshFileError, VoxelMap, is_cloud,
};
use crate::world::trajectory::Trajectory;

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

/// Reads whatever the path names.
pub(crate) fn read(
    path: &Path,
    mesh_args: &MeshArgs,
    map_args: &MapArgs,
    context: Context,
) -> anyhow::Result<LoadedScene> {
    let is_session = Session::is_session(path);
    if path.is_dir() && !is_session {
        bail!("{}: a folder that is no session; expected a session, a mesh or a cloud", path.display());
    }
    if !is_session && !is_cloud(path) {
        context.ensure_not_typed(
            &OF_A_MAP,
            format!("is about a map that is made of a session or a cloud, and {} is neither", path.display()),
        )?;
        let read = mesh_args.read(path).map(LoadedScene::from);
        return read.map_err(|error| match error.downcast_ref() {
            Some(MeshFileError::UnknownFormat { .. }) => anyhow!(
                "{}: its name has no ending that is known; expected a session, a mesh ({MESH_ENDINGS}) or a cloud \
                 ({CLOUD_ENDINGS})",
                path.display()
            ),
            _ => error,
        });
    }
    context.ensure_not_typed(
        &OF_A_MESH,
        format!("is about a mesh, and {} is none: maps are in metres, z up", path.display()),
    )?;
    let mut making = Making::new(map_args)?;
    let given = map_args.map_path.as_deref();
    let given = given.map(|path| Ok::<_, anyhow::Error>((path, read_trajectory(path, None)?))).transpose()?;
    let mut warnings: Vec<String> = given.iter().flat_map(|(_, (_, notes))| notes.clone()).collect();
    let given = given.map(|(path, (trajectory, _))| (path, trajectory));
    let made_of = if is_session {
        warnings.extend(making.add_session(path, given.map(|(_, trajectory)| trajectory))?);
        "recording"
    } else {
        making.0.add_cloud(path, given)?;
        "cloud"
    };
    let mut loaded = LoadedScene::from_map(making.0.finish(path, made_of)?);
    warnings.append(&mut loaded.warnings);
    loaded.warnings = warnings;
    Ok(loaded)
}

/// A map being built from a recording.
pub struct Making(MapBuilder);

impl Making {
    pub(crate) fn new(args: &MapArgs) -> anyhow::Result<Self> {
        let builder = MapBuilder::new(args.map_voxel, args.map_hits);
        Ok(Self(builder.map_err(|error| wrong_usage(format!("--map-voxel: {error}")))?))
    }

    /// Adds the returns of a recorded frame that fall into the trajectory's time.
    pub(crate) fn add_frame(
        &mut self,
        rig: &Rig,
        trajectory: &Trajectory,
        time_offset_ns: i64,
        mounted_frame: &MountedFrame<'_>,
    ) {
        let body_from_sensor = mounted_frame.body_from_sensor(&rig.sensors[mounted_frame.sensor].mount);
        self.0.add_frame(
            mounted_frame.model,
            &body_from_sensor,
            trajectory,
            time_offset_ns,
            mounted_frame.frame,
        );
    }

    /// Every frame of a session, by its own mount and the trajectory given, or its own; what the session lost.
    fn add_session(&mut self, path: &Path, trajectory: Option<Trajectory>) -> anyhow::Result<Vec<String>> {
        let mut session = Session::open(path)?;
        let lacks =
            |what: &str| format!("{}: the session holds no {what}, and a map needs one", path.display());
        let file = session.mount()?.with_context(|| lacks("mount file"))?;
        let own_or_given = match trajectory {
            Some(given) => Some(given),
            None => session.trajectory()?,
        };
        let trajectory =
            own_or_given.with_context(|| format!("{}: give it with --map-path", lacks("trajectory")))?;
        let rig = file.rig()?;
        let mut notices = host_clock::settle(&mut session, &rig)?;
        let measured = tilts(&session, &rig, &AxisZeros::default())?;
        notices.extend(measured.notices);
        let mut take = |mounted_frame: MountedFrame<'_>| self.add_frame(&rig, &trajectory, 0, &mounted_frame);
        let mounted_session =
            MountedSession { session: &session, rig: &rig, tilts: &measured.histories, calibrations: &[] };
        let stage = Stage::begin("making a map of the session");
        let pass = feed_session(&mounted_session, &stage, &mut take)?;
        Ok(notices.iter().chain(&pass.losses).map(|loss| format!("{}: {loss}", path.display())).collect())
    }

    /// The map alone, of frames that a caller chose.
    pub(crate) fn into_map(self) -> VoxelMap {
        self.0.into_map()
    }
}
