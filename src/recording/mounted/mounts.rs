//! Where the sensors of a recording sit: by a mount file, the session's own, or the static transforms of a bag.

use std::path::Path;

use sensors::Frame;
use sensors::router::Sensor;

use super::axes::{Tilts, tilts};
use super::axis_zeros::AxisZeros;
use super::feed::body_from_sensor_over;
use super::found_mount;
use super::pitches::Pitches;
use super::tilt::{FramePitch, TiltHistory};
use crate::base::geometry::Pose;
use crate::recording::source::{Recording, RecordingError};
use crate::rig::{MountFile, Rig};

/// Where a sensor sat on the body at a time of its clock, ns.
type BodyFromSensor = Box<dyn Fn(u64) -> Pose>;

/// Mounts of the sensors, and what their axes measured.
pub(crate) struct Mounts {
    /// None where nothing says it: the only sensor is the body.
    rig: Option<Rig>,
    tilts: Vec<TiltHistory>,
    pitches: Vec<Pitches>,
    /// What the user should know of them.
    pub notices: Vec<String>,
}

impl Mounts {
    /// As `--mount` says, or the recording itself.
    pub(crate) fn of(
        recording: &Recording,
        mount: Option<&Path>,
        zeros: &AxisZeros,
    ) -> Result<Self, RecordingError> {
        let session = recording.checked_session();
        let mut notices = Vec::new();
        let file = match (mount, &session) {
            (Some(path), _) => Some(MountFile::read(path)?),
            (None, Some(session)) => session.mount()?,
            (None, None) => found_mount::of_bag(recording, &mut notices)?,
        };
        let rig = file.map(|file| file.rig()).transpose()?;
        let mut measured = Tilts::default();
        if let (Some(session), Some(rig)) = (&session, &rig) {
            measured = tilts(session, rig, zeros)?;
        }
        notices.extend(measured.notices);
        if rig.is_none() {
            notices.push(
                "no mount is known: the sensor's frame is used as the rig's (--mount names another)".into(),
            );
        }
        let pitches = vec![Pitches::default(); measured.histories.len()];
        Ok(Self { rig, tilts: measured.histories, pitches, notices })
    }

    /// Forgets what a pass over the recording has counted.
    pub(super) fn begin_pass(&mut self) {
        self.pitches.iter_mut().for_each(|pitches| *pitches = Pitches::default());
    }

    /// How many sensors there are on the rig.
    pub(crate) fn sensors(&self) -> usize {
        self.rig.as_ref().map_or(1, |rig| rig.sensors.len())
    }

    /// Slot of a sensor of the recording, and where it sat on the body at a time of its clock while it measured a frame.
    pub(crate) fn body_from_sensor(
        &mut self,
        recording: &Recording,
        at: usize,
        sensor: &Sensor,
        frame: &Frame,
    ) -> Result<(usize, BodyFromSensor), RecordingError> {
        let Some(rig) = &self.rig else {
            if at > 0 {
                let (recording, notices) = (recording.name(), self.notices.join("; "));
                return Err(RecordingError::SeveralWithoutMount { recording, notices });
            }
            return Ok((0, Box::new(|_| Pose::IDENTITY)));
        };
        let by_name = || sensor.name.as_deref().and_then(|name| rig.slot(name).ok());
        let slot = recording.slot_of(sensor, rig).or_else(by_name).unwrap_or(at);
        let Some(mounted) = rig.sensors.get(slot) else {
            let (recording, named) = (recording.name(), rig.sensors.len());
            return Err(RecordingError::MoreThanMounted { recording, named });
        };
        let measured = self.tilts.get(slot).filter(|tilt| tilt.is_measured());
        let pitch = measured.and_then(|tilt| self.pitches[slot].add(tilt, frame));
        let pitch = pitch.unwrap_or(FramePitch::constant(mounted.mount.pitch_rad));
        Ok((slot, Box::new(body_from_sensor_over(mounted.mount, pitch))))
    }

    /// Whether something says where the sensors sit.
    pub(crate) fn is_known(&self) -> bool {
        self.rig.is_some()
    }

    /// Whether an axis was measured that moves a sensor on the rig.
    pub(crate) fn is_moved(&self, slot: usize) -> bool {
        self.tilts.get(slot).is_some_and(TiltHistory::is_measured)
    }

    /// Frames with no measurement of their axis near them, in words.
    pub(crate) fn losses(&self) -> Vec<String> {
        let sensors = self.rig.iter().flat_map(|rig| &rig.sensors);
        sensors.zip(&self.pitches).filter_map(|(sensor, pitches)| pitches.unknown(&sensor.name)).collect()
    }
}
