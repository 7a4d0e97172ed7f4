//! Why a recording cannot be opened or read.

use std::path::PathBuf;

use sensors::catalogue::ModelError;
use sensors::ouster::MetadataError;
use sensors::velodyne::CalibrationError;

use crate::recording::SessionError;
use crate::recording::bags::BagError;
use crate::recording::packet_reader::PacketError;
use crate::rig::{MountFileError, NoSlot, UnitError};
use crate::simulate::walk::WalkError;
use crate::world::trajectory::TrajectoryError;

/// Why a recording cannot be opened or read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RecordingError {
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Packets(#[from] PacketError),
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    MountFile(#[from] MountFileError),
    #[error(transparent)]
    Unit(#[from] UnitError),
    #[error(transparent)]
    NoSlot(#[from] NoSlot),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Metadata(#[from] MetadataError),
    #[error(transparent)]
    Walk(#[from] WalkError),
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    /// The system refused a file.
    #[error("{name}")]
    File { name: String, source: std::io::Error },
    #[error("{name}: cannot be read")]
    Unreadable { name: String, source: std::io::Error },
    #[error("{name} cannot be copied to a temporary file (TMPDIR)")]
    NotCopied { name: String, source: std::io::Error },
    #[error("{name}")]
    Calibration { name: String, source: CalibrationError },
    #[error("{name}")]
    TrajectoryFile { name: String, source: TrajectoryError },
    #[error(
        "{path}: a folder without {manifest}; expected a capture file, or a session that `record` or the daemon wrote, or a bag or the \
         folder of one",
        path = path.display(),
        manifest = crate::recording::file::MANIFEST
    )]
    NoRecording { path: PathBuf },
    #[error(
        "{first} and {second}: both of sensor {serial}, with packets of the same format, and they differ: give the one of the \
         time of the recording"
    )]
    MetadataDiffer { first: String, second: String, serial: String },
    #[error(
        "--calibration {name}={file}: {recording} is no session, so its sensors have no names: say ADDRESS={file}, or \
         :PORT={file} with the port of its data packets"
    )]
    NamesWithoutSession { name: String, file: String, recording: String },
    #[error("--calibration {name}={file}: no sensor of {recording} is called {name}; there are {known}")]
    UnknownName { name: String, file: String, recording: String, known: String },
    #[error(
        "--calibration {address}=...: {manifest} names no sensor that sends from there; name the file under `calibrations` \
         in the mount file, or without an address where one holds for every Velodyne"
    )]
    UnknownSender { address: String, manifest: String },
    #[error("{name}, given for {sensor}: {error}")]
    CalibrationDoesNotFit { name: String, sensor: String, error: String },
    #[error("--meta {source_filter}={name}: {reason}")]
    MetadataOfSeveral { source_filter: String, name: String, reason: String },
    #[error(
        "--meta {source_filter}={name}: no packet that fits it, and no other --meta as well, {whence}; `outrigger inspect` lists \
         who sends what where"
    )]
    MetadataWithoutPackets { source_filter: String, name: String, whence: String },
    #[error(
        "--model: {recording} is a session, which names the models of its sensors; give --model to a capture"
    )]
    ModelOfSession { recording: String },
    #[error("{recording}: give --mount, {why}")]
    NoMount { recording: String, why: String },
    #[error(
        "{recording} holds several sensors, and nothing says where they sit: give --mount, or choose one with --sensor ({notices})"
    )]
    SeveralWithoutMount { recording: String, notices: String },
    #[error("{recording} holds more sensors than the mount file, which names {named}")]
    MoreThanMounted { recording: String, named: usize },
    #[error("{recording} holds {found} sensors, the mount file names {named}")]
    MoreThanNamed { recording: String, found: usize, named: usize },
    #[error(
        "--axis-zero {sensor}=...: the recording holds no angle that an axis of a sensor of this name measured"
    )]
    ZeroOfNothing { sensor: String },
    #[error("{recording}: no LiDAR data was decoded: {losses}")]
    NothingDecoded { recording: String, losses: String },
    /// What the file holds instead, and what to do: [`crate::recording::unread::why_nothing`].
    #[error("{0}")]
    NothingRead(String),
    #[error("the recording holds no frame")]
    NoFrame,
    #[error("--rate is for poses without times (KITTI): {name} is a bag, and its poses have times")]
    RateOfBag { name: String },
}

impl RecordingError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::NamesWithoutSession { .. } | Self::RateOfBag { .. })
    }
}
