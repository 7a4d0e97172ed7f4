//! An even share of the rays of a recording.

use super::{RecordedRay, Thinning};
use crate::recording::RecordingError;
use crate::recording::mounted::{MountedFrame, MountedRecording, PassSummary};
use crate::rig::MountedSensor;

/// Some of the rays of a recording.
pub(crate) struct RaySample {
    /// In order of time.
    pub rays: Vec<RecordedRay>,
    /// The rig's, each with the beams of its packets.
    pub sensors: Vec<MountedSensor>,
    pub pass: PassSummary,
}

impl RaySample {
    /// `most` rays at most, on the recording's own clock.
    pub(crate) fn of(recording: &MountedRecording, most: usize) -> Result<Self, RecordingError> {
        let mut sensors = recording.rig.sensors.clone();
        let mut sample = Thinning::new(most);
        let pass = recording.feed(&mut |mounted_frame| {
            let MountedFrame { sensor, model, frame, .. } = mounted_frame;
            mounted_frame.tell_model(&mut sensors);
            sample.add_frame(sensor, model, &mounted_frame.pitch_or(&sensors[sensor].mount), 0, frame);
        })?;
        Ok(Self { rays: Thinning::joined([sample]), sensors, pass })
    }
}
