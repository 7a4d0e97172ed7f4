//! From a session to frames of the rig's sensors, each with the angle that its axis measured.

use sensors::Decoded;
use sensors::ouster::Metadata;
use sensors::router::{AppliesTo, GivenCalibration, Router, Sensor};

use super::beams::Slot;
use super::feed::MountedFrame;
use super::pass_summary::PassSummary;
use super::tilt::TiltHistory;
use crate::base::errors::with_causes;
use crate::recording::source::{RecordingError, look_first};
use crate::recording::{SensorEntry, Session};
use crate::rig::{MountedSensor, NoSlot, Rig};
use crate::simulate::Progress;

/// A session, and what is known of its sensors besides their packets.
pub(crate) struct MountedSession<'a> {
    pub session: &'a Session,
    pub rig: &'a Rig,
    /// What its axes measured; of a sensor that has none, nothing.
    pub tilts: &'a [TiltHistory],
    /// What was typed for its Velodynes.
    pub calibrations: &'a [GivenCalibration],
}

/// Every frame of a session, in the order of its packets; `advance` is called with the bytes of their payloads.
pub(crate) fn feed_session(
    mounted_session: &MountedSession<'_>,
    advance: &dyn Fn(Progress),
    take: &mut dyn FnMut(MountedFrame<'_>),
) -> Result<PassSummary, RecordingError> {
    let MountedSession { session, rig, tilts, .. } = mounted_session;
    let mut pass = PassSummary::of(rig);
    let places = places(session, rig)?;
    let slots: Vec<Slot<'_>> = rig.sensors.iter().map(Slot::of).collect();
    let mut routers = routers(mounted_session, &mut pass.losses);
    learn(session, &places, &mut routers)?;
    for (entry, place) in session.manifest().sensors.iter().zip(&places) {
        if let Some(place) = place {
            pass.sensors[*place].lost = entry.losses.total();
        }
    }
    let mut hand =
        |place: usize, at: usize, sensor: &Sensor, decoded: Decoded<'_>, pass: &mut PassSummary| {
            let Decoded::Frame(frame) = decoded else { return };
            if at != 0 {
                return; // a second Velodyne under this name: its packets are reported below
            }
            let number = pass.count(place, frame);
            let tilt = tilts.get(place).filter(|tilt| tilt.is_measured());
            let pitch = tilt.and_then(|tilt| pass.pitches[place].add(tilt, frame));
            take(MountedFrame { sensor: place, number, model: slots[place].beams(sensor), pitch, frame });
        };
    let mut packets = session.packets()?;
    // what a packet has about it in the file is little
    advance(Progress::Total(std::fs::metadata(session.packets_path()).map_or(0, |file| file.len())));
    while let Some((interface, packet)) = packets.next()? {
        let Some(place) = places[interface] else { continue };
        pass.sensors[place].packets_recorded += 1;
        routers[place].push(&packet, &mut |at, sensor, decoded| hand(place, at, sensor, decoded, &mut pass));
        advance(Progress::Done(packet.payload.len() as u64));
    }
    for (place, (router, slot)) in routers.iter_mut().zip(&slots).enumerate() {
        router.finish(&mut |at, sensor, decoded| hand(place, at, sensor, decoded, &mut pass));
        if let Some(sensor) = router.sensors().first() {
            pass.close(place, sensor, slot)?;
        }
        pass.report_unknown_sources(&rig.sensors[place], router);
        pass.losses.extend(pass.pitches[place].unknown(&rig.sensors[place].name));
    }
    pass.losses.extend(session.problems().iter().cloned());
    pass.losses.extend(packets.contradictions(session.manifest()));
    let is_undecoded = pass.sensors.iter().all(|sensor| sensor.frames == 0)
        && pass.sensors.iter().any(|sensor| sensor.packets_recorded > 0);
    if is_undecoded && pass.faults.is_empty() {
        let (recording, losses) = (session.dir().display().to_string(), pass.losses.join("; "));
        return Err(RecordingError::NothingDecoded { recording, losses });
    }
    Ok(pass)
}

/// Slot in the rig of each sensor of a session, by name; none for auxiliary streams.
fn places(session: &Session, rig: &Rig) -> Result<Vec<Option<usize>>, NoSlot> {
    let manifest = session.manifest();
    let place = |entry: &SensorEntry| {
        if manifest.is_auxiliary(entry) {
            return Ok(None);
        }
        rig.slot(&entry.name).map(Some)
    };
    manifest.sensors.iter().map(place).collect()
}

/// A router per sensor of the rig, which knows what the session says of it: packets of one do not get to another.
/// Metadata that cannot be read are lost, and not the session with them.
fn routers(mounted_session: &MountedSession<'_>, losses: &mut Vec<String>) -> Vec<Router> {
    let router = |mounted: &MountedSensor| {
        let mut router = Router::new();
        match metadata_of(mounted_session.session, &mounted.name) {
            Ok(Some(metadata)) => router.add_ouster(metadata, mounted.name.clone()),
            Ok(None) => {}
            Err(error) => losses.push(format!("{}: its metadata: {}", mounted.name, with_causes(&error))),
        }
        for given in mounted_session.calibrations {
            // what bears a name goes to the sensor of that name, and it alone is here
            let is_its_own = given.applies_to == AppliesTo::Named(mounted.name.clone());
            let applies_to = if is_its_own { AppliesTo::Everyone } else { given.applies_to.clone() };
            router.add_calibration(GivenCalibration { applies_to, ..given.clone() });
        }
        router
    };
    mounted_session.rig.sensors.iter().map(router).collect()
}

fn metadata_of(session: &Session, sensor: &str) -> Result<Option<Metadata>, RecordingError> {
    let Some(text) = session.metadata(sensor)? else { return Ok(None) };
    Ok(Some(Metadata::parse(&text, sensor)?))
}

/// Shows the first packets to the routers before any is decoded, as those of a capture are.
fn learn(session: &Session, places: &[Option<usize>], routers: &mut [Router]) -> Result<(), RecordingError> {
    let mut packets = session.packets()?;
    let mut is_left: Vec<bool> = (0..routers.len()).map(|place| places.contains(&Some(place))).collect();
    look_first(|| {
        let (interface, packet) = packets.next().ok()??;
        if let Some(place) = places[interface] {
            is_left[place] = !routers[place].learn(&packet);
        }
        Some(!is_left.contains(&true))
    });
    Ok(())
}
