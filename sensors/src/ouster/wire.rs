//! The frame of an Ouster packet: header, columns, footer. Everything but the pixels.
//!
//! Source: Ouster firmware user manual, "Lidar data format"; offsets checked on captured packets of firmware 1.x
//! to 3.2.

use super::profile::Profile;
use crate::Health;

/// Bytes before the first column of every profile but LEGACY.
pub const HEADER_BYTES: usize = 32;
/// Bytes after the last column of every profile but LEGACY; the last eight are the checksum.
pub const FOOTER_BYTES: usize = 32;
/// What sensors before firmware 3.2 write where the checksum belongs (2.3 to 2.4; older ones write 0).
pub const NO_CRC: u64 = 0xDEAD_BEEF_0000_C0DE;

const CRC_BYTES: usize = 8;
const COLUMN_HEADER_BYTES: usize = 12;
const LEGACY_COLUMN_HEADER_BYTES: usize = 16;
const LEGACY_COLUMN_FOOTER_BYTES: usize = 4;
/// Encoder counts of one revolution, as LEGACY columns count them.
const LEGACY_ENCODER_COUNTS: u64 = 90_112;

/// How the packet header is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderKind {
    /// 16-bit type and frame counter.
    Standard,
    /// Functional safety: 8-bit type, 32-bit frame counter.
    Fusa,
}

/// What a packet carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketKind {
    /// Columns of ranges.
    Lidar,
    /// Inertial samples.
    Imu,
    /// Zone monitor.
    Zone,
}

/// A packet header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// What follows.
    pub kind: PacketKind,
    /// Counter of revolutions.
    pub frame_id: u32,
    /// Changes whenever the sensor is re-initialised; 24 bits.
    pub init_id: u32,
    /// Serial number; 40 bits.
    pub serial: u64,
    /// Warnings.
    pub health: Health,
}

/// A column's own header, without its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ColumnHeader {
    /// Sensor clock, ns.
    pub time_ns: u64,
    /// Encoder position, counted in columns.
    pub measurement_id: u16,
    /// The sensor calls the column valid.
    pub valid: bool,
}

/// Sizes and offsets of a sensor's lidar packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketFormat {
    /// Profile of the pixels.
    pub profile: Profile,
    /// Header layout; LEGACY packets have none.
    pub header: HeaderKind,
    /// Columns in one packet.
    pub columns_per_packet: usize,
    /// Pixels in one column.
    pub pixels_per_column: usize,
}

/// The pixel blocks of neighbouring columns in a packet.
#[derive(Clone, Copy)]
pub(super) struct Columns<'a> {
    /// From the first block of the first column on.
    pub(super) bytes: &'a [u8],
    /// Bytes from the first block of a column to that of the next.
    pub(super) stride: usize,
    /// Bytes of one column's blocks.
    pub(super) length: usize,
    pub(super) count: usize,
}

impl<'a> Columns<'a> {
    /// The blocks of one column.
    #[inline(always)]
    pub(super) fn blocks(&self, column: usize) -> &'a [u8] {
        &self.bytes[column * self.stride..][..self.length]
    }
}

impl HeaderKind {
    /// The only kind a profile can have: LEGACY counts frames in 16 bits, FUSA profiles bring their header.
    pub fn of(profile: Profile) -> Option<Self> {
        match profile {
            Profile::Legacy => Some(Self::Standard),
            Profile::FusaRng15Rfl8Nir8Dual => Some(Self::Fusa),
            _ => None,
        }
    }

    /// Name in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::Standard => "STANDARD",
            Self::Fusa => "FUSA",
        }
    }

    /// By its name in metadata.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Standard, Self::Fusa].into_iter().find(|kind| kind.name() == name)
    }

    /// Distinct values of the frame counter.
    pub fn frame_ids(self) -> u64 {
        match self {
            Self::Standard => 1 << 16,
            Self::Fusa => 1 << 32,
        }
    }
}

impl PacketKind {
    const ALL: [(u16, Self); 3] = [(1, Self::Lidar), (2, Self::Imu), (3, Self::Zone)];

    fn from_number(number: u16) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == number).map(|(_, kind)| *kind)
    }

    fn number(self) -> u16 {
        match self {
            Self::Lidar => 1,
            Self::Imu => 2,
            Self::Zone => 3,
        }
    }
}

impl Header {
    /// Reads the header of a packet that has one; `None` when it is too short or of no known type.
    pub fn read(kind: HeaderKind, packet: &[u8]) -> Option<Self> {
        let bytes: &[u8; HEADER_BYTES] = packet.first_chunk()?;
        let (number, frame_id, init_at, serial_at, alert_at) = match kind {
            HeaderKind::Standard => (u16_at(bytes, 0), u32::from(u16_at(bytes, 2)), 4, 7, 12),
            HeaderKind::Fusa => (u16::from(bytes[0]), u32_at(bytes, 4), 1, 11, 8),
        };
        Some(Self {
            kind: PacketKind::from_number(number)?,
            frame_id,
            init_id: u32_at(bytes, init_at) & 0xFF_FFFF,
            serial: u64_at(bytes, serial_at) & 0xFF_FFFF_FFFF,
            health: Health {
                alert_flags: bytes[alert_at],
                thermal_countdown_s: bytes[16],
                shot_limiting_countdown_s: bytes[17],
                thermal_shutdown: bytes[18] & 0x0F,
                shot_limiting: bytes[19] & 0x0F,
            },
        })
    }

    /// Writes the header over the first bytes of a packet; bytes without a meaning become 0.
    pub fn write(&self, kind: HeaderKind, packet: &mut [u8]) {
        let bytes = &mut packet[..HEADER_BYTES];
        bytes.fill(0);
        let init_id = &self.init_id.to_le_bytes()[..3];
        let serial = &self.serial.to_le_bytes()[..5];
        match kind {
            HeaderKind::Standard => {
                bytes[..2].copy_from_slice(&self.kind.number().to_le_bytes());
                bytes[2..4].copy_from_slice(&self.frame_id.to_le_bytes()[..2]);
                bytes[4..7].copy_from_slice(init_id);
                bytes[7..12].copy_from_slice(serial);
                bytes[12] = self.health.alert_flags;
            }
            HeaderKind::Fusa => {
                bytes[0] = self.kind.number() as u8;
                bytes[1..4].copy_from_slice(init_id);
                bytes[4..8].copy_from_slice(&self.frame_id.to_le_bytes());
                bytes[8] = self.health.alert_flags;
                bytes[11..16].copy_from_slice(serial);
            }
        }
        bytes[16] = self.health.thermal_countdown_s;
        bytes[17] = self.health.shot_limiting_countdown_s;
        bytes[18] = self.health.thermal_shutdown & 0x0F;
        bytes[19] = self.health.shot_limiting & 0x0F;
    }
}

impl PacketFormat {
    /// Bytes of a lidar packet; 0 when the sensor sends none.
    pub fn packet_bytes(&self) -> usize {
        match self.profile {
            Profile::Off => 0,
            _ => 2 * self.header_bytes() + self.columns_per_packet * self.column_bytes(),
        }
    }

    /// The bytes of a column, header and footer included.
    #[inline]
    pub fn column<'a>(&self, packet: &'a [u8], column: usize) -> &'a [u8] {
        let start = self.header_bytes() + column * self.column_bytes();
        &packet[start..start + self.column_bytes()]
    }

    /// As [`Self::column`], to write.
    pub fn column_mut<'a>(&self, packet: &'a mut [u8], column: usize) -> &'a mut [u8] {
        let start = self.header_bytes() + column * self.column_bytes();
        &mut packet[start..start + self.column_bytes()]
    }

    /// The pixel blocks of neighbouring columns.
    pub(super) fn columns<'a>(&self, packet: &'a [u8], first: usize, count: usize) -> Columns<'a> {
        let stride = self.column_bytes();
        let start = self.header_bytes() + first * stride;
        Columns {
            bytes: &packet[start..start + count * stride][self.column_header_bytes()..],
            stride,
            length: self.blocks_bytes(),
            count,
        }
    }

    /// The pixel blocks of a column, to write.
    pub fn blocks_mut<'a>(&self, column: &'a mut [u8]) -> &'a mut [u8] {
        let bytes = self.blocks_bytes();
        &mut column[self.column_header_bytes()..][..bytes]
    }

    /// Reads the header of a column.
    #[inline]
    pub fn read_column(&self, column: &[u8]) -> ColumnHeader {
        let valid = match self.profile {
            Profile::Legacy => column[column.len() - LEGACY_COLUMN_FOOTER_BYTES] & 1 == 1,
            _ => column[10] & 1 == 1,
        };
        ColumnHeader { time_ns: u64_at(column, 0), measurement_id: u16_at(column, 8), valid }
    }

    /// The frame counter that LEGACY repeats in every column.
    #[inline]
    pub fn legacy_frame_id(&self, column: &[u8]) -> u32 {
        u32::from(u16_at(column, 10))
    }

    /// Writes the header (and LEGACY footer) of a column.
    pub fn write_column(
        &self,
        column: &mut [u8],
        header: ColumnHeader,
        frame_id: u32,
        columns_per_frame: usize,
    ) {
        column[..8].copy_from_slice(&header.time_ns.to_le_bytes());
        column[8..10].copy_from_slice(&header.measurement_id.to_le_bytes());
        if self.profile == Profile::Legacy {
            column[10..12].copy_from_slice(&frame_id.to_le_bytes()[..2]);
            let counts = u64::from(header.measurement_id) * LEGACY_ENCODER_COUNTS / columns_per_frame as u64;
            column[12..16].copy_from_slice(&counts.to_le_bytes()[..4]);
            let status = if header.valid { u32::MAX } else { 0 };
            let footer = column.len() - LEGACY_COLUMN_FOOTER_BYTES;
            column[footer..].copy_from_slice(&status.to_le_bytes());
        } else {
            column[10..12].copy_from_slice(&u16::from(header.valid).to_le_bytes());
        }
    }

    #[inline]
    fn header_bytes(&self) -> usize {
        if self.profile.has_packet_header() { HEADER_BYTES } else { 0 }
    }

    #[inline]
    fn column_bytes(&self) -> usize {
        let footer = if self.profile.has_packet_header() { 0 } else { LEGACY_COLUMN_FOOTER_BYTES };
        self.column_header_bytes() + self.blocks_bytes() + footer
    }

    #[inline]
    fn column_header_bytes(&self) -> usize {
        if self.profile.has_packet_header() { COLUMN_HEADER_BYTES } else { LEGACY_COLUMN_HEADER_BYTES }
    }

    #[inline]
    fn blocks_bytes(&self) -> usize {
        self.pixels_per_column * self.profile.layout().bytes
    }
}

/// CRC-64/XZ.
pub(crate) fn crc64(bytes: &[u8]) -> u64 {
    crc_fast::checksum(crc_fast::CrcAlgorithm::Crc64Xz, bytes)
}

/// Compares the checksum of a packet with a footer: `Err((stored, computed))` when they differ. Packets of firmware
/// that writes no checksum pass.
pub(crate) fn check_crc(packet: &[u8]) -> Result<(), (u64, u64)> {
    let Some((covered, stored)) = packet.split_last_chunk::<CRC_BYTES>() else { return Ok(()) };
    let stored = u64::from_le_bytes(*stored);
    if stored == 0 || stored == NO_CRC {
        return Ok(());
    }
    let computed = crc64(covered);
    if stored == computed { Ok(()) } else { Err((stored, computed)) }
}

/// Writes the checksum of a packet with a footer.
pub fn write_crc(packet: &mut [u8]) {
    if let Some((covered, stored)) = packet.split_last_chunk_mut::<CRC_BYTES>() {
        *stored = crc64(covered).to_le_bytes();
    }
}

#[inline]
pub(super) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

#[inline]
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    let bytes = &bytes[at..at + 4];
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

#[inline]
pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let bytes = &bytes[at..at + 8];
    u64::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3], bytes[4], bytes[5], bytes[6], bytes[7]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_crc_64_xz() {
        assert_eq!(crc64(b"123456789"), 0x995D_C9BB_DF19_39FA); // check value of the CRC catalogue
    }

    #[test]
    fn sizes_are_those_on_the_wire() {
        let of = |name, pixels| {
            let profile = Profile::from_name(name).unwrap();
            let header = HeaderKind::Standard;
            PacketFormat { profile, header, columns_per_packet: 16, pixels_per_column: pixels }.packet_bytes()
        };
        assert_eq!(of("LEGACY", 64), 12_608);
        assert_eq!(of("LEGACY", 32), 6_464);
        assert_eq!(of("LEGACY", 128), 24_896);
        assert_eq!(of("RNG15_RFL8_NIR8", 128), 8_448);
        assert_eq!(of("RNG19_RFL8_SIG16_NIR16_DUAL", 32), 8_448);
        assert_eq!(of("FUSA_RNG15_RFL8_NIR8_DUAL", 128), 16_640);
        assert_eq!(of("RNG19_RFL8_SIG16_NIR16", 128), 24_832);
        assert_eq!(of("OFF", 128), 0);
    }

    #[test]
    fn headers_round_trip() {
        let header = Header {
            kind: PacketKind::Zone,
            frame_id: 0xBEEF,
            init_id: 0xAB_CDEF,
            serial: 0x12_3456_789A,
            health: Health {
                alert_flags: 144,
                thermal_countdown_s: 29,
                shot_limiting_countdown_s: 3,
                thermal_shutdown: 1,
                shot_limiting: 9,
            },
        };
        for kind in [HeaderKind::Standard, HeaderKind::Fusa] {
            let mut packet = [0xFF; 64];
            header.write(kind, &mut packet);
            assert_eq!(Header::read(kind, &packet), Some(header), "{kind:?}");
        }
    }
}
