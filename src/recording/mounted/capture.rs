//! From a capture to frames of the rig's sensors.

use sensors::Decoded;
use sensors::router::{Router, Sensor, Unclaimed};

use super::beams::Slot;
use super::feed::MountedFrame;
use super::pass_summary::{PassSummary, metadata_of_another_unit};
use crate::recording::fault::Fault;
use crate::recording::source::{Ending, Recording, RecordingError};
use crate::recording::unread;
use crate::rig::{MountedSensor, Rig};

/// Every frame of a capture. Sensors take their slots in the order of the mount file: Ousters in the order of their
/// metadata, Velodynes as they first appear.
pub(crate) fn feed_capture(
    recording: &Recording,
    rig: &Rig,
    take: &mut dyn FnMut(MountedFrame<'_>),
) -> Result<PassSummary, RecordingError> {
    let mut router = recording.router()?;
    let mut pass = PassSummary::of(rig);
    let slots: Vec<Slot<'_>> = rig.sensors.iter().map(Slot::of).collect();
    let mut crowd = 0;
    let mut hand = |at: usize, sensor: &Sensor, decoded: Decoded<'_>| {
        let Decoded::Frame(frame) = decoded else { return };
        let at = recording.slot_of(sensor, rig).unwrap_or(at);
        if at >= rig.sensors.len() {
            crowd = crowd.max(at + 1);
            return;
        }
        let number = pass.count(at, frame);
        take(MountedFrame { sensor: at, number, model: slots[at].beams(sensor), pitch: None, frame });
    };
    let ending = recording.each_packet(&mut |packet| {
        router.push(packet, &mut hand);
    })?;
    router.finish(&mut hand);
    if crowd > 0 {
        let (recording, named) = (recording.name(), rig.sensors.len());
        return Err(RecordingError::MoreThanNamed { recording, found: crowd, named });
    }
    for (at, sensor) in router.sensors().iter().enumerate().take(rig.sensors.len()) {
        let at = recording.slot_of(sensor, rig).unwrap_or(at);
        pass.sensors[at].packets_recorded = sensor.stats().packets;
        pass.close(at, sensor, &slots[at])?; // a calibration that does not fit is reported by the sensor's slot
    }
    recording.ensure_given_fits(&router)?;
    pass.losses.extend(ending.losses());
    pass.add_other_units(recording, rig, &router, &ending)?;
    Ok(pass)
}

impl PassSummary {
    /// Packets of units without metadata, where a sensor has no frame.
    fn add_other_units(
        &mut self,
        recording: &Recording,
        rig: &Rig,
        router: &Router,
        ending: &Ending,
    ) -> Result<(), RecordingError> {
        let mut other_units =
            router.unclaimed().filter(|entry| entry.needs_metadata && entry.serial.is_some());
        if self.sensors.iter().all(|sensor| sensor.frames == 0) {
            let Some(entry) = other_units.next().filter(|_| !router.sensors().is_empty()) else {
                let why = unread::why_nothing(recording, router, ending);
                return Err(RecordingError::NothingRead(why));
            };
            self.faults.push(metadata_of_another_unit(&rig.sensors[0], &entry.reason));
            return Ok(());
        }
        for entry in other_units {
            let Some(at) = self.sensors.iter().position(|summary| summary.frames == 0) else { continue };
            self.faults.push(match at < router.sensors().len() {
                true => metadata_of_another_unit(&rig.sensors[at], &entry.reason),
                false => without_metadata(&rig.sensors[at], entry),
            });
        }
        Ok(())
    }
}

fn without_metadata(sensor: &MountedSensor, entry: &Unclaimed) -> Fault {
    let (name, packets, reason) = (&sensor.name, entry.packets, &entry.reason);
    let words = format!("{name}: no packets decoded; {packets} packets are unassigned: {reason}");
    Fault::new("metadata_missing", vec![name.clone()], words)
}
