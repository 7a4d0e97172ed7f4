//! From the frames of the sensors to that of the files.

use sensors::Frame;
use sensors::router::Sensor;

use crate::base::geometry::Pose;
use crate::recording::export::Cloud;
use crate::recording::mounted::Mounts;
use crate::recording::registered::Registration;
use crate::recording::source::{Recording, RecordingError};

/// How points get into the frame of the files.
pub(super) struct Placing<'a> {
    /// None where they stay in their sensors' frames.
    pub mounts: Option<Mounts>,
    pub registration: Registration,
    pub recording: &'a Recording,
}

impl Placing<'_> {
    /// Moves the points of a frame.
    pub(super) fn apply(
        &mut self,
        at: usize,
        sensor: &Sensor,
        frame: &Frame,
        cloud: &mut Cloud,
    ) -> Result<(), RecordingError> {
        match &mut self.mounts {
            None => self.registration.apply(at, cloud, &|_| Pose::IDENTITY),
            Some(mounts) => {
                let (_, body_from_sensor) = mounts.body_from_sensor(self.recording, at, sensor, frame)?;
                self.registration.apply(at, cloud, &body_from_sensor);
            }
        }
        Ok(())
    }
}
