//! Which packet belongs to which sensor.
//!
//! Ouster sensors are known from their metadata and take what carries their serial number, or, where packets carry
//! none, what fits in size, sender and port. Velodyne sensors are found in the data: one per sender and port. Packets
//! that no sensor takes are counted by port and length, with the reason and what would help.

mod ahead;
mod explain;
mod guess;
mod merged;
mod paths;
mod senders;
mod sensor;
mod streams;
#[cfg(test)]
mod tests;
mod source_filter;
mod velodynes;

use std::collections::BTreeMap;
use std::net::IpAddr;

use crate::ouster::{Claim, Metadata, OusterDecoder};
use crate::velodyne::wire::DATA_PACKET_BYTES;
use crate::{Decoded, Packet, Rejected};

pub use guess::Guess;
pub use senders::Rival;
pub use sensor::{AppliesTo, Beams, Family, GivenCalibration, GivenModel, Sensor};
pub use source_filter::{Named, SourceFilter};
use streams::{Stream, stream_of};

/// Most Velodyne sensors that are distinguished; a recording with more senders is no rig.
const MOST_SENSORS: usize = 64;
/// Most kinds of unclaimed packets that are counted separately; the rest is counted together under port 0.
const MOST_KINDS: usize = 256;

/// The sensor that claims a packet most surely, and how many claim it as surely.
type Claims = (Option<(usize, Claim)>, usize);

/// Hands packets to decoders.
#[derive(Default)]
pub struct Router {
    sensors: Vec<Sensor>,
    unclaimed: BTreeMap<(u16, usize, Option<u64>), Unclaimed>,
    calibrations: Vec<GivenCalibration>,
    models: Vec<GivenModel>,
    names: Vec<Named>,
    ahead: ahead::Ahead,
    /// Everything was looked at that is looked at before decoding: who was not met is not there, or late.
    has_learned: bool,
    /// Sources of Ouster lidar packets without metadata, found in that look.
    unknown_sources: Vec<IpAddr>,
    /// Where data packets of Velodynes came from and went to.
    velodynes: Vec<Stream>,
}

/// What is counted together where there are more kinds of packets that no sensor took.
const OF_MORE_KINDS: (u16, usize, Option<u64>) = (0, 0, None);

/// Packets of one length, of one serial number where they bear it, on one port that no sensor took.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Unclaimed {
    /// Destination port.
    pub port: u16,
    /// Length of the payload, bytes.
    pub length: usize,
    /// How many.
    pub packets: u64,
    /// Why the first of them was rejected, and what would help.
    pub reason: String,
    /// Someone's sensor data, as far as is known: the loss matters.
    pub is_sensor_data: bool,
    /// Metadata of its sensor would help.
    pub needs_metadata: bool,
    /// An Ouster lidar packet: its length tells the formats that it can have.
    pub is_ouster_lidar: bool,
    /// Serial number in the first of them.
    pub serial: Option<u64>,
}

/// What became of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Routed {
    /// Assigned to the sensor of this number.
    Assigned(usize),
    /// From the sensor of this number, but damaged; its decoder counted it.
    Damaged(usize),
    /// Assigned to no sensor.
    Unclaimed,
}

impl Router {
    /// Without sensors; Velodynes are found.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds the Ouster sensor that metadata describes; `name` is what messages call the metadata.
    pub fn add_ouster(&mut self, metadata: Metadata, name: impl Into<String>) {
        self.add_ouster_from(metadata, name, None);
    }

    /// The same, limited to the packets that a source filter accepts.
    pub fn add_ouster_from(
        &mut self,
        metadata: Metadata,
        name: impl Into<String>,
        source_filter: Option<SourceFilter>,
    ) {
        let decoder = Family::Ouster(Box::new(OusterDecoder::new(metadata)));
        let mut sensor = Sensor::new(decoder, Some(name.into()));
        sensor.source_filter = source_filter;
        sensor.take_name(&self.names);
        self.sensors.push(sensor);
    }

    /// Says how sensors that are added or found later are called.
    pub fn set_names(&mut self, names: Vec<Named>) {
        self.names = names;
    }

    /// Names the product of a Velodyne when its packets do not.
    pub fn add_model(&mut self, model: GivenModel) {
        self.models.push(model);
    }

    /// Adds the calibration of a Velodyne.
    pub fn add_calibration(&mut self, calibration: GivenCalibration) {
        self.calibrations.push(calibration);
    }

    /// Calibrations that no sensor of the recording used, in words.
    pub fn unused_calibrations(&self) -> Vec<String> {
        let takes = |sensor: &Sensor, given: &GivenCalibration| {
            sensor.is_meant(&given.applies_to) && sensor.beams() == Beams::Given(&given.name)
        };
        let is_unused = |given: &&GivenCalibration| !self.sensors.iter().any(|sensor| takes(sensor, given));
        let unused = self.calibrations.iter().filter(is_unused);
        unused.map(|given| explain::unused_calibration(&self.sensors, given)).collect()
    }

    /// All sensors: those of metadata first, then those found, in the order they were found.
    pub fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    /// What no sensor took.
    pub fn unclaimed(&self) -> impl Iterator<Item = &Unclaimed> {
        self.unclaimed.values()
    }

    /// Looks at a packet before decoding begins, to learn where sensors send from (packets without a serial number
    /// are distinguished by that) and what HDL-64Es say of themselves. True when there is nothing left to learn of those
    /// that are known or were met.
    pub fn learn(&mut self, packet: &Packet<'_>) -> bool {
        let claims = self.best_claim(packet);
        match self.merged_bytes(packet, claims) {
            None => self.learn_one(packet, claims),
            Some(bytes) => {
                let parts = packet.payload.chunks(bytes).map(|payload| Packet { payload, ..*packet });
                parts.fold(false, |_, part| self.learn_one(&part, self.best_claim(&part)))
            }
        }
    }

    fn learn_one(&mut self, packet: &Packet<'_>, claims: Claims) -> bool {
        match claims {
            (Some((at, claim)), 1) if is_evidence(claim, packet) => {
                self.sensors[at].note_source(packet);
                self.sensors[at].learn(packet);
            }
            (Some((at, Claim::Named)), _) => self.sensors[at].learn(packet),
            (Some((at, _)), 1) => self.sensors[at].streams.note_imu(packet),
            (None, _) => self.note_unknown_source(packet),
            _ => {}
        }
        self.ahead.read(packet, MOST_SENSORS);
        let is_known =
            |sensor: &Sensor| sensor.source_is_known || !matches!(sensor.family, Family::Ouster(_));
        self.ahead.is_done() && self.sensors.iter().all(is_known)
    }

    /// Ends the look before decoding: packets that name no sensor go to sensors found in it.
    pub fn end_learning(&mut self) {
        self.has_learned = true;
        self.sensors.iter_mut().for_each(Sensor::end_learning);
    }

    /// Hands a packet to its sensor, and what that completes to `out`.
    pub fn push(&mut self, packet: &Packet<'_>, out: &mut dyn FnMut(usize, &Sensor, Decoded<'_>)) -> Routed {
        let claims = self.best_claim(packet);
        let Some(bytes) = self.merged_bytes(packet, claims) else {
            return self.push_one(packet, claims, out);
        };
        let mut routed = Routed::Unclaimed;
        for payload in packet.payload.chunks(bytes) {
            let part = Packet { payload, ..*packet };
            routed = self.push_one(&part, self.best_claim(&part), out);
        }
        routed
    }

    fn push_one(
        &mut self,
        packet: &Packet<'_>,
        claims: Claims,
        out: &mut dyn FnMut(usize, &Sensor, Decoded<'_>),
    ) -> Routed {
        let (at, claim) = match self.find(packet, claims) {
            Ok(found) => found,
            Err(reason) => {
                self.count_unclaimed(packet, reason);
                return Routed::Unclaimed;
            }
        };
        if claim.is_some() && !self.sensors[at].senders.admit(packet) {
            self.count_unclaimed(packet, self.sensors[at].two_sources());
            return Routed::Unclaimed;
        }
        self.push_to(at, claim, packet, out)
    }

    fn push_to(
        &mut self,
        at: usize,
        claim: Option<Claim>,
        packet: &Packet<'_>,
        out: &mut dyn FnMut(usize, &Sensor, Decoded<'_>),
    ) -> Routed {
        let outcome = self.sensors[at].family.decoder_mut().take(packet);
        self.sensors[at].take_name(&self.names);
        self.sensors[at].calibrate(&self.calibrations);
        self.hand_out(at, out);
        match outcome {
            Ok(()) => {
                self.sensors[at].note_packet(packet, claim);
                Routed::Assigned(at)
            }
            Err(Rejected::Foreign { reason }) => {
                if let Some(twin) = self.twin_of(at, packet) {
                    return self.push_to(twin, claim, packet, out);
                }
                self.count_unclaimed(packet, Some(reason));
                Routed::Unclaimed
            }
            Err(problem @ (Rejected::Malformed { .. } | Rejected::Checksum { .. })) => {
                let sensor = &mut self.sensors[at];
                sensor.first_source.get_or_insert(packet.source);
                if let Rejected::Malformed { reason } = problem {
                    sensor.note_damage(packet, reason);
                }
                Routed::Damaged(at)
            }
        }
    }

    /// Ends every sensor's last frame.
    pub fn finish(&mut self, out: &mut dyn FnMut(usize, &Sensor, Decoded<'_>)) {
        for at in 0..self.sensors.len() {
            self.sensors[at].family.decoder_mut().end();
            self.sensors[at].calibrate(&self.calibrations);
            self.hand_out(at, out);
        }
    }

    fn hand_out(&mut self, at: usize, out: &mut dyn FnMut(usize, &Sensor, Decoded<'_>)) {
        let sensor = &mut self.sensors[at];
        while sensor.family.decoder_mut().completed_mut().advance() {
            if let Some(decoded) = sensor.family.decoder().completed().current() {
                out(at, sensor, decoded);
            }
        }
    }

    /// The sensor to try; otherwise the reason, where it is known already.
    fn find(
        &mut self,
        packet: &Packet<'_>,
        claims: Claims,
    ) -> Result<(usize, Option<Claim>), Option<String>> {
        match claims {
            // metadata of one unit as it was set at several times, none of which fits: the first says why
            (Some((at, claim)), count) if count == 1 || claim == Claim::Named => {
                return match claim >= Claim::Named || self.is_its_own(at, packet) {
                    true => Ok((at, Some(claim))),
                    false => Err(Some(explain::of_one_of_several(&self.sensors[at]))),
                };
            }
            (Some(_), count) => return Err(Some(explain::ambiguous(count, packet))),
            (None, _) => {}
        }
        match Guess::of_velodyne(packet.payload) {
            Some(Guess::VelodyneData) => self.velodyne(packet, true).map(|at| (at, None)),
            Some(Guess::VelodynePosition) => self.velodyne(packet, false).map(|at| (at, None)),
            Some(Guess::VelodyneBlocks) if packet.payload.len() < DATA_PACKET_BYTES => {
                let at = self.sensors.iter().position(|sensor| {
                    matches!(sensor.family, Family::Velodyne(_)) && sensor.paths.has(packet)
                });
                at.map(|at| (at, None)).ok_or(None)
            }
            // damaged, perhaps: the sender's decoder knows
            _ => self
                .sensors
                .iter()
                .position(|sensor| {
                    matches!(sensor.family, Family::Ouster(_))
                        && sensor.first_source == Some(packet.source)
                        && !sensor.fits(packet)
                })
                .map(|at| (at, None))
                .ok_or(None),
        }
    }

    /// The Ouster that claims a packet most surely, and how many claim it as surely.
    fn best_claim(&self, packet: &Packet<'_>) -> Claims {
        let (mut best, mut count) = (None, 0);
        for (at, sensor) in self.sensors.iter().enumerate() {
            let claim = sensor.claim(packet);
            match best {
                _ if claim == Claim::No => {}
                Some((_, other)) if claim < other => {}
                Some((_, other)) if claim == other => count += 1,
                _ => (best, count) = (Some((at, claim)), 1),
            }
        }
        match best {
            Some((_, claim)) if !is_evidence(claim, packet) => {
                let met = || self.has_learned.then(|| self.match_by_known_source(packet, claim)).flatten();
                let by_port = || (count > 1).then(|| self.by_port_of_auxiliary(packet, claim)).flatten();
                by_port().or_else(met).unwrap_or((best, count))
            }
            _ => (best, count),
        }
    }

    /// Of several sensors that send from one place, an inertial packet belongs to the one that owns its port.
    fn by_port_of_auxiliary(&self, packet: &Packet<'_>, claim: Claim) -> Option<Claims> {
        let port = Some(packet.destination.port());
        let is_meant = |sensor: &Sensor| sensor.imu_port() == port && sensor.claim(packet) == claim;
        let meant = self.sensors.iter().enumerate().filter(|(_, sensor)| is_meant(sensor));
        match meant.map(|(at, _)| at).collect::<Vec<_>>()[..] {
            [at] => Some((Some((at, claim)), 1)),
            _ => None,
        }
    }

    /// Whether a packet that names no sensor, and that this sensor alone claims, can belong to no other unit: one unit
    /// sends from one address to one port. Without a look before decoding, the first to come counts.
    fn is_its_own(&mut self, at: usize, packet: &Packet<'_>) -> bool {
        let sensor = &mut self.sensors[at];
        if sensor.streams.of_several().is_some() {
            return false;
        }
        if packet.payload.len() != crate::ouster::imu::LEGACY_BYTES {
            return true;
        }
        if sensor.imu_streams().is_empty() {
            sensor.streams.note_imu(packet);
        }
        sensor.imu_streams() == [stream_of(packet)]
    }

    /// An inertial packet that names no sensor comes from a sensor with lidar packets in the recording.
    fn match_by_known_source(&self, packet: &Packet<'_>, claim: Claim) -> Option<Claims> {
        let claims = |sensor: &Sensor| sensor.source_is_known && sensor.claim(packet) == claim;
        let met = self.sensors.iter().enumerate().filter(|(_, sensor)| claims(sensor));
        match met.map(|(at, _)| at).collect::<Vec<_>>()[..] {
            [at] => Some((Some((at, claim)), 1)),
            [] if self.unknown_sources.contains(&packet.source.ip()) => Some((None, 0)),
            _ => None,
        }
    }

    fn note_unknown_source(&mut self, packet: &Packet<'_>) {
        if Guess::of_velodyne(packet.payload) == Some(Guess::VelodyneData) {
            self.note_velodyne(packet);
            return;
        }
        for sensor in &mut self.sensors {
            sensor.note_rival(packet);
        }
        let address = packet.source.ip();
        let is_new = self.unknown_sources.len() < MOST_SENSORS && !self.unknown_sources.contains(&address);
        if is_new && matches!(Guess::of(packet.payload), Guess::OusterLidar { .. }) {
            self.unknown_sources.push(address);
        }
    }

    fn note_velodyne(&mut self, packet: &Packet<'_>) {
        let stream = stream_of(packet);
        if self.velodynes.len() < MOST_SENSORS && !self.velodynes.contains(&stream) {
            self.velodynes.push(stream);
        }
    }

    /// Where the data packets of the Velodyne go that this position packet is of; none where its sender is but one.
    fn data_port_of(&self, packet: &Packet<'_>) -> Result<Option<u16>, Option<String>> {
        let (address, port) = stream_of(packet);
        let mut matching = self.names.iter().filter(|named| named.sends_auxiliary_from(address, port));
        if let (Some(named), None) = (matching.next(), matching.next()) {
            return Ok(named.port);
        }
        let units: Vec<Stream> = self.velodynes.iter().filter(|unit| unit.0 == address).copied().collect();
        if units.len() > 1 { Err(Some(explain::position_of_several(&units))) } else { Ok(None) }
    }

    fn count_unclaimed(&mut self, packet: &Packet<'_>, reason: Option<String>) {
        let serial = Guess::serial_in(packet.payload);
        let mut key = (packet.destination.port(), packet.payload.len(), serial);
        if self.unclaimed.len() >= MOST_KINDS && !self.unclaimed.contains_key(&key) {
            key = OF_MORE_KINDS;
        }
        if let Some(entry) = self.unclaimed.get_mut(&key) {
            entry.packets += 1;
            return;
        }
        let guess = Guess::of(packet.payload);
        let reason = match key {
            OF_MORE_KINDS => explain::too_many(MOST_KINDS),
            _ => explain::unclaimed(&self.sensors, packet, &guess, reason),
        };
        let is_sensor_data = guess != Guess::Unknown && guess != Guess::VelodyneBlocks;
        let needs_metadata = guess.is_ouster();
        let (port, length, _) = key;
        let is_ouster_lidar = matches!(guess, Guess::OusterLidar { .. });
        let entry = Unclaimed {
            port,
            length,
            packets: 1,
            reason,
            is_sensor_data,
            needs_metadata,
            is_ouster_lidar,
            serial,
        };
        self.unclaimed.insert(key, entry);
    }
}

/// Whether a packet that one sensor alone claims shows where that sensor sends from. An IMU packet without a serial
/// number does not: its length alone makes it fit.
fn is_evidence(claim: Claim, packet: &Packet<'_>) -> bool {
    claim == Claim::Certain || (claim > Claim::No && packet.payload.len() != crate::ouster::imu::LEGACY_BYTES)
}
