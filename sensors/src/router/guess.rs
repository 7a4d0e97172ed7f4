//! What a packet looks like to someone who knows the formats but no sensor: for recordings without metadata, and to
//! say why no sensor took a packet.

use crate::ouster::wire::{Header, PacketFormat, PacketKind};
use crate::ouster::{HeaderKind, Profile, imu, zones};
use crate::velodyne::wire::{DATA_PACKET_BYTES, POSITION_PACKET_BYTES};

/// Pixels per column and columns per packet that Ouster sensors are built with or can be set to.
const PIXELS: [usize; 4] = [128, 64, 32, 16];
const COLUMNS: [usize; 5] = [16, 8, 4, 2, 1];
/// Columns of the largest lidar mode (4096x5).
const MOST_COLUMNS: u16 = 4096;
/// Most samples an ACCEL32_GYRO32_NMEA packet is tried with.
const MOST_IMU_SAMPLES: usize = 128;
/// What an accelerometer shows at least, m/s²: zero-filled payloads are not several inertial packets.
const LEAST_WEIGHT_M_S2: f64 = 0.1;
/// Of several formats that a packet can have, so many are named.
const SHOWN_FORMATS: usize = 2;
/// The four flags of Velodyne blocks begin with this byte.
const VELODYNE_FLAG: u8 = 0xFF;

/// What a packet looks like.
#[derive(Clone, Debug, PartialEq)]
pub enum Guess {
    /// An Ouster lidar packet: size alone does not tell its profile, so there may be several.
    OusterLidar {
        /// Absent in LEGACY packets.
        header: Option<Header>,
        /// Every format of this size with plausible columns.
        formats: Vec<PacketFormat>,
    },
    /// An Ouster IMU packet; LEGACY ones carry no header.
    OusterImu {
        /// Absent in LEGACY packets.
        header: Option<Header>,
    },
    /// An Ouster zone packet.
    OusterZone {
        /// Sensor that the packet names.
        header: Header,
    },
    /// A Velodyne data packet.
    VelodyneData,
    /// A Velodyne position packet.
    VelodynePosition,
    /// Velodyne blocks in a packet of another length.
    VelodyneBlocks,
    /// None of these.
    Unknown,
}

impl Guess {
    /// Looks at a payload.
    pub fn of(payload: &[u8]) -> Self {
        if let Some(guess) = Self::of_velodyne(payload) {
            return guess;
        }
        if let Some(header) = ouster_header(payload) {
            return match header.kind {
                PacketKind::Zone => Self::OusterZone { header },
                PacketKind::Imu => Self::OusterImu { header: Some(header) },
                PacketKind::Lidar => Self::OusterLidar { header: Some(header), formats: framed(payload) },
            };
        }
        if payload.len() == imu::LEGACY_BYTES && is_legacy_imu(payload) {
            return Self::OusterImu { header: None };
        }
        let formats = legacy(payload);
        if formats.is_empty() { Self::Unknown } else { Self::OusterLidar { header: None, formats } }
    }

    /// Whether a payload looks like a Velodyne's: one packet is enough.
    pub(super) fn of_velodyne(payload: &[u8]) -> Option<Self> {
        let is_flag = |at: usize| {
            payload.get(at) == Some(&VELODYNE_FLAG)
                && payload.get(at + 1).is_some_and(|bank| [0xEE, 0xDD, 0xCC, 0xBB].contains(bank))
        };
        let velodyne_blocks = match payload.len() {
            // one of its blocks may be damaged
            DATA_PACKET_BYTES => (0..8).filter(|block| is_flag(100 * block)).count() >= 6,
            length => length > 200 && is_flag(0) && is_flag(100),
        };
        if velodyne_blocks {
            return Some(match payload.len() {
                DATA_PACKET_BYTES => Self::VelodyneData,
                _ => Self::VelodyneBlocks,
            });
        }
        if payload.len() == POSITION_PACKET_BYTES {
            let pulse_state = payload[202];
            let text = &payload[206..];
            if pulse_state <= 3 && (text.starts_with(b"$GP") || text.starts_with(b"$GN") || text[0] == 0) {
                return Some(Self::VelodynePosition);
            }
        }
        None
    }

    /// Serial number in a payload; what [`Guess::serial`] says, without looking for its format.
    pub(super) fn serial_in(payload: &[u8]) -> Option<u64> {
        if Self::of_velodyne(payload).is_some() {
            return None;
        }
        ouster_header(payload).map(|header| header.serial)
    }

    /// Whether an Ouster sent it.
    pub fn is_ouster(&self) -> bool {
        matches!(self, Self::OusterLidar { .. } | Self::OusterImu { .. } | Self::OusterZone { .. })
    }

    /// Serial number in the packet.
    pub fn serial(&self) -> Option<u64> {
        match self {
            Self::OusterLidar { header, .. } | Self::OusterImu { header } => {
                header.map(|header| header.serial)
            }
            Self::OusterZone { header } => Some(header.serial),
            _ => None,
        }
    }
}

impl std::fmt::Display for Guess {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::OusterLidar { formats, .. } => {
                let name = |format: &PacketFormat| {
                    format!("{} x {} pixels", format.profile.name(), format.pixels_per_column)
                };
                let shown: Vec<String> = formats.iter().take(SHOWN_FORMATS).map(name).collect();
                write!(out, "Ouster lidar packet ({}", shown.join(" or "))?;
                match formats.len().saturating_sub(SHOWN_FORMATS) {
                    0 => out.write_str(")"),
                    more => write!(out, " or {more} more of that size)"),
                }
            }
            Self::OusterImu { header: None } => out.write_str("Ouster IMU packet (LEGACY)"),
            Self::OusterImu { header: Some(_) } => out.write_str("Ouster IMU packet (ACCEL32_GYRO32_NMEA)"),
            Self::OusterZone { .. } => out.write_str("Ouster zone packet"),
            Self::VelodyneData => out.write_str("Velodyne data packet"),
            Self::VelodynePosition => out.write_str("Velodyne position packet"),
            Self::VelodyneBlocks => out.write_str("Velodyne-like blocks"),
            Self::Unknown => out.write_str("no LiDAR packet of a known format"),
        }
    }
}

/// The header, in whichever layout makes sense of the packet.
fn ouster_header(payload: &[u8]) -> Option<Header> {
    [HeaderKind::Standard, HeaderKind::Fusa].into_iter().find_map(|kind| {
        let header = Header::read(kind, payload)?;
        let fits = match header.kind {
            PacketKind::Zone => payload.len() == zones::PACKET_BYTES,
            PacketKind::Imu => (1..=MOST_IMU_SAMPLES).any(|count| imu::accel32_bytes(count) == payload.len()),
            PacketKind::Lidar => !framed(payload).is_empty(),
        };
        // a FUSA header read as a STANDARD one would have to begin with an initialization id of 0
        (fits && header.serial > 0).then_some(header)
    })
}

/// Formats with a packet header that have this size and consecutive columns.
fn framed(payload: &[u8]) -> Vec<PacketFormat> {
    let profiles = Profile::all().filter(|profile| !matches!(profile, Profile::Legacy | Profile::Off));
    of_size(payload, profiles)
}

fn legacy(payload: &[u8]) -> Vec<PacketFormat> {
    of_size(payload, std::iter::once(Profile::Legacy))
}

fn of_size(payload: &[u8], profiles: impl Iterator<Item = Profile>) -> Vec<PacketFormat> {
    let mut formats = Vec::new();
    for profile in profiles {
        for pixels_per_column in PIXELS {
            for columns_per_packet in COLUMNS {
                let header = HeaderKind::of(profile).unwrap_or(HeaderKind::Standard);
                let format = PacketFormat { profile, header, columns_per_packet, pixels_per_column };
                if format.packet_bytes() == payload.len() && columns_make_sense(&format, payload) {
                    formats.push(format);
                }
            }
        }
    }
    formats.sort_by_key(|format| std::cmp::Reverse(format.pixels_per_column)); // the more the likelier
    // packets of less than 16 columns are rare: believe in them only when nothing else fits
    let most = formats.iter().map(|format| format.columns_per_packet).max().unwrap_or(0);
    formats.retain(|format| format.columns_per_packet == most);
    formats
}

fn columns_make_sense(format: &PacketFormat, payload: &[u8]) -> bool {
    let first = format.read_column(format.column(payload, 0));
    let begins_well = first.measurement_id < MOST_COLUMNS
        && usize::from(first.measurement_id).is_multiple_of(format.columns_per_packet);
    let mut any_valid = false;
    let follow = (0..format.columns_per_packet).all(|index| {
        let column = format.read_column(format.column(payload, index));
        any_valid |= column.valid;
        !column.valid || usize::from(column.measurement_id) == usize::from(first.measurement_id) + index
    });
    begins_well && follow && (any_valid || format.profile != Profile::Legacy)
}

/// Whether a LEGACY inertial packet shows any weight.
pub(super) fn has_weight(payload: &[u8]) -> bool {
    let sample = payload.first_chunk().map(imu::read_legacy);
    sample.is_some_and(|sample| sample.acceleration_m_s2.iter().any(|value| value.abs() >= LEAST_WEIGHT_M_S2))
}

/// 48 bytes are no proof: the numbers must be those of a sensor on Earth.
fn is_legacy_imu(payload: &[u8]) -> bool {
    let Some(bytes) = payload.first_chunk() else { return false };
    let sample = imu::read_legacy(bytes);
    let within = |values: [f64; 3], most: f64| values.iter().all(|value| value.abs() <= most);
    within(sample.acceleration_m_s2, 160.0) && within(sample.angular_rate_rad_s, 70.0) && sample.time_ns > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velodyne_blocks_of_another_length_are_no_data_packet() {
        let mut payload = vec![0; 1212];
        for block in 0..12 {
            payload[block * 100..][..2].copy_from_slice(&[0xFF, 0xEE]);
        }
        assert_eq!(Guess::of(&payload), Guess::VelodyneBlocks);
        assert_eq!(Guess::of(&payload[..1206]), Guess::VelodyneData);
        assert_eq!(Guess::of(&[0; 1206]), Guess::Unknown);
    }
}
