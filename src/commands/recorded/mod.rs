//! A recording with known slots of its sensors on the rig: a session, which knows them, or a capture with a mount file.

pub mod axes;
pub mod axis_zeros;
pub mod beams;
mod args;
mod capture;
pub mod feed;
pub mod data_gaps;
pub mod host_clock;
mod homing;
mod open;
pub mod pass_summary;
pub mod pitches;
pub mod session;

use std::cell::OnceCell;

use anyhow::Context as _;
use sensors::router::GivenCalibration;

use crate::base::geometry::Pose;
use crate::commands::recording::Recording;
use crate::commands::stage::Stage;
use crate::drive::ServoReport;
use crate::recording::Session;
use crate::rig::{MountFile, MountedSensor, Rig};
use crate::verify::compare::{RecordedRay, Thinning, TiltHistory};
use crate::world::trajectory::Trajectory;
pub use args::RecordedArgs;
use axes::{AxisSummary, contradicted, reports_of, summaries};
use axis_zeros::AxisZeros;
use capture::feed_capture;
use feed::MountedFrame;
use pass_summary::PassSummary;
use session::{MountedSession, feed_session};

enum Source {
    Session { session: Box<Session>, tilts: Vec<TiltHistory>, calibrations: Vec<GivenCalibration> },
    Capture(Box<Recording>),
}

/// A recording and the rig that made it.
pub struct Recorded {
    source: Source,
    pub mount: MountFile,
    pub rig: Rig,
    zeros: AxisZeros,
    /// What may not be as the user thinks.
    pub notices: Vec<String>,
    span_ns: OnceCell<Option<[u64; 2]>>,
}

/// Some of the rays of a recording.
pub struct RaySample {
    /// In order of time.
    pub rays: Vec<RecordedRay>,
    /// The rig's, each with the beams of its packets.
    pub sensors: Vec<MountedSensor>,
    pub pass: PassSummary,
}

impl Recorded {
    /// What its axes reported, by the places of their sensors in the rig; nothing for a capture.
    pub(crate) fn servo(&self) -> anyhow::Result<Vec<ServoReport>> {
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
        match self.source {
            Source::Session { .. } => "the session",
            Source::Capture(_) => "a capture",
        }
    }

    /// The trajectory that it holds itself.
    pub(crate) fn own_trajectory(&self) -> anyhow::Result<Option<Trajectory>> {
        match &self.source {
            Source::Session { session, .. } => Ok(session.trajectory()?),
            Source::Capture(_) => Ok(None),
        }
    }

    /// Every frame.
    pub(crate) fn feed(&self, take: &mut dyn FnMut(MountedFrame<'_>)) -> anyhow::Result<PassSummary> {
        match &self.source {
            Source::Session { session, tilts, calibrations } => {
                let stage = Stage::begin("going through the session");
                feed_session(&MountedSession { session, rig: &self.rig, tilts, calibrations }, &stage, take)
            }
            Source::Capture(recording) => feed_capture(recording, &self.rig, take),
        }
    }

    /// An even share of its returns, `most` at most, on its own clock.
    pub(crate) fn rays(&self, most: usize) -> anyhow::Result<RaySample> {
        let mut sensors = self.rig.sensors.clone();
        let mut sample = Thinning::new(most);
        let pass = self.feed(&mut |mounted_frame| {
            let MountedFrame { sensor, model, frame, .. } = mounted_frame;
            mounted_frame.tell_model(&mut sensors);
            sample.add_frame(sensor, model, &mounted_frame.pitch_or(&sensors[sensor].mount), 0, frame);
        })?;
        Ok(RaySample { rays: Thinning::joined([sample]), sensors, pass })
    }

    /// Times of the first and the last column of any sensor, ns; none where no frame was recorded. Decodes all of it once.
    pub(crate) fn span_ns(&self) -> anyhow::Result<Option<[u64; 2]>> {
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
    pub(crate) fn still(&self) -> anyhow::Result<Trajectory> {
        let [first_ns, last_ns] = self.span_ns()?.context("the recording holds no frame")?;
        Ok(Trajectory::new(vec![(first_ns, Pose::IDENTITY), (last_ns + 1, Pose::IDENTITY)])?)
    }
}
