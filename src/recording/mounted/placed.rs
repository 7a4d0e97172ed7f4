//! One pass over the frames of a recording, each with the pose of its sensor on the body.

use sensors::router::Sensor;
use sensors::{Decoded, Frame, SensorModel};

use super::mounts::Mounts;
use crate::base::geometry::Pose;
use crate::recording::source::{Ending, Recording, RecordingError};

/// A frame of a recording and where its sensor sat.
pub(crate) struct PlacedFrame<'a> {
    /// Place of the sensor in the recording's router, and in the rig.
    pub at: usize,
    pub slot: usize,
    pub sensor: &'a Sensor,
    pub model: &'a SensorModel,
    pub body_from_sensor: &'a dyn Fn(u64) -> Pose,
    pub frame: &'a Frame,
}

/// Every frame of a recording, in the order of its packets.
pub(crate) fn each_frame<E: From<RecordingError>>(
    recording: &Recording,
    mounts: &mut Mounts,
    take: &mut dyn FnMut(PlacedFrame<'_>) -> Result<(), E>,
) -> Result<Ending, E> {
    let mut router = recording.router()?;
    let problem = std::cell::RefCell::new(None);
    let mut hand = |at: usize, sensor: &Sensor, decoded: Decoded<'_>| {
        let (Decoded::Frame(frame), Some(model)) = (decoded, sensor.model()) else { return };
        let mounted = mounts.body_from_sensor(recording, at, sensor, frame);
        let done = mounted.map_err(E::from).and_then(|(slot, body_from_sensor)| {
            take(PlacedFrame { at, slot, sensor, model, body_from_sensor: &body_from_sensor, frame })
        });
        if let Err(error) = done {
            problem.borrow_mut().get_or_insert(error);
        }
    };
    let go_on = || problem.take().map_or(Ok(()), Err);
    let ending = recording.try_each_packet(&mut |packet| {
        router.push(packet, &mut hand);
        go_on()
    })?;
    router.finish(&mut hand);
    go_on()?;
    mounts.begin_pass(); // the next one
    Ok(ending)
}

/// Middles of the revolutions of the first sensor, on its clock, ns.
pub(crate) fn revolutions_ns(recording: &Recording, mounts: &mut Mounts) -> Result<Vec<u64>, RecordingError> {
    let mut middles_ns = Vec::new();
    each_frame(recording, mounts, &mut |mounted| {
        let span_ns = mounted.frame.time_span_ns().filter(|_| mounted.at == 0);
        middles_ns.extend(span_ns.map(|[first_ns, last_ns]| first_ns + (last_ns - first_ns) / 2));
        Ok::<(), RecordingError>(())
    })?;
    Ok(middles_ns)
}
