//! Why the demo ended early.

use std::io;

use ::sensors::catalogue::ModelError;
use ::sensors::ouster::MetadataError;

use crate::design::objective::{ExperimentError, ObjectiveError};
use crate::design::optimize::{SearchError, SpaceError};
use crate::drive::RigError;
use crate::live::receive::ReceiveError;
use crate::recording::{RecordingError, SessionError};
use crate::rig::UnitError;
use crate::verify::compare::ReplayingError;

/// Why the demo ended early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DemoError {
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Metadata(#[from] MetadataError),
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
    #[error(transparent)]
    Space(#[from] SpaceError),
    #[error(transparent)]
    Search(#[from] SearchError),
    #[error(transparent)]
    Unit(#[from] UnitError),
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Replaying(#[from] ReplayingError),
    #[error("no mount among {evaluations} keeps the housings apart: give --evals a greater number")]
    NoMount { evaluations: usize },
    #[error("cannot open a pty for the mock rig")]
    NoPty(#[source] io::Error),
    #[error("the mock rig hung up")]
    RigHungUp,
    #[error("a mock sensor has no socket")]
    NoSocket(#[source] io::Error),
    #[error("a mock sensor cannot send")]
    CannotSend(#[source] io::Error),
    #[error("a mock sensor panicked")]
    SensorPanicked,
    #[error("interrupted")]
    Interrupted,
    #[error("the recording ended")]
    RecordingEnded,
    #[error("axis {axis} of the rig reports {faults}")]
    AxisFaults { axis: usize, faults: String },
    #[error("the rig no longer reports")]
    RigSilent,
    #[error("the session holds no trajectory")]
    NoTrajectory,
    #[error("no measured angle of axis {axis} ({sensor}) was recorded")]
    NothingMeasured { axis: usize, sensor: String },
}
