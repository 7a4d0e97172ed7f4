//! Packets to points.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use sensors::Decoded;
use sensors::router::{Router, Sensor};

use super::document::Document;
use super::error::DecodingError;
use super::output::Output;
use super::placing::Placing;
use super::spec::DecodingSpec;
use crate::recording::mounted::Mounts;
use crate::recording::registered::Registration;
use crate::recording::source::{Recording, RecordingError};
use crate::recording::{sensor_ids, unread};

/// Decodes a recording, and writes what is wanted of it. `notices` are of mounts and trajectory.
pub(crate) fn decode(
    spec: &DecodingSpec,
    recording: &Recording,
    (mounts, registration): (Option<Mounts>, Registration),
    notices: Vec<String>,
    stop: &AtomicBool,
) -> Result<Document, DecodingError> {
    let mut document = Document::default();
    let mut placing = Placing { mounts, registration, recording };
    let mut output = Output::new(spec, recording, spec.file_frame(&placing.registration))?;
    let mut router = recording.router()?;
    let frames = spec.wanted_frames();
    let problem: RefCell<Option<DecodingError>> = RefCell::new(None);
    let (host_time_ns, first_host_ns) = (Cell::new(0), Cell::new(None));
    let (mut ids, mut wanted) = (Vec::new(), BTreeMap::new());
    let mut take = |at: usize, sensor: &Sensor, decoded: Decoded<'_>| {
        first_host_ns.get().into_iter().for_each(|host_ns| placing.registration.begin(host_ns));
        let is_wanted = *wanted
            .entry(at)
            .or_insert_with(|| spec.part.wants(&sensor_ids::next_id(sensor, &mut ids), sensor.serial()));
        if is_wanted
            && let Decoded::Frame(frame) = decoded
            && let Some(model) = sensor.model()
            && let number = document.count_frame(at)
            && frames.unwrap_or_default().contains(number)
            && placing.registration.is_wanted(frame.host_time_ns)
        {
            document.add_frame(at, sensor.timestamp_mode(), model, frame);
            if let Some(output) = &mut output
                && problem.borrow().is_none()
            {
                problem.replace(output.add(at, number, sensor, model, frame, &mut placing).err());
            }
        }
        if is_wanted
            && let Decoded::Imu(sample) = decoded
            && frames.is_none()
            && let Some(output) = &mut output
            && problem.borrow().is_none()
        {
            problem.replace(output.add_imu(at, sensor, sample, host_time_ns.get()).err().map(Into::into));
        }
        document.count_other(at, &decoded);
    };
    let go_on = || match problem.take() {
        _ if stop.load(Ordering::Relaxed) => Err(DecodingError::Interrupted),
        Some(error) => Err(error),
        None => Ok(()),
    };
    let ending = recording.try_each_packet(&mut |packet| {
        host_time_ns.set(packet.host_time_ns);
        first_host_ns.set(first_host_ns.get().or(Some(packet.host_time_ns)));
        router.push(packet, &mut take);
        go_on()
    })?;
    router.finish(&mut take);
    go_on()?;
    recording.ensure_given_fits(&router)?;
    ensure_met(spec, &router)?;
    document.conclude(recording, &router, &ending, &|id, serial| spec.part.wants(id, serial));
    document.add_registration(&placing, notices);
    if document.is_empty() {
        if let Some(damage) = ending.damage {
            return Err(damage.into());
        }
        let why = unread::why_nothing(recording, &router, &ending);
        return Err(RecordingError::NothingRead(why).into());
    }
    document.close(spec, output, &placing.registration)
}

/// Refuses the name of a sensor that the recording does not hold.
fn ensure_met(spec: &DecodingSpec, router: &Router) -> Result<(), DecodingError> {
    let ids = sensor_ids::ids(router);
    let is_met =
        |name: &String| ids.contains(name) || router.sensors().iter().any(|sensor| sensor.serial() == name);
    match spec.part.only.iter().find(|name| !is_met(name)) {
        Some(name) if !ids.is_empty() => {
            Err(DecodingError::UnknownSensor { name: name.clone(), known: ids.join(", ") })
        }
        _ => Ok(()),
    }
}
