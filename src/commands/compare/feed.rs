//! From a session or a capture to frames of the rig's sensors, each with the angle that its axis measured.

use sensors::ouster::{Metadata, OusterDecoder};
use sensors::router::Family;
use sensors::velodyne::{Options, VelodyneDecoder};
use sensors::{Decoded, Decoder, Frame, SensorModel};
use serde::Serialize;

use super::beams::Seat;
use crate::commands::recording::Recording;
use crate::commands::unread;
use crate::compare::{Fault, TiltHistory, TiltReading};
use crate::record::{SensorEntry, Session};
use crate::rig::{MountedSensor, NoSeat, Rig};
use crate::servo::ServoReport;

/// One sensor's packets.
#[derive(Debug, Default, Serialize)]
pub struct SensorSummary {
    pub sensor: String,
    /// By the demo's mock sensors; 0 where nobody knows.
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

/// One servo axis.
#[derive(Debug, Serialize)]
pub struct AxisSummary {
    pub sensor: String,
    pub target_pitch_deg: f64,
    /// Mean of what the axis measured while recording.
    pub measured_pitch_deg: f64,
    /// Greatest minus least of it.
    pub measured_span_deg: f64,
    pub reports: usize,
}

/// A frame on its way to be compared.
pub struct Taken<'a> {
    /// Sensor of the rig.
    pub sensor: usize,
    /// Number of the frame among those of its sensor.
    pub number: u64,
    pub model: &'a SensorModel,
    /// What its axis measured, where it has one.
    pub pitch_rad: Option<f64>,
    pub frame: &'a Frame,
}

impl Taken<'_> {
    /// Gives the rig's sensor the beams of its packets.
    pub fn tell_model(&self, sensors: &mut [MountedSensor]) {
        let known = &mut sensors[self.sensor].model;
        if known != self.model {
            *known = self.model.clone();
        }
    }
}

/// How a pass over a recording ended.
#[derive(Default)]
pub struct Fed {
    pub sensors: Vec<SensorSummary>,
    /// Data that is missing, in words.
    pub losses: Vec<String>,
    pub faults: Vec<Fault>,
    /// Longest revolution, ns.
    pub revolution_ns: u64,
}

impl Fed {
    fn of(rig: &Rig) -> Self {
        let named = |sensor: &MountedSensor| SensorSummary {
            sensor: sensor.name.clone(),
            ..SensorSummary::default()
        };
        Self { sensors: rig.sensors.iter().map(named).collect(), ..Self::default() }
    }

    fn count(&mut self, sensor: usize, frame: &Frame) -> u64 {
        let summary = &mut self.sensors[sensor];
        summary.frames += 1;
        summary.points += frame.first.points() as u64;
        if frame.azimuth_rate_rad_per_ns > 0.0 {
            let turn_ns = std::f64::consts::TAU / frame.azimuth_rate_rad_per_ns;
            self.revolution_ns = self.revolution_ns.max(turn_ns.round() as u64);
        }
        summary.frames - 1
    }
}

/// Every frame of a session, in the order of its packets.
pub fn session(
    session: &Session,
    rig: &Rig,
    tilts: &[TiltHistory],
    progress: &mut dyn FnMut(u64),
    take: &mut dyn FnMut(Taken<'_>),
) -> anyhow::Result<Fed> {
    let mut fed = Fed::of(rig);
    let seats = seats(session, rig)?;
    let mut heard = heard(session, rig)?;
    for (entry, seat) in session.manifest().sensors.iter().zip(&seats) {
        if let Some(seat) = seat {
            fed.sensors[*seat].lost = entry.losses.total();
        }
    }
    let mut hand = |sensor: usize, model: &SensorModel, frame: &Frame, fed: &mut Fed| {
        let number = fed.count(sensor, frame);
        let [first_ns, last_ns] = frame.host_time_ns;
        let middle_ns = first_ns + last_ns.saturating_sub(first_ns) / 2;
        let pitch_rad = tilts.get(sensor).and_then(|tilt| tilt.pitch_rad_at(middle_ns));
        take(Taken { sensor, number, model, pitch_rad, frame });
    };
    let mut packets = session.packets()?;
    let mut bytes = 0;
    while let Some((interface, packet)) = packets.next()? {
        let Some(sensor) = seats[interface] else { continue };
        fed.sensors[sensor].packets_recorded += 1;
        bytes += packet.payload.len() as u64;
        // what a decoder refuses it has counted
        let _ = heard[sensor].decoder.take(&packet);
        heard[sensor].hand_out(&mut |model, frame| hand(sensor, model, frame, &mut fed));
        progress(bytes);
    }
    for (sensor, heard) in heard.iter_mut().enumerate() {
        heard.decoder.end();
        heard.hand_out(&mut |model, frame| hand(sensor, model, frame, &mut fed));
        let stats = heard.decoder.stats();
        let summary = &mut fed.sensors[sensor];
        summary.lost += stats.lost_packets + stats.malformed + stats.crc_errors + stats.late;
        summary.complete_frames = stats.complete_frames;
        fed.losses.extend(unread::sensor_losses(&summary.sensor, stats));
        if stats.packets == 0 && summary.packets_recorded > 0 {
            fed.faults
                .push(foreign(&rig.sensors[sensor], "its packets bear another serial number or format"));
        }
        let model = heard.decoder.model().filter(|_| stats.packets > 0);
        fed.faults.extend(model.and_then(|model| {
            heard.seat.wrong_model(heard.product.as_deref().unwrap_or(&model.name), model)
        }));
    }
    fed.losses.extend(session.problems().iter().cloned());
    Ok(fed)
}

/// Place in the rig of each sensor of a session, by name; none for what sensors send beside their lidar packets.
fn seats(session: &Session, rig: &Rig) -> Result<Vec<Option<usize>>, NoSeat> {
    let manifest = session.manifest();
    let seat = |entry: &SensorEntry| {
        if manifest.is_aside(entry) {
            return Ok(None);
        }
        rig.seat(&entry.name).map(Some)
    };
    manifest.sensors.iter().map(seat).collect()
}

/// One sensor of a session on its way to frames.
struct Heard<'a> {
    seat: Seat<'a>,
    decoder: Box<dyn Decoder>,
    /// As its metadata say; none for a Velodyne.
    product: Option<String>,
}

impl Heard<'_> {
    /// Hands out every frame that is complete.
    fn hand_out(&mut self, take: &mut dyn FnMut(&SensorModel, &Frame)) {
        while self.decoder.completed_mut().advance() {
            if let (Some(Decoded::Frame(frame)), Some(found)) =
                (self.decoder.completed().current(), self.decoder.model())
            {
                take(if self.product.is_some() { found } else { self.seat.beams(found) }, frame);
            }
        }
    }
}

/// A decoder per sensor of the rig.
fn heard<'a>(session: &Session, rig: &'a Rig) -> anyhow::Result<Vec<Heard<'a>>> {
    let heard = |mounted: &'a MountedSensor| -> anyhow::Result<Heard<'a>> {
        let Some(text) = session.metadata(&mounted.name)? else {
            let decoder = Box::new(VelodyneDecoder::new(Options::default()));
            return Ok(Heard { seat: Seat::of(mounted), decoder, product: None });
        };
        let metadata = Metadata::parse(&text, &mounted.name)?;
        let product = Some(metadata.product());
        Ok(Heard { seat: Seat::of(mounted), decoder: Box::new(OusterDecoder::new(metadata)), product })
    };
    rig.sensors.iter().map(heard).collect()
}

/// What the axes of a session measured; nothing where it holds no reports.
pub fn tilts(session: &Session, rig: &Rig) -> anyhow::Result<(Vec<TiltHistory>, Vec<AxisSummary>)> {
    let reports: Vec<ServoReport> = session.servo()?;
    let (mut tilts, mut axes) = (Vec::new(), Vec::new());
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let rad = |urad: i32| f64::from(urad) * 1e-6;
        let measured: Vec<TiltReading> = reports
            .iter()
            .filter(|report| report.axis == axis && report.source == "measured")
            .map(|report| TiltReading {
                time_ns: report.time_ns,
                pitch_rad: rad(report.position_urad),
                uncertainty_rad: report.uncertainty_urad.map(rad),
                held_rad: (report.state == "holding").then(|| rad(report.target_urad)),
            })
            .collect();
        let count = measured.len();
        let sum: f64 = measured.iter().map(|reading| reading.pitch_rad).sum();
        let tilt = TiltHistory::new(measured);
        if let Some([least, greatest]) = tilt.span_rad() {
            axes.push(AxisSummary {
                sensor: sensor.name.clone(),
                target_pitch_deg: sensor.mount.pitch_rad.to_degrees(),
                measured_pitch_deg: (sum / count as f64).to_degrees(),
                measured_span_deg: (greatest - least).to_degrees(),
                reports: count,
            });
        }
        tilts.push(tilt);
    }
    Ok((tilts, axes))
}

/// Every frame of a capture. Sensors take their seats in the order of the mount file: Ousters in the order of their
/// metadata, Velodynes as they first appear.
pub fn capture(recording: &Recording, rig: &Rig, take: &mut dyn FnMut(Taken<'_>)) -> anyhow::Result<Fed> {
    let mut router = recording.router()?;
    let mut fed = Fed::of(rig);
    let seats: Vec<Seat<'_>> = rig.sensors.iter().map(Seat::of).collect();
    let mut crowd = 0;
    let mut hand = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        let Decoded::Frame(frame) = decoded else { return };
        if at >= rig.sensors.len() {
            crowd = crowd.max(at + 1);
            return;
        }
        let found = sensor.model().unwrap_or(&rig.sensors[at].model);
        // what was typed counts more than what the mount file names
        let is_open = matches!(sensor.family(), Family::Velodyne(_)) && !sensor.is_calibrated();
        let model = if is_open { seats[at].beams(found) } else { found };
        let number = fed.count(at, frame);
        take(Taken { sensor: at, number, model, pitch_rad: None, frame });
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
    for ((sensor, mounted), seat) in router.sensors().iter().zip(&rig.sensors).zip(&seats) {
        let stats = sensor.stats();
        let summary = fed.sensors.iter_mut().find(|summary| summary.sensor == mounted.name);
        let Some(summary) = summary else { continue };
        summary.packets_recorded = stats.packets;
        summary.lost = stats.lost_packets + stats.malformed + stats.crc_errors + stats.late;
        summary.complete_frames = stats.complete_frames;
        fed.losses.extend(unread::sensor_losses(&mounted.name, stats));
        fed.faults.extend(sensor.model().and_then(|model| seat.wrong_model(&sensor.product(), model)));
    }
    fed.losses.extend(ending.losses());
    if fed.sensors.iter().all(|sensor| sensor.frames == 0) {
        let other_unit = router.unclaimed().find(|entry| entry.needs_metadata && entry.serial.is_some());
        match other_unit {
            Some(entry) if !router.sensors().is_empty() => {
                fed.faults.push(foreign(&rig.sensors[0], &entry.reason));
            }
            _ => anyhow::bail!("{}", unread::why_nothing(recording, &router, &ending)),
        }
    } else {
        for entry in router.unclaimed().filter(|entry| entry.needs_metadata && entry.serial.is_some()) {
            let silent = rig.sensors.iter().zip(&fed.sensors).find(|(_, summary)| summary.frames == 0);
            fed.faults.extend(silent.map(|(sensor, _)| foreign(sensor, &entry.reason)));
        }
    }
    Ok(fed)
}

fn foreign(sensor: &MountedSensor, reason: &str) -> Fault {
    Fault {
        name: "metadata_of_another_unit",
        sensors: vec![sensor.name.clone()],
        words: format!("the metadata given for {} belong to another unit: {reason}", sensor.name),
        agree_share: None,
        explained_share: None,
    }
}
