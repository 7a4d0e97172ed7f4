//! Why a recording has no trajectory, or none in a scene.

use crate::recording::scene::SceneError;
use crate::recording::{RecordingError, SessionError};
use crate::verify::align::AlignError;
use crate::verify::compare::NoTimeOffset;
use crate::verify::odometry::OdometryError;
use crate::world::trajectory::TrajectoryError;

/// Why a recording has no trajectory, or none in a scene.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WalkError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Odometry(#[from] OdometryError),
    #[error(transparent)]
    Align(#[from] AlignError),
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    #[error(
        "{second} begins {apart_s:.3} s after {first} has ended, by their clocks: a trajectory needs sensors recorded \
         at once, on one clock (PTP, or GPS)"
    )]
    Apart { first: String, second: String, apart_s: f64 },
    #[error("{recording} holds {sensors} sensors: --mount says where they sit")]
    SeveralSensors { recording: String, sensors: usize },
    #[error("--odometry-min-range {nearest_m}, expected from 0 to the maximum range")]
    Ranges { nearest_m: f64 },
    #[error("{recording} holds no trajectory: give --trajectory FILE or --trajectory odometry")]
    SessionWithout { recording: String },
    #[error(
        "--frame world: {recording} does not say where the rig was: give --trajectory FILE (TUM, KITTI, a bag) or --trajectory odometry"
    )]
    CaptureWithout { recording: String },
    #[error("--frame world: give --trajectory FILE or --trajectory odometry")]
    BagWithout(#[source] RecordingError),
    #[error("the times of its revolutions")]
    Revolutions(#[source] RecordingError),
    #[error(
        "{name}: {poses} poses without times, and {recording} holds {revolutions} revolutions of its first sensor; expected a pose for \
         each, or a trajectory with times (TUM)"
    )]
    PosesPerRevolution { name: String, poses: usize, recording: String, revolutions: usize },
    #[error("no frame to take the start from")]
    NoStart,
    #[error(
        "--time-offset search looked {span_s} s to each side of {around_s:.2} s; for clocks farther apart it takes seconds, or start"
    )]
    NoTimeOffset { span_s: f64, around_s: f64, source: NoTimeOffset },
    #[error("give --trajectory (`odometry` finds one): {what} holds none")]
    NoTrajectoryOfMap { what: &'static str },
    #[error("--map-frames {from}..{end}: no return of these frames lies within the trajectory's time")]
    EmptyMap { from: u64, end: u64 },
    #[error("--align-near is about --align: {what} holds its own trajectory")]
    NearWithoutAlign { what: &'static str },
    #[error("give --scene, --room or --map-frames")]
    NoScene,
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{name}")]
    TrajectoryFile { name: String, source: TrajectoryError },
}

impl WalkError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        match self {
            Self::Ranges { .. } | Self::NearWithoutAlign { .. } | Self::NoScene => true,
            Self::Scene(error) => error.is_usage(),
            Self::Recording(error) => error.is_usage(),
            _ => false,
        }
    }
}
