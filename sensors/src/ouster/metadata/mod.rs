//! What an Ouster sensor says about itself: packet format, beams, clock, identity.

mod json;
mod read;
mod synthetic;
mod write;

use glam::DAffine3;

pub use json::MetadataError;
pub use synthetic::Synthetic;

use super::profile::Profile;
use super::wire::{HeaderKind, PacketFormat};
use crate::SensorModel;

/// Everything about a sensor that its packets do not say.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Product line (`OS-1-64`); empty in reduced metadata of gen-1 sensors.
    pub product_line: String,
    /// Serial number as printed; empty when not stated.
    pub serial: String,
    /// Firmware image (`ousteros-image-prod-...-v2.3.0+...`); empty when not stated.
    pub firmware: String,
    /// Initialization id; 0 before firmware 2.2.
    pub init_id: u32,
    /// Lidar profile, with [`Profile::Off`] when the lidar port is 0.
    pub profile: Profile,
    /// IMU profile.
    pub imu_profile: ImuProfile,
    /// Header layout of packets that have one.
    pub header: HeaderKind,
    /// Columns in one revolution.
    pub columns_per_frame: usize,
    /// Columns in one packet.
    pub columns_per_packet: usize,
    /// Pixels in one column.
    pub pixels_per_column: usize,
    /// First and last column the sensor sends; first > last: the window goes through column 0.
    pub column_window: [usize; 2],
    /// How many columns each row of a picture is shifted so that a picture column is one azimuth.
    pub pixel_shift_by_row: Vec<i32>,
    /// Revolutions per second.
    pub frame_rate_hz: f64,
    /// UDP port of lidar packets, where stated.
    pub lidar_port: Option<u16>,
    /// UDP port of IMU packets, where stated.
    pub imu_port: Option<u16>,
    /// UDP port of zone packets, where stated.
    pub zone_port: Option<u16>,
    /// Where lidar packets are sent, where stated.
    pub destination: Option<String>,
    /// The clock behind the time stamps, where stated.
    pub timestamp_mode: Option<TimestampMode>,
    /// IMU packets in one revolution (ACCEL32 profile), 0 when their rate is independent of it.
    pub imu_packets_per_frame: usize,
    /// Samples in one IMU packet (ACCEL32 profile).
    pub imu_samples_per_packet: usize,
    /// Sensor frame from IMU frame.
    pub sensor_from_imu: DAffine3,
    /// Calibrated beams.
    pub model: SensorModel,
}

/// Format of IMU packets (`udp_profile_imu`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuProfile {
    /// 48 bytes: one sample in g and deg/s.
    Legacy,
    /// Header, GPS sentence and several samples in SI units.
    Accel32Gyro32Nmea,
    /// No IMU packets.
    Off,
}

/// The clock behind the time stamps (`timestamp_mode`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimestampMode {
    /// Since power-on.
    InternalOscillator,
    /// Sync pulse and GPS sentence: UTC with the leap seconds configured in the sensor.
    SyncPulseIn,
    /// PTP: TAI, 37 s ahead of UTC since 2017; a sensor that lost its master goes on from its own epoch.
    Ptp1588,
}

impl Metadata {
    /// Reads metadata of firmware 1.12 on, in the flat or the nested shape. `name` is what errors call the file.
    pub fn parse(text: &str, name: &str) -> Result<Self, MetadataError> {
        read::parse(text, name)
    }

    /// Metadata of an ideal sensor, for a mock or an encoder.
    pub fn synthetic(wanted: &Synthetic<'_>) -> Result<Self, MetadataError> {
        synthetic::metadata(wanted)
    }

    /// The nested JSON shape, as `GET /api/v1/sensor/metadata` answers it.
    pub fn to_json(&self) -> String {
        write::to_json(self)
    }

    /// The product line, or what is known without one.
    pub fn product(&self) -> String {
        match self.product_line.as_str() {
            "" => format!("Ouster with {} channels", self.pixels_per_column),
            line => line.to_owned(),
        }
    }

    /// Serial number as the packets carry it; `None` when not stated or not a number.
    pub fn serial_number(&self) -> Option<u64> {
        self.serial.parse().ok().filter(|serial| *serial != 0)
    }

    /// Sizes and offsets of the lidar packets.
    pub fn packet_format(&self) -> PacketFormat {
        PacketFormat {
            profile: self.profile,
            header: self.header,
            columns_per_packet: self.columns_per_packet,
            pixels_per_column: self.pixels_per_column,
        }
    }

    /// The same sensor set to another mode: what counts columns counts those of the new one. The shifts are made of those
    /// that were given: they lose nothing when the mode changes again.
    pub(crate) fn set_mode(&mut self, given: &Self, columns: usize, rate_hz: f64) {
        let before = self.columns_per_frame;
        let is_full = self.column_window == [0, before - 1];
        let [first, last] = self.column_window;
        self.column_window = match is_full {
            true => [0, columns - 1],
            false => [first * columns / before, ((last + 1) * columns / before).saturating_sub(1)],
        };
        let scale = columns as f64 / given.columns_per_frame as f64;
        for (shift, given) in self.pixel_shift_by_row.iter_mut().zip(&given.pixel_shift_by_row) {
            *shift = (f64::from(*given) * scale).round() as i32;
        }
        (self.columns_per_frame, self.frame_rate_hz) = (columns, rate_hz);
    }

    /// Mode as the configuration writes it: columns per revolution and revolutions per second.
    pub fn mode(&self) -> String {
        format!("{}x{}", self.columns_per_frame, self.frame_rate_hz)
    }

    /// Packets that a whole revolution could have, were the window full.
    pub(crate) fn packet_slots(&self) -> usize {
        self.columns_per_frame.div_ceil(self.columns_per_packet)
    }

    /// Whether a packet (by its place in the revolution) holds columns of the window.
    pub fn expects_slot(&self, slot: usize) -> bool {
        if self.profile == Profile::Off {
            return false;
        }
        let [first, last] = self.column_window.map(|column| column / self.columns_per_packet);
        if self.column_window[0] <= self.column_window[1] {
            (first..=last).contains(&slot)
        } else {
            slot >= first || slot <= last
        }
    }

    /// Lidar packets in one revolution: those that touch the column window.
    pub fn packets_per_frame(&self) -> usize {
        (0..self.packet_slots()).filter(|slot| self.expects_slot(*slot)).count()
    }

    /// Whether a column lies in the window.
    pub fn in_window(&self, column: usize) -> bool {
        let [first, last] = self.column_window;
        if first <= last { (first..=last).contains(&column) } else { column >= first || column <= last }
    }
}

impl ImuProfile {
    const ALL: [Self; 3] = [Self::Legacy, Self::Accel32Gyro32Nmea, Self::Off];

    /// Name in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::Legacy => "LEGACY",
            Self::Accel32Gyro32Nmea => "ACCEL32_GYRO32_NMEA",
            Self::Off => "OFF",
        }
    }

    /// By its name in metadata.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }
}

impl TimestampMode {
    const ALL: [Self; 3] = [Self::InternalOscillator, Self::SyncPulseIn, Self::Ptp1588];

    /// Name in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::InternalOscillator => "TIME_FROM_INTERNAL_OSC",
            Self::SyncPulseIn => "TIME_FROM_SYNC_PULSE_IN",
            Self::Ptp1588 => "TIME_FROM_PTP_1588",
        }
    }

    /// By its name in metadata.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }

    /// The clock, in words.
    pub fn clock(self) -> &'static str {
        match self {
            Self::InternalOscillator => "since power-on",
            Self::SyncPulseIn => "UTC by sync pulse",
            Self::Ptp1588 => "TAI by PTP",
        }
    }
}
