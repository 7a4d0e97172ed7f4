//! The scene behind a path: a mesh, or a map of voxels that is made of a session or of a point cloud.

use std::path::{Path, PathBuf};

use super::mounted::{AxisZeros, MountedFrame, MountedSession, feed_session, host_clock, tilts};
use super::{Observer, RecordingError, Session, SessionError, read_trajectory};
use crate::rig::{MountFileError, Rig, UnitError};
use crate::world::scene::{
    CLOUD_ENDINGS, LoadedScene, MESH_ENDINGS, MapBuilder, MapError, MeshFile, MeshFileError, MeshUnit, UNITS,
    UpAxis, VoxelMap, VoxelMapError, is_cloud, plausible_units,
};
use crate::world::trajectory::Trajectory;

/// What is read, and how.
#[derive(Clone, Debug)]
pub(crate) struct SceneSpec {
    pub path: PathBuf,
    /// What a mesh file does not say itself.
    pub mesh_unit: Option<MeshUnit>,
    pub up: Option<UpAxis>,
    pub map: MapSpec,
    pub observer: Observer,
}

/// How a session or a cloud becomes a map.
#[derive(Clone, Debug)]
pub(crate) struct MapSpec {
    pub voxel_m: f64,
    /// Points that make a voxel occupied.
    pub hits: u8,
    /// Trajectory of the sensor that recorded a cloud, or of the rig of a session that does not hold it itself.
    pub trajectory: Option<PathBuf>,
}

/// What a path names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SceneKind {
    Mesh,
    Session,
    Cloud,
}

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SceneError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    MountFile(#[from] MountFileError),
    #[error(transparent)]
    Unit(#[from] UnitError),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Mesh(MeshFileError),
    #[error("{path}: a folder that is no session; expected a session, a mesh or a cloud", path = path.display())]
    Folder { path: PathBuf },
    #[error(
        "{path}: its name has no ending that is known; expected a session, a mesh ({MESH_ENDINGS}) or a cloud \
         ({CLOUD_ENDINGS})",
        path = path.display()
    )]
    UnknownEnding { path: PathBuf },
    #[error("{error}: pass --mesh-unit {units}{guess}", units = UNITS.map(|(name, _)| name).join(", "))]
    UnitUnclear { error: MeshFileError, guess: String },
    #[error("--map-voxel: {0}")]
    Voxel(VoxelMapError),
    #[error("{path}: the session holds no mount file, and a map needs one", path = path.display())]
    NoMount { path: PathBuf },
    #[error(
        "{path}: the session holds no trajectory, and a map needs one: give it with --map-path",
        path = path.display()
    )]
    NoTrajectory { path: PathBuf },
}

impl SceneError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::Voxel(_)) || matches!(self, Self::Recording(error) if error.is_usage())
    }
}

impl SceneKind {
    pub(crate) fn of(path: &Path) -> Result<Self, SceneError> {
        match (Session::is_session(path), path.is_dir()) {
            (true, _) => Ok(Self::Session),
            (false, true) => Err(SceneError::Folder { path: path.to_owned() }),
            (false, false) => Ok(if is_cloud(path) { Self::Cloud } else { Self::Mesh }),
        }
    }
}

impl SceneSpec {
    /// Reads whatever the path names.
    pub(crate) fn read(&self) -> Result<LoadedScene, SceneError> {
        let path = &self.path;
        let kind = SceneKind::of(path)?;
        if kind == SceneKind::Mesh {
            return self.read_mesh().map(LoadedScene::from);
        }
        let mut making = Making::new(&self.map)?;
        let given = self.map.trajectory.as_deref();
        let given =
            given.map(|path| Ok::<_, RecordingError>((path, read_trajectory(path, None)?))).transpose()?;
        let mut warnings: Vec<String> = given.iter().flat_map(|(_, (_, notes))| notes.clone()).collect();
        let given = given.map(|(path, (trajectory, _))| (path, trajectory));
        let made_of = if kind == SceneKind::Session {
            let trajectory = given.map(|(_, trajectory)| trajectory);
            warnings.extend(making.add_session(path, trajectory, self.observer)?);
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

    /// What is neither given nor stated by the format is metres, z up.
    fn read_mesh(&self) -> Result<MeshFile, SceneError> {
        MeshFile::read(&self.path, self.mesh_unit, self.up).map_err(|error| match error {
            MeshFileError::UnitUnclear { extent_units, .. } => {
                let guess = MeshUnit::offer(&plausible_units(extent_units), extent_units.into());
                SceneError::UnitUnclear { error, guess: guess.to_string() }
            }
            MeshFileError::UnknownFormat { .. } => SceneError::UnknownEnding { path: self.path.clone() },
            error => SceneError::Mesh(error),
        })
    }
}

/// A map being built from a recording.
pub(crate) struct Making(MapBuilder);

impl Making {
    pub(crate) fn new(spec: &MapSpec) -> Result<Self, SceneError> {
        MapBuilder::new(spec.voxel_m, spec.hits).map(Self).map_err(SceneError::Voxel)
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
        let MountedFrame { model, frame, .. } = mounted_frame;
        self.0.add_frame(model, &body_from_sensor, trajectory, time_offset_ns, frame);
    }

    /// Every frame of a session, by its own mount and the trajectory given, or its own; what the session lost.
    fn add_session(
        &mut self,
        path: &Path,
        trajectory: Option<Trajectory>,
        observer: Observer,
    ) -> Result<Vec<String>, SceneError> {
        let mut session = Session::open(path)?;
        let file = session.mount()?.ok_or_else(|| SceneError::NoMount { path: path.to_owned() })?;
        let (trajectory, notes) = match (trajectory, session.trajectory()?) {
            (Some(given), _) => (given, Vec::new()),
            (None, Some(own)) => (own.trajectory, own.notes),
            (None, None) => return Err(SceneError::NoTrajectory { path: path.to_owned() }),
        };
        let rig = file.rig()?;
        let mut notices = host_clock::settle(&mut session, &rig, observer)?;
        let measured = tilts(&session, &rig, &AxisZeros::default())?;
        notices.extend(measured.notices);
        let mut take = |mounted_frame: MountedFrame<'_>| self.add_frame(&rig, &trajectory, 0, &mounted_frame);
        let mounted_session =
            MountedSession { session: &session, rig: &rig, tilts: &measured.histories, calibrations: &[] };
        let advance = (observer.stage)("making a map of the session");
        let pass = feed_session(&mounted_session, &advance, &mut take)?;
        let of_session = notices.iter().chain(&pass.losses).map(|loss| format!("{}: {loss}", path.display()));
        Ok(notes.into_iter().chain(of_session).collect())
    }

    /// The map alone, of frames that a caller chose.
    pub(crate) fn into_map(self) -> VoxelMap {
        self.0.into_map()
    }
}
