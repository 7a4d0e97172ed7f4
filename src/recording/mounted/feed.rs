//! A frame of a recording with the mount and the measured pitch of its sensor.

use sensors::{Frame, SensorModel};

use super::tilt::FramePitch;
use crate::base::geometry::Pose;
use crate::rig::{Mount, MountedSensor};

/// A frame with its mount.
pub(crate) struct MountedFrame<'a> {
    /// Sensor of the rig.
    pub sensor: usize,
    /// Number of the frame among those of its sensor.
    pub number: u64,
    pub model: &'a SensorModel,
    /// What its axis measured meanwhile, where it has one.
    pub pitch: Option<FramePitch>,
    pub frame: &'a Frame,
}

impl MountedFrame<'_> {
    /// Its pitch: as measured, otherwise the nominal one.
    pub(crate) fn pitch_or(&self, nominal: &Mount) -> FramePitch {
        self.pitch.unwrap_or(FramePitch::constant(nominal.pitch_rad))
    }

    /// Where it sat on the body at each time of its sensor's clock, the nominal mount but for the pitch.
    pub(crate) fn body_from_sensor(&self, nominal: &Mount) -> impl Fn(u64) -> Pose + use<> {
        body_from_sensor_over(*nominal, self.pitch_or(nominal))
    }

    /// Gives the rig's sensor the beams of its packets.
    pub(crate) fn tell_model(&self, sensors: &mut [MountedSensor]) {
        let known = &mut sensors[self.sensor].model;
        if known != self.model {
            *known = self.model.clone();
        }
    }
}

/// Where a sensor sits on the body at each time of its clock, ns: as its mount says, but for the pitch.
pub(crate) fn body_from_sensor_over(nominal: Mount, pitch: FramePitch) -> impl Fn(u64) -> Pose + use<> {
    // most axes stand
    let standing = Mount { pitch_rad: pitch.mean_rad(), ..nominal }.body_from_sensor();
    move |device_ns| match pitch.is_constant() {
        true => standing,
        false => Mount { pitch_rad: pitch.at(device_ns), ..nominal }.body_from_sensor(),
    }
}
