//! Why points are not written.

use std::path::PathBuf;

use glam::DVec3;

use crate::recording::bags::BagError;
use crate::recording::export::ExportError;
use crate::recording::packet_reader::PacketError;
use crate::recording::source::RecordingError;

/// Why points are not written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DecodingError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Packets(#[from] PacketError),
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A format that cannot tell sensors apart.
    #[error("{path} would mix the points of {first} and {second}: give a folder behind --out", path = path.display())]
    Mixed { path: PathBuf, first: String, second: String },
    #[error("--out -: points go to a file or a folder, not to stdout; expected a name such as points.csv")]
    Stdout,
    #[error("--format {asked} contradicts --out {out}")]
    Contradiction { asked: &'static str, out: String },
    #[error("--out {out}: which format? add --format")]
    WhichFormat { out: String },
    #[error("--out {out}: there is a file of this name, which cannot be a folder")]
    NoFolder { out: String },
    #[error("--out {out}: this is the recording itself")]
    Itself { out: String },
    #[error("--out {out}: there is no folder {parent}; make it first (mkdir -p {parent})")]
    NoParent { out: String, parent: String },
    #[error(
        "--format {format}: the points lie near ({:.0}, {:.0}, {:.0}) m, which its 32 bits hold to half a metre at best; expected las, \
         laz, e57, ply, csv or npy",
        at_m.x,
        at_m.y,
        at_m.z
    )]
    TooFar { format: &'static str, at_m: DVec3 },
    #[error("{}", super::INTERRUPTED)]
    Interrupted,
    #[error("nothing is written: {loss}")]
    NothingPlaced { loss: String },
    #[error(
        "nothing is written: no point is left by what was asked for (frames, times, sensors, ranges, box)"
    )]
    NothingLeft,
    #[error(
        "nothing is written: no point in {frames} frames; expected revolutions with returns (`outrigger inspect` lists what the \
         recording holds)"
    )]
    NoPoint { frames: usize },
    #[error("--sensor {name}: no packet of it; there are {known}")]
    UnknownSensor { name: String, known: String },
    #[error("--frames {asked}: the recording has fewer, counted from 0: {found}")]
    FewerFrames { asked: String, found: String },
    #[error("{recording}: no static transforms lead from frame {frame} of the clouds to {body}")]
    NoTransform { recording: String, frame: String, body: String },
    #[error("{recording}: no cloud in it can be read: {notices}")]
    NoCloud { recording: String, notices: String },
    #[error("--trajectory odometry is found from packets, and {recording} holds clouds")]
    OdometryOfClouds { recording: String },
    #[error(
        "{recording}: it holds no trajectory (nav_msgs/Odometry or Path, geometry_msgs poses, or /tf): give --trajectory"
    )]
    NoTrajectory { recording: String },
}

impl DecodingError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        match self {
            Self::Stdout | Self::Contradiction { .. } | Self::WhichFormat { .. } => true,
            Self::Recording(error) => error.is_usage(),
            _ => false,
        }
    }
}
