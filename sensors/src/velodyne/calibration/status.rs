//! Status bytes of HDL-64E S2 and S3: each packet carries one byte of a 16-packet cycle, nine bytes of state and
//! seven bytes of a stream of 1820 that repeats every 4160 packets and holds the unit's calibration. Source: HDL-64E
//! S2 and S3 manuals, appendix "Ethernet transit timing table" and "calibration and status data".

use std::collections::VecDeque;
use std::net::Ipv4Addr;

use super::super::product::ReturnMode;
use super::{Calibration, LaserCalibration};

/// Bytes of the repeating stream.
const STREAM_BYTES: usize = 1820;
const START: &[u8; 5] = b"UNIT#";
const LASERS: usize = 64;
const RECORD_BYTES: usize = 28;
const RECORDS_AT: usize = 7;
/// The end of the stream: what follows the laser in its last record, and then what comes once.
const TAIL_AT: usize = STREAM_BYTES - RECORD_BYTES;
const WARNING_AT: usize = TAIL_AT + 24;

/// Warning bits: dirty lens, too hot, too cold (0 to 2), pulse per second (5), GPS time (6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Warnings(pub u8);

impl Warnings {
    /// GPS time is there.
    pub fn has_gps_time(self) -> bool {
        self.0 & 0x40 != 0
    }
}

/// What the sensor gets from its GPS receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GpsState {
    /// Sentences and pulses.
    Both,
    /// Sentences only.
    Sentence,
    /// Pulses only.
    Pulse,
    /// Neither.
    #[default]
    Neither,
}

impl GpsState {
    fn from_byte(byte: u8) -> Self {
        match byte {
            b'A' => Self::Both,
            b'V' => Self::Sentence,
            b'P' => Self::Pulse,
            _ => Self::Neither,
        }
    }

    fn byte(self) -> u8 {
        match self {
            Self::Both => b'A',
            Self::Sentence => b'V',
            Self::Pulse => b'P',
            Self::Neither => 0,
        }
    }
}

/// The nine bytes of state that come every 16 packets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Health {
    /// Clock of the sensor, UTC: year (two digits), month, day, hour, minute, second.
    pub utc: [u8; 6],
    /// GPS receiver.
    pub gps: GpsState,
    /// Temperature, degrees Celsius.
    pub temperature_c: u8,
    /// Firmware version byte.
    pub firmware: u8,
}

/// One whole status stream.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitStatus {
    /// S3: has a checksum over its calibration and marks its warning byte.
    pub is_s3: bool,
    /// Noise thresholds of the upper and the lower block.
    pub noise_thresholds: [u8; 2],
    /// When the unit was calibrated: year (two digits), month, day, hour, minute, second; none if never.
    pub calibrated: Option<[u8; 6]>,
    /// Relative humidity, percent.
    pub humidity_percent: u8,
    /// Motor speed, 1/min.
    pub motor_rpm: i16,
    /// Field of view, hundredths of a degree.
    pub view_counts: [u16; 2],
    /// Hours in use.
    pub hours: u16,
    /// Address of the sensor and of the receiver.
    pub addresses: [Ipv4Addr; 2],
    /// Which returns are sent.
    pub return_mode: Option<ReturnMode>,
    /// Warnings.
    pub warnings: Warnings,
    /// Laser power level.
    pub power_level: u8,
    /// Calibration of the unit, in the order of the lasers.
    pub calibration: Calibration,
}

/// Collects status bytes in the order of the packets.
#[derive(Clone, Debug, Default)]
pub struct StatusReader {
    /// State bytes seen last.
    pub health: Health,
    bytes: VecDeque<u8>,
    marked_warning: bool,
}

impl StatusReader {
    /// Takes the type and value bytes of the next packet (bytes 1204 and 1205). Returns the stream each time a whole
    /// one has come that proves itself: by its start, the ids of its lasers and its checksum (S2: its length).
    pub fn push(&mut self, kind: u8, value: u8) -> Option<UnitStatus> {
        match kind {
            b'Y' => self.health.utc[0] = value,
            b'N' => self.health.utc[1] = value,
            b'D' => self.health.utc[2] = value,
            b'H' => self.health.utc[3] = value,
            b'M' => self.health.utc[4] = value,
            b'S' => self.health.utc[5] = value,
            b'G' => self.health.gps = GpsState::from_byte(value),
            b'T' => self.health.temperature_c = value,
            b'V' => self.health.firmware = value,
            _ => {
                self.marked_warning |= kind == b'W';
                return self.push_stream(value);
            }
        }
        None
    }

    fn push_stream(&mut self, value: u8) -> Option<UnitStatus> {
        if self.bytes.len() == STREAM_BYTES {
            self.bytes.pop_front();
        }
        self.bytes.push_back(value);
        if self.bytes.len() < STREAM_BYTES || !self.bytes.iter().zip(START).all(|(byte, start)| byte == start)
        {
            return None;
        }
        let status = parse(self.bytes.make_contiguous(), self.marked_warning);
        self.marked_warning &= status.is_none();
        status
    }
}

fn parse(stream: &[u8], is_s3: bool) -> Option<UnitStatus> {
    let word = |at: usize| u16::from_le_bytes([stream[at], stream[at + 1]]);
    let records = stream[RECORDS_AT..RECORDS_AT + LASERS * RECORD_BYTES].chunks_exact(RECORD_BYTES);
    let expected = if is_s3 { checksum(stream) } else { STREAM_BYTES as u16 };
    let ids_match = records.clone().enumerate().all(|(id, record)| usize::from(record[0]) == id);
    if word(STREAM_BYTES - 2) != expected || !ids_match {
        return None;
    }
    let tail = &stream[TAIL_AT..];
    let calibrated = [tail[0], tail[1], tail[2], tail[3], tail[4], tail[5]];
    let address = |at: usize| Ipv4Addr::new(tail[at], tail[at + 1], tail[at + 2], tail[at + 3]);
    Some(UnitStatus {
        is_s3,
        noise_thresholds: [stream[5], stream[6]],
        calibrated: (!calibrated.contains(&0xFF)).then_some(calibrated),
        humidity_percent: tail[6],
        motor_rpm: word(TAIL_AT + 7) as i16,
        view_counts: [word(TAIL_AT + 9), word(TAIL_AT + 11)],
        hours: word(TAIL_AT + 13),
        addresses: [address(15), address(19)],
        return_mode: match tail[23] {
            0 => Some(ReturnMode::Strongest),
            1 => Some(ReturnMode::Last),
            2 => Some(ReturnMode::Dual),
            _ => None,
        },
        warnings: Warnings(tail[24]),
        power_level: tail[25],
        calibration: Calibration { distance_unit_m: Some(0.002), lasers: records.map(laser).collect() },
    })
}

fn laser(record: &[u8]) -> LaserCalibration {
    let value = |place: usize| f64::from(i16::from_le_bytes([record[1 + 2 * place], record[2 + 2 * place]]));
    LaserCalibration {
        vertical_rad: (value(0) * 0.01).to_radians(),
        rotation_rad: (value(1) * 0.01).to_radians(),
        distance_m: value(2) * 0.001,
        near_distance_m: Some([value(3) * 0.001, value(4) * 0.001]),
        vertical_offset_m: Some(value(5) * 0.001),
        horizontal_offset_m: value(6) * 0.001,
        focal_distance_m: value(7) * 0.001,
        focal_slope: value(8) * 0.1,
        intensity_limits: [record[19], record[20]],
        enabled: true,
    }
}

/// Bytes 1204 and 1205 of the 4160 packets that carry a status once; the sensor repeats them.
pub(crate) fn encode_status_bytes(status: &UnitStatus, health: &Health) -> Vec<[u8; 2]> {
    let stream = stream_of(status);
    let [year, month, day, hour, minute, second] = health.utc;
    let state = [
        [b'H', hour],
        [b'M', minute],
        [b'S', second],
        [b'D', day],
        [b'N', month],
        [b'Y', year],
        [b'G', health.gps.byte()],
        [b'T', health.temperature_c],
        [b'V', health.firmware],
    ];
    let mut pairs = Vec::with_capacity(STREAM_BYTES / 7 * 16);
    for (cycle, bytes) in stream.chunks_exact(7).enumerate() {
        pairs.extend(state);
        pairs.extend(bytes.iter().enumerate().map(|(place, byte)| {
            let is_warning = status.is_s3 && cycle * 7 + place == WARNING_AT;
            [if is_warning { b'W' } else { b'1' + place as u8 }, *byte]
        }));
    }
    pairs
}

fn stream_of(status: &UnitStatus) -> Vec<u8> {
    let mut stream = Vec::with_capacity(STREAM_BYTES);
    stream.extend(START);
    stream.extend(status.noise_thresholds);
    let calibrated = status.calibrated.unwrap_or([0xFF; 6]);
    for (id, laser) in status.calibration.lasers.iter().enumerate().take(LASERS) {
        stream.push(id as u8);
        let near_m = laser.near_distance_m.unwrap_or([laser.distance_m; 2]);
        for value in [
            laser.vertical_rad.to_degrees() * 100.0,
            laser.rotation_rad.to_degrees() * 100.0,
            laser.distance_m * 1e3,
            near_m[0] * 1e3,
            near_m[1] * 1e3,
            laser.vertical_offset_m.unwrap_or(0.0) * 1e3,
            laser.horizontal_offset_m * 1e3,
            laser.focal_distance_m * 1e3,
            laser.focal_slope * 10.0,
        ] {
            stream.extend((value.round() as i16).to_le_bytes());
        }
        stream.extend(laser.intensity_limits);
        stream.extend(calibrated);
        stream.push(status.humidity_percent);
    }
    stream.resize(TAIL_AT + 7, 0);
    stream.extend(status.motor_rpm.to_le_bytes());
    for value in [status.view_counts[0], status.view_counts[1], status.hours] {
        stream.extend(value.to_le_bytes());
    }
    for address in status.addresses {
        stream.extend(address.octets());
    }
    stream.push(match status.return_mode {
        Some(ReturnMode::Strongest) | None => 0,
        Some(ReturnMode::Last) => 1,
        Some(ReturnMode::Dual) => 2,
    });
    stream.extend([status.warnings.0, status.power_level]);
    let check = if status.is_s3 { checksum(&stream) } else { STREAM_BYTES as u16 };
    stream.extend(check.to_le_bytes());
    stream
}

/// CRC-16 with polynomial 0x8005, not reflected, over the values of all lasers.
fn checksum(stream: &[u8]) -> u16 {
    let records = stream[RECORDS_AT..RECORDS_AT + LASERS * RECORD_BYTES].chunks_exact(RECORD_BYTES);
    records.flat_map(|record| &record[1..21]).fold(0, |crc: u16, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x8005 }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(is_s3: bool) -> UnitStatus {
        let laser = |id: usize| LaserCalibration {
            vertical_rad: (-0.05 * id as f64).to_radians(),
            rotation_rad: (0.11 * id as f64 - 3.0).to_radians(),
            distance_m: 1.2 + 0.001 * id as f64,
            near_distance_m: Some([1.3, 1.31]),
            vertical_offset_m: Some(0.2),
            horizontal_offset_m: if id.is_multiple_of(2) { 0.026 } else { -0.026 },
            focal_distance_m: 12.5,
            focal_slope: 1.4,
            intensity_limits: [30, 255],
            enabled: true,
        };
        UnitStatus {
            is_s3,
            noise_thresholds: [24, 25],
            calibrated: Some([16, 11, 15, 12, 47, 47]),
            humidity_percent: 25,
            motor_rpm: 600,
            view_counts: [0, 36_000],
            hours: 2685,
            addresses: [Ipv4Addr::new(192, 168, 3, 43), Ipv4Addr::new(192, 168, 3, 255)],
            return_mode: Some(ReturnMode::Strongest),
            warnings: Warnings(0x61),
            power_level: 0xA0,
            calibration: Calibration { distance_unit_m: Some(0.002), lasers: (0..64).map(laser).collect() },
        }
    }

    #[test]
    fn a_stream_that_starts_anywhere_is_read() {
        let health =
            Health { utc: [16, 12, 15, 21, 19, 4], gps: GpsState::Both, temperature_c: 27, firmware: 71 };
        for is_s3 in [false, true] {
            let sent = status(is_s3);
            let pairs = encode_status_bytes(&sent, &health);
            assert_eq!(pairs.len(), 4160);
            let mut reader = StatusReader::default();
            let twice = pairs.iter().chain(&pairs).skip(1234);
            let read: Vec<_> = twice.filter_map(|[kind, value]| reader.push(*kind, *value)).collect();
            assert_eq!(read.len(), 1, "one whole stream after the cut one");
            assert_eq!((reader.health, read[0].is_s3), (health, is_s3));
            assert_eq!(encode_status_bytes(&read[0], &health), pairs, "the values come back");
            assert!((read[0].calibration.lasers[63].distance_m - 1.263).abs() < 1e-9);
            assert_eq!((read[0].hours, read[0].return_mode), (2685, Some(ReturnMode::Strongest)));
        }
    }

    #[test]
    fn a_stream_with_a_hole_or_a_wrong_bit_is_refused() {
        for is_s3 in [false, true] {
            let pairs = encode_status_bytes(&status(is_s3), &Health::default());
            for hole in [16, 900, 4000] {
                let mut reader = StatusReader::default();
                let holed = pairs.iter().enumerate().filter(|(at, _)| *at / 16 != hole / 16);
                assert!(holed.map(|(_, pair)| reader.push(pair[0], pair[1])).all(|read| read.is_none()));
            }
        }
        let mut pairs = encode_status_bytes(&status(true), &Health::default());
        pairs[2 * 16 + 12][1] ^= 4;
        let mut reader = StatusReader::default();
        assert!(pairs.iter().all(|[kind, value]| reader.push(*kind, *value).is_none()));
    }
}
