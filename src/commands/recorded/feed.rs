//! From a session or a capture to frames of the rig's sensors, each with the angle that its axis measured.

use sensors::ouster::Metadata;
use sensors::router::{AppliesTo, GivenCalibration, Router, Sensor, Unclaimed};
use sensors::{Decoded, Frame, SensorModel};
use serde::Serialize;

use super::axes::Pitches;
use super::beams::Slot;
use super::data_gaps::DataSpan;
use crate::base::geometry::Pose;
use crate::commands::recording::{Recording, look_first};
use crate::commands::stage::Stage;
use crate::commands::unread;
use crate::recording::{SensorEntry, Session};
use crate::rig::{Mount, MountedSensor, NoSlot, Rig};
use crate::verify::compare::{Fault, FramePitch, TiltHistory};

/// One sensor's packets.
#[derive(Debug, Default, Serialize)]
pub struct SensorSummary {
    pub sensor: String,
    /// By the demo's mock sensors; 0 where unknown.
    #[serde(skip_serializing_if = "is_zero")]
    pub packets_sent: u64,
    pub packets_recorded: u64,
    /// Losses of every kind, kernel and queue and decoder.
    pub lost: u64,
    pub frames: u64,
    pub complete_frames: u64,
    pub points: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for it")]
fn is_zero(value: &u64) -> bool {
    *value == 0
}

/// A frame with its mount.
pub struct MountedFrame<'a> {
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
    /// Its pitch: as measured, otherwise as the mount file says.
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

/// How a pass over a recording ended.
#[derive(Default)]
pub struct PassSummary {
    pub sensors: Vec<SensorSummary>,
    /// Data that is missing, in words.
    pub losses: Vec<String>,
    pub faults: Vec<Fault>,
    /// Longest revolution, ns.
    pub revolution_ns: u64,
    /// When each of the rig's sensors was.
    pub data_spans: Vec<DataSpan>,
    /// Angles of each of the rig's axes at the times of its sensor's frames.
    pub pitches: Vec<Pitches>,
}

impl PassSummary {
    fn of(rig: &Rig) -> Self {
        let named = |sensor: &MountedSensor| SensorSummary {
            sensor: sensor.name.clone(),
            ..SensorSummary::default()
        };
        let data_spans = vec![DataSpan::default(); rig.sensors.len()];
        let pitches = vec![Pitches::default(); rig.sensors.len()];
        Self { sensors: rig.sensors.iter().map(named).collect(), data_spans, pitches, ..Self::default() }
    }

    fn count(&mut self, sensor: usize, frame: &Frame) -> u64 {
        let summary = &mut self.sensors[sensor];
        summary.frames += 1;
        frame.time_span_ns().into_iter().for_each(|span_ns| self.data_spans[sensor].add(span_ns));
        summary.points += frame.first.points() as u64;
        if frame.azimuth_rate_rad_per_ns > 0.0 {
            let turn_ns = std::f64::consts::TAU / frame.azimuth_rate_rad_per_ns;
            self.revolution_ns = self.revolution_ns.max(turn_ns.round() as u64);
        }
        summary.frames - 1
    }

    /// Takes over what the decoder of a sensor counted, and looks whether it is the sensor that the mount file names.
    fn close(&mut self, place: usize, sensor: &Sensor, slot: &Slot<'_>) -> anyhow::Result<()> {
        let stats = sensor.stats();
        let summary = &mut self.sensors[place];
        if let Some((name, error)) = sensor.calibration_error() {
            anyhow::bail!("{name}, given for {}, a {}: {error}", summary.sensor, sensor.product());
        }
        summary.lost += stats.lost_packets + stats.malformed + stats.crc_errors + stats.late;
        summary.complete_frames = stats.complete_frames;
        self.losses.extend(unread::sensor_losses(&summary.sensor, sensor));
        let model = sensor.model().filter(|_| stats.packets > 0);
        self.faults.extend(model.and_then(|model| slot.wrong_model(&sensor.product(), model)));
        Ok(())
    }

    /// What came to a sensor's port and is not its own: packets of a second sensor, and those that no sensor claims. Where
    /// all are such, the metadata belong to another unit.
    fn report_unknown_sources(&mut self, mounted: &MountedSensor, router: &Router) {
        let sensors = router.sensors();
        for other in sensors.iter().skip(1) {
            let (packets, source) = (other.stats().packets, other.source());
            let from = source.map_or(String::new(), |source| format!(", from {source}"));
            self.losses.push(format!("{}: {packets} packets of a second sensor{from}", mounted.name));
        }
        // two units of one serial number are among its decoder's losses
        let two_sources = sensors.first().and_then(Sensor::two_sources);
        let is_left =
            |entry: &&Unclaimed| entry.is_sensor_data && Some(&entry.reason) != two_sources.as_ref();
        let left: Vec<&Unclaimed> = router.unclaimed().filter(is_left).collect();
        let is_silent = sensors.first().is_some_and(|sensor| sensor.stats().packets == 0);
        match left.first() {
            Some(first) if is_silent => self.faults.push(foreign(mounted, &first.reason)),
            _ => self.losses.extend(left.iter().map(|entry| {
                let Unclaimed { packets, length, reason, .. } = entry;
                format!("{}: {packets} packets of {length} bytes are not its own: {reason}", mounted.name)
            })),
        }
    }
}

/// A session, and what is known of its sensors besides their packets.
pub struct MountedSession<'a> {
    pub session: &'a Session,
    pub rig: &'a Rig,
    /// What its axes measured; of a sensor that has none, nothing.
    pub tilts: &'a [TiltHistory],
    /// What was typed for its Velodynes.
    pub calibrations: &'a [GivenCalibration],
}

/// Every frame of a session, in the order of its packets.
pub(crate) fn session(
    mounted_session: &MountedSession<'_>,
    stage: &Stage,
    take: &mut dyn FnMut(MountedFrame<'_>),
) -> anyhow::Result<PassSummary> {
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
    stage.counts(std::fs::metadata(session.packets_path()).map_or(0, |file| file.len()), 0);
    while let Some((interface, packet)) = packets.next()? {
        let Some(place) = places[interface] else { continue };
        pass.sensors[place].packets_recorded += 1;
        routers[place].push(&packet, &mut |at, sensor, decoded| hand(place, at, sensor, decoded, &mut pass));
        stage.more(packet.payload.len() as u64);
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
    anyhow::ensure!(
        !is_undecoded || !pass.faults.is_empty(),
        "{}: no LiDAR data was decoded: {}",
        session.dir().display(),
        pass.losses.join("; ")
    );
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
            Err(error) => losses.push(format!("{}: its metadata: {error:#}", mounted.name)),
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

fn metadata_of(session: &Session, sensor: &str) -> anyhow::Result<Option<Metadata>> {
    let Some(text) = session.metadata(sensor)? else { return Ok(None) };
    Ok(Some(Metadata::parse(&text, sensor)?))
}

/// Shows the first packets to the routers before any is decoded, as those of a capture are.
fn learn(session: &Session, places: &[Option<usize>], routers: &mut [Router]) -> anyhow::Result<()> {
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

/// Every frame of a capture. Sensors take their slots in the order of the mount file: Ousters in the order of their
/// metadata, Velodynes as they first appear.
pub(crate) fn capture(
    recording: &Recording,
    rig: &Rig,
    take: &mut dyn FnMut(MountedFrame<'_>),
) -> anyhow::Result<PassSummary> {
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
        Ok(())
    })?;
    router.finish(&mut hand);
    anyhow::ensure!(
        crowd == 0,
        "{} holds {crowd} sensors, the mount file names {}",
        recording.name(),
        rig.sensors.len()
    );
    for (at, sensor) in router.sensors().iter().enumerate().take(rig.sensors.len()) {
        let at = recording.slot_of(sensor, rig).unwrap_or(at);
        pass.sensors[at].packets_recorded = sensor.stats().packets;
        pass.close(at, sensor, &slots[at])?; // a calibration that does not fit is reported by the sensor's slot
    }
    recording.ensure_given_fits(&router)?;
    pass.losses.extend(ending.losses());
    if pass.sensors.iter().all(|sensor| sensor.frames == 0) {
        let other_unit = router.unclaimed().find(|entry| entry.needs_metadata && entry.serial.is_some());
        match other_unit {
            Some(entry) if !router.sensors().is_empty() => {
                pass.faults.push(foreign(&rig.sensors[0], &entry.reason));
            }
            _ => anyhow::bail!("{}", unread::why_nothing(recording, &router, &ending)),
        }
    } else {
        for entry in router.unclaimed().filter(|entry| entry.needs_metadata && entry.serial.is_some()) {
            let silent = pass.sensors.iter().position(|summary| summary.frames == 0);
            let tell = |at: usize| match at < router.sensors().len() {
                true => foreign(&rig.sensors[at], &entry.reason),
                false => without_metadata(&rig.sensors[at], entry),
            };
            pass.faults.extend(silent.map(tell));
        }
    }
    Ok(pass)
}

fn without_metadata(sensor: &MountedSensor, entry: &Unclaimed) -> Fault {
    let (name, packets, reason) = (&sensor.name, entry.packets, &entry.reason);
    let words = format!("{name}: no packets decoded; {packets} packets are unassigned: {reason}");
    Fault::new("metadata_missing", vec![name.clone()], words)
}

fn foreign(sensor: &MountedSensor, reason: &str) -> Fault {
    let words = format!("the metadata given for {} belong to another unit: {reason}", sensor.name);
    Fault::new("metadata_of_another_unit", vec![sensor.name.clone()], words)
}
