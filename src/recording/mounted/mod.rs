//! A recording with known slots of its sensors on the rig: a session, which knows them, or a capture with a mount file.

mod axes;
mod axis_zeros;
mod beams;
mod capture;
mod data_gaps;
mod feed;
mod found_mount;
mod homing;
pub(crate) mod host_clock;
mod mounts;
mod open;
mod pass_summary;
mod pitches;
mod placed;
mod session;
mod tilt;

use std::cell::OnceCell;

use sensors::router::GivenCalibration;

use super::bags::Surroundings;
use super::observer::Observer;
use super::source::{Recording, RecordingError};
use super::{ServoReport, Session};
use crate::base::geometry::Pose;
use crate::rig::{MountFile, Rig};
use crate::world::trajectory::{ReadTrajectory, Trajectory};
use axes::{contradicted, reports_of};
use capture::feed_capture;

pub(crate) use axes::{AxisSummary, summaries, tilts};
pub(crate) use axis_zeros::AxisZeros;
pub(crate) use data_gaps::{apart, data_gaps};
pub(crate) use feed::MountedFrame;
pub(crate) use mounts::Mounts;
pub(crate) use open::MountedSpec;
pub(crate) use pass_summary::{PassSummary, SensorSummary};
pub(crate) use placed::{PlacedFrame, each_frame, revolutions_ns};
pub(crate) use session::{MountedSession, feed_session};
pub use tilt::{FramePitch, TiltHistory, TiltReading};

enum Source {
    Session { session: Box<Session>, tilts: Vec<TiltHistory>, calibrations: Vec<GivenCalibration> },
    Capture(Box<Recording>),
}

/// A recording and the rig that made it.
pub(crate) struct MountedRecording {
    source: Source,
    observer: Observer,
    pub mount: MountFile,
    pub rig: Rig,
    zeros: AxisZeros,
    /// What may not be as the user thinks.
    pub notices: Vec<String>,
    span_ns: OnceCell<Option<[u64; 2]>>,
}

impl MountedRecording {
    /// What its axes reported, by the places of their sensors in the rig; nothing for a capture.
    pub(crate) fn servo(&self) -> Result<Vec<ServoReport>, RecordingError> {
        match &self.source {
            Source::Session { session, .. } => reports_of(session, &self.rig),
            Source::Capture(_) => Ok(Vec::new()),
        }
    }

    /// What its axes measured while its sensors recorded, which a pass over it has found.
    pub(crate) fn axes(&self, pass: &PassSummary) -> Vec<AxisSummary> {
        summaries(&self.rig, &self.zeros, &pass.pitches)
    }

    /// Mounts that are not as their axes measured, in words.
    pub(crate) fn contradicted(&self, pass: &PassSummary) -> Vec<String> {
        contradicted(&self.rig, &self.zeros, &pass.pitches)
    }

    /// What it is, in words.
    pub(crate) fn what(&self) -> &'static str {
        match &self.source {
            Source::Session { .. } => "the session",
            Source::Capture(recording) if recording.is_bag() => "the bag",
            Source::Capture(_) => "a capture",
        }
    }

    /// The trajectory that it holds itself.
    pub(crate) fn own_trajectory(&self) -> Result<Option<ReadTrajectory>, RecordingError> {
        match &self.source {
            Source::Session { session, .. } => Ok(session.trajectory()?),
            Source::Capture(_) => Ok(None),
        }
    }

    /// The poses in the bag that it is, whose frame may be any.
    pub(crate) fn poses_of_bag(&self) -> Result<Option<ReadTrajectory>, RecordingError> {
        let Source::Capture(recording) = &self.source else { return Ok(None) };
        if !recording.is_bag() {
            return Ok(None);
        }
        let surroundings = Surroundings::read(recording.path(), &recording.name())?;
        if surroundings.trajectories.is_empty() {
            return Ok(None);
        }
        let (trajectory, notes) = surroundings.platform_trajectory(recording.path(), None)?;
        Ok(Some(ReadTrajectory { trajectory, notes }))
    }

    /// Every frame.
    pub(crate) fn feed(&self, take: &mut dyn FnMut(MountedFrame<'_>)) -> Result<PassSummary, RecordingError> {
        match &self.source {
            Source::Session { session, tilts, calibrations } => {
                let advance = (self.observer.stage)("going through the session");
                feed_session(&MountedSession { session, rig: &self.rig, tilts, calibrations }, &advance, take)
            }
            Source::Capture(recording) => feed_capture(recording, &self.rig, take),
        }
    }

    /// Times of the first and the last column of any sensor, ns; none where no frame was recorded. Decodes all of it once.
    pub(crate) fn span_ns(&self) -> Result<Option<[u64; 2]>, RecordingError> {
        if let Some(known) = self.span_ns.get() {
            return Ok(*known);
        }
        let mut span: Option<[u64; 2]> = None;
        self.feed(&mut |mounted_frame| {
            if let Some([first, last]) = mounted_frame.frame.time_span_ns() {
                let known = span.unwrap_or([first, last]);
                span = Some([known[0].min(first), known[1].max(last)]);
            }
        })?;
        Ok(*self.span_ns.get_or_init(|| span))
    }

    /// The trajectory of a rig that does not move.
    pub(crate) fn still(&self) -> Result<Trajectory, RecordingError> {
        let [first_ns, last_ns] = self.span_ns()?.ok_or(RecordingError::NoFrame)?;
        Ok(Trajectory::new(vec![(first_ns, Pose::IDENTITY), (last_ns + 1, Pose::IDENTITY)])?)
    }
}
