//! One sensor's packets to frames, inertial samples and zone reports.

use std::net::SocketAddr;

use super::assembly::{Output, Place};
use super::claim::Claim;
use super::evidence::{Correction, Evidence};
use super::held::Held;
use super::imu;
use super::metadata::{ImuProfile, Metadata};
use super::profile::Profile;
use super::stream::Stream;
use super::wire::{Header, HeaderKind, PacketKind, check_crc};
use super::zones::{self, ZoneReport};
use crate::{Completed, DecodeStats, Decoder, Packet, Rejected, SensorModel};

/// Decodes the packets of one sensor. Memory is bounded and reused: a few frames and a few held packets.
pub struct OusterDecoder {
    pub(super) metadata: Metadata,
    pub(super) lidar_bytes: usize,
    imu_bytes: usize,
    /// Serial number of the metadata.
    pub(super) serial: Option<u64>,
    pub(super) stream: Stream,
    stats: DecodeStats,
    source: Option<SocketAddr>,
    completed: Completed,
    nmea: Option<(u64, String)>,
    pub(super) evidence: Evidence,
    /// The metadata as they were given.
    pub(super) given: Box<Metadata>,
    /// Lidar packets after a pause or a change, until a revolution of them shows how the sensor is set.
    pub(super) held: Held,
    /// What the first packets show of its settings is learned: a later one may be of others.
    pub(super) has_learned: bool,
    pub(super) corrections: Vec<Correction>,
    /// A packet of the sensor has been looked at: its header is laid out as that one's.
    pub(super) is_met: bool,
}

/// What a packet turned out to be.
enum Kind {
    LegacyImu,
    Lidar(Place),
    Imu(Header),
    Zone(Header),
}

impl OusterDecoder {
    /// A decoder for the sensor that `metadata` describes.
    pub fn new(metadata: Metadata) -> Self {
        let imu_bytes = match metadata.imu_profile {
            ImuProfile::Legacy => imu::LEGACY_BYTES,
            ImuProfile::Accel32Gyro32Nmea => imu::accel32_bytes(metadata.imu_samples_per_packet),
            ImuProfile::Off => 0,
        };
        Self {
            lidar_bytes: metadata.packet_format().packet_bytes(),
            imu_bytes,
            serial: metadata.serial_number(),
            stream: Stream::new(&metadata),
            stats: DecodeStats::default(),
            source: None,
            completed: Completed::default(),
            nmea: None,
            evidence: Evidence::default(),
            given: Box::new(metadata.clone()),
            held: Held::default(),
            has_learned: false,
            corrections: Vec::new(),
            is_met: false,
            metadata,
        }
    }

    /// The sensor's metadata; its header layout is that of the packets.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Whether its lidar packets name their sensor.
    pub(crate) fn names_sensor(&self) -> bool {
        self.metadata.profile.has_packet_header() && self.serial.is_some()
    }

    /// Length of its lidar packets.
    pub(crate) fn lidar_bytes(&self) -> usize {
        self.lidar_bytes
    }

    /// The newest GPS sentence and its time, ns, from ACCEL32_GYRO32_NMEA packets.
    pub fn nmea(&self) -> Option<(u64, &str)> {
        self.nmea.as_ref().map(|(time_ns, text)| (*time_ns, text.as_str()))
    }

    /// How surely a packet comes from this sensor; does not look at checksums. Packets without a serial number
    /// (LEGACY, IMU of 48 bytes) are distinguished by size, port and where earlier ones came from.
    pub fn claim(&self, packet: &Packet<'_>) -> Claim {
        let bytes = packet.payload;
        if self.metadata.imu_profile == ImuProfile::Legacy && bytes.len() == imu::LEGACY_BYTES {
            return self.claim_anonymous(packet, self.metadata.imu_port);
        }
        if self.metadata.profile == Profile::Legacy {
            let fits = bytes.len() == self.lidar_bytes && self.ensure_columns(bytes).is_ok();
            return if fits { self.claim_anonymous(packet, self.metadata.lidar_port) } else { Claim::No };
        }
        let header = Header::read(self.header_kind(bytes), bytes);
        match (header, self.serial) {
            (Some(header), Some(serial)) if header.serial == serial => {
                if bytes.len() == self.expected_bytes(header.kind) { Claim::Certain } else { Claim::Named }
            }
            (Some(header), None) if bytes.len() == self.expected_bytes(header.kind) => {
                self.claim_anonymous(packet, self.metadata.lidar_port)
            }
            _ => Claim::No,
        }
    }

    fn claim_anonymous(&self, packet: &Packet<'_>, port: Option<u16>) -> Claim {
        match self.source {
            Some(source) if source.ip() == packet.source.ip() && !source.ip().is_loopback() => {
                Claim::Familiar
            }
            Some(source) if source.ip() != packet.source.ip() => Claim::No,
            _ if port == Some(packet.destination.port()) => Claim::Likely,
            _ => Claim::Possible,
        }
    }

    /// Checks that a packet is whole and this sensor's.
    fn identify(&self, packet: &Packet<'_>) -> Result<Kind, Rejected> {
        let bytes = packet.payload;
        if self.metadata.imu_profile == ImuProfile::Legacy && bytes.len() == imu::LEGACY_BYTES {
            return Ok(Kind::LegacyImu);
        }
        if self.metadata.profile == Profile::Legacy {
            return self.identify_legacy(packet);
        }
        let Some(header) = Header::read(self.metadata.header, bytes) else {
            self.refuse_damaged(packet)?;
            let reason = format!("{} bytes without a known packet type", bytes.len());
            return Err(Rejected::Foreign { reason });
        };
        if let Some(serial) = self.serial
            && serial != header.serial
        {
            self.refuse_damaged(packet)?;
            let reason = format!("serial number {}, expected {serial}", header.serial);
            return Err(Rejected::Foreign { reason });
        }
        let expected = self.expected_bytes(header.kind);
        if bytes.len() != expected {
            self.refuse_damaged(packet)?;
            let reason = format!("{:?} packet of {} bytes, expected {expected}", header.kind, bytes.len());
            return Err(Rejected::Malformed { reason });
        }
        check_crc(bytes).map_err(|(stored, computed)| Rejected::Checksum { stored, computed })?;
        Ok(match header.kind {
            PacketKind::Imu => Kind::Imu(header),
            PacketKind::Zone => Kind::Zone(header),
            PacketKind::Lidar => {
                let (slot, time_ns) = self.locate(bytes)?;
                let (frame_id, init_id, health) = (header.frame_id, header.init_id, header.health);
                let host_time_ns = packet.host_time_ns;
                Kind::Lidar(Place { frame_id, init_id, slot, time_ns, host_time_ns, health })
            }
        })
    }

    fn identify_legacy(&self, packet: &Packet<'_>) -> Result<Kind, Rejected> {
        let bytes = packet.payload;
        if bytes.len() != self.lidar_bytes {
            let reason = format!("{} bytes, expected {}", bytes.len(), self.lidar_bytes);
            let ours = self.is_familiar(packet);
            return Err(if ours { Rejected::Malformed { reason } } else { Rejected::Foreign { reason } });
        }
        let format = self.metadata.packet_format();
        let (slot, time_ns) = self.locate(bytes)?;
        let frame_id = format.legacy_frame_id(format.column(bytes, 0));
        for index in 1..format.columns_per_packet {
            let other = format.legacy_frame_id(format.column(bytes, index));
            if other != frame_id {
                let reason = format!("column {index} is of frame {other}, the first of {frame_id}");
                return Err(Rejected::Malformed { reason });
            }
        }
        let health = crate::Health::default();
        let host_time_ns = packet.host_time_ns;
        Ok(Kind::Lidar(Place { frame_id, init_id: 0, slot, time_ns, host_time_ns, health }))
    }

    /// Slot and time of a lidar packet, if its columns follow one another from a packet boundary.
    fn locate(&self, bytes: &[u8]) -> Result<(usize, u64), Rejected> {
        let (first_id, last_id, time_ns) = self.ensure_columns(bytes)?;
        let expected = self.metadata.columns_per_frame;
        if last_id >= expected {
            let reason = format!("column {last_id}, expected less than {expected}");
            return Err(Rejected::Malformed { reason });
        }
        Ok((first_id / self.metadata.columns_per_packet, time_ns))
    }

    /// First column, last valid one (or the first) and time of a lidar packet with consecutive columns from a packet
    /// boundary, in whatever mode.
    pub(super) fn ensure_columns(&self, bytes: &[u8]) -> Result<(usize, usize, u64), Rejected> {
        let format = self.metadata.packet_format();
        let first = format.read_column(format.column(bytes, 0));
        let first_id = usize::from(first.measurement_id);
        if first_id % format.columns_per_packet != 0 {
            let reason =
                format!("first column {first_id}, expected a multiple of {}", format.columns_per_packet);
            return Err(Rejected::Malformed { reason });
        }
        let mut last_id = first_id;
        for index in 1..format.columns_per_packet {
            let column = format.read_column(format.column(bytes, index));
            let id = usize::from(column.measurement_id);
            if !column.valid {
                continue;
            }
            if id != first_id + index {
                let reason = format!("column {id} where {} belongs", first_id + index);
                return Err(Rejected::Malformed { reason });
            }
            last_id = id;
        }
        Ok((first_id, last_id, first.time_ns))
    }

    /// For packets that do not identify themselves: damaged, when all else says they are ours.
    fn refuse_damaged(&self, packet: &Packet<'_>) -> Result<(), Rejected> {
        let bytes = packet.payload;
        if !self.is_familiar(packet) {
            return Ok(());
        }
        if [self.lidar_bytes, self.imu_bytes].contains(&bytes.len()) {
            return check_crc(bytes).map_err(|(stored, computed)| Rejected::Checksum { stored, computed });
        }
        if bytes.len() < self.lidar_bytes.min(super::wire::HEADER_BYTES) {
            return Err(Rejected::Malformed {
                reason: format!("{} bytes, too short for a header", bytes.len()),
            });
        }
        Ok(())
    }

    fn is_familiar(&self, packet: &Packet<'_>) -> bool {
        self.source == Some(packet.source)
    }

    /// The header layout of a packet. Firmware from 4.0 on may write the functional-safety header where metadata says
    /// STANDARD: the serial number tells.
    pub(super) fn header_kind(&self, bytes: &[u8]) -> HeaderKind {
        let Some(serial) = self.serial else { return self.metadata.header };
        let fits = |kind| Header::read(kind, bytes).is_some_and(|header| header.serial == serial);
        let others = [HeaderKind::Standard, HeaderKind::Fusa];
        if fits(self.metadata.header) {
            self.metadata.header
        } else {
            others.into_iter().find(|kind| fits(*kind)).unwrap_or(self.metadata.header)
        }
    }

    fn expected_bytes(&self, kind: PacketKind) -> usize {
        match kind {
            PacketKind::Lidar => self.lidar_bytes,
            PacketKind::Imu => self.imu_bytes,
            PacketKind::Zone => zones::PACKET_BYTES,
        }
    }

    fn count(&mut self, rejected: Rejected) -> Rejected {
        match &rejected {
            Rejected::Foreign { .. } => self.stats.foreign += 1,
            Rejected::Malformed { .. } => self.stats.malformed += 1,
            Rejected::Checksum { .. } => self.stats.crc_errors += 1,
        }
        if !matches!(rejected, Rejected::Foreign { .. }) {
            self.stream.note_rejected();
        }
        rejected
    }
}

impl Decoder for OusterDecoder {
    fn take(&mut self, packet: &Packet<'_>) -> Result<(), Rejected> {
        self.doubt_layout(packet.payload);
        if let Some((init_id, seen)) = self.sight(packet.payload) {
            if self.is_held(packet, init_id, seen) {
                return Ok(());
            }
            self.look(packet.payload, init_id, seen);
        }
        self.decode(packet)
    }

    fn end(&mut self) {
        self.release();
        let (stream, mut output) = self.stream_and_output();
        stream.finish(&mut output);
    }

    fn completed(&self) -> &Completed {
        &self.completed
    }

    fn completed_mut(&mut self) -> &mut Completed {
        &mut self.completed
    }

    fn stats(&self) -> &DecodeStats {
        &self.stats
    }

    /// That of the metadata.
    fn model(&self) -> Option<&SensorModel> {
        Some(&self.metadata.model)
    }
}

impl OusterDecoder {
    /// Decodes a packet of whatever kind, in the mode that is known.
    pub(super) fn decode(&mut self, packet: &Packet<'_>) -> Result<(), Rejected> {
        let kind = self.identify(packet).map_err(|rejected| self.count(rejected))?;
        self.stats.packets += 1;
        match kind {
            Kind::Lidar(place) => {
                self.source.get_or_insert(packet.source);
                let (stream, mut output) = self.stream_and_output();
                stream.take(&mut output, &place, packet.payload);
            }
            Kind::LegacyImu => {
                if let Some(bytes) = packet.payload.first_chunk() {
                    self.completed.add_imu(imu::read_legacy(bytes));
                }
            }
            Kind::Imu(header) => {
                self.note_revolution(&header, packet);
                if let Some((time_ns, text)) = imu::read_nmea(packet.payload) {
                    let (time, line) = self.nmea.get_or_insert_default();
                    *time = time_ns;
                    line.clear();
                    line.push_str(text);
                }
                for sample in imu::read_accel32(packet.payload) {
                    self.completed.add_imu(sample);
                }
            }
            Kind::Zone(header) => {
                self.note_revolution(&header, packet);
                if let Some(bytes) = packet.payload.first_chunk() {
                    let mut report = ZoneReport::default();
                    zones::read(header.frame_id, bytes, &mut report);
                    self.completed.add_zones(report);
                }
            }
        }
        Ok(())
    }

    pub(super) fn stream_and_output(&mut self) -> (&mut Stream, Output<'_>) {
        let Self { metadata, stats, completed, stream, .. } = self;
        (stream, Output { metadata, stats, completed })
    }

    /// Without lidar packets the other packets tell which revolution it is.
    fn note_revolution(&mut self, header: &Header, packet: &Packet<'_>) {
        if self.metadata.profile != Profile::Off {
            return;
        }
        let place = Place {
            frame_id: header.frame_id,
            init_id: header.init_id,
            slot: 0,
            time_ns: 0,
            host_time_ns: packet.host_time_ns,
            health: header.health,
        };
        self.source.get_or_insert(packet.source);
        let (stream, mut output) = self.stream_and_output();
        stream.note_revolution(&mut output, &place);
    }
}
