//! Metadata of an ideal sensor, made from a model of the catalogue.

use glam::{DAffine3, DVec3};

use super::{HeaderKind, ImuProfile, Metadata, MetadataError, Profile, TimestampMode};
use crate::catalogue;

/// An ideal sensor to make metadata for. Start from [`Synthetic::new`] and change fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthetic<'a> {
    /// Catalogue name of an Ouster (`os1-64`).
    pub model_name: &'a str,
    /// Serial number, 40 bits.
    pub serial: u64,
    /// Lidar profile.
    pub profile: Profile,
    /// IMU profile.
    pub imu_profile: ImuProfile,
    /// Header layout; FUSA profiles have theirs anyway.
    pub header: HeaderKind,
    /// Columns in one revolution, a multiple of `columns_per_packet`.
    pub columns_per_frame: usize,
    /// Columns in one packet.
    pub columns_per_packet: usize,
    /// First and last column; first > last goes through column 0.
    pub column_window: [usize; 2],
    /// Revolutions per second.
    pub frame_rate_hz: f64,
    /// UDP port of lidar packets.
    pub lidar_port: u16,
    /// UDP port of IMU packets.
    pub imu_port: u16,
    /// Initialization id, 24 bits.
    pub init_id: u32,
    /// Clock.
    pub timestamp_mode: TimestampMode,
}

impl<'a> Synthetic<'a> {
    /// A sensor as it leaves the factory: 1024 columns at 10 Hz, default ports, internal clock.
    pub fn new(model_name: &'a str, serial: u64, profile: Profile) -> Self {
        Self {
            model_name,
            serial,
            profile,
            imu_profile: ImuProfile::Legacy,
            header: HeaderKind::of(profile).unwrap_or(HeaderKind::Standard),
            columns_per_frame: 1024,
            columns_per_packet: 16,
            column_window: [0, 1023],
            frame_rate_hz: 10.0,
            lidar_port: 7502,
            imu_port: 7503,
            init_id: 1,
            timestamp_mode: TimestampMode::InternalOscillator,
        }
    }

    /// With so many columns in a revolution and a full window.
    pub fn columns(mut self, columns_per_frame: usize, columns_per_packet: usize) -> Self {
        self.columns_per_frame = columns_per_frame;
        self.columns_per_packet = columns_per_packet;
        self.column_window = [0, columns_per_frame.saturating_sub(1)];
        self
    }
}

pub(super) fn metadata(wanted: &Synthetic<'_>) -> Result<Metadata, MetadataError> {
    let error = |path: &str, expected: &str, found: String| MetadataError::Unexpected {
        name: format!("synthetic {}", wanted.model_name),
        path: path.to_owned(),
        expected: expected.to_owned(),
        found,
    };
    let mut model = catalogue::nominal(wanted.model_name)
        .map_err(|reason| error("model_name", "a model of the catalogue", reason.to_string()))?;
    let lower = wanted.model_name.to_ascii_lowercase();
    let product_line = lower
        .strip_prefix("os")
        .filter(|rest| rest.starts_with(|letter: char| letter.is_ascii_digit()) || rest.starts_with("dome-"))
        .map(|rest| format!("OS-{}", rest.to_ascii_uppercase()))
        .ok_or_else(|| error("model_name", "an Ouster", wanted.model_name.to_owned()))?;
    let (columns, per_packet) = (wanted.columns_per_frame, wanted.columns_per_packet);
    if per_packet == 0 || columns == 0 || columns > 16_384 || columns % per_packet != 0 {
        let expected = "1 to 16384 columns, a multiple of the columns of a packet";
        return Err(error("columns_per_frame", expected, format!("{columns} in packets of {per_packet}")));
    }
    if wanted.column_window.iter().any(|column| *column >= columns) {
        return Err(error("column_window", "columns of the frame", format!("{:?}", wanted.column_window)));
    }
    if wanted.serial == 0 || wanted.serial >> 40 != 0 || wanted.init_id >> 24 != 0 {
        let found = format!("{} and {}", wanted.serial, wanted.init_id);
        return Err(error("serial, init_id", "a serial of 1 to 40 bits and an id of 24", found));
    }
    if !(wanted.frame_rate_hz.is_finite() && wanted.frame_rate_hz > 0.0) {
        return Err(error("frame_rate_hz", "a positive rate", wanted.frame_rate_hz.to_string()));
    }
    if wanted.profile == Profile::Legacy && wanted.imu_profile == ImuProfile::Accel32Gyro32Nmea {
        let expected = "LEGACY or OFF with LEGACY lidar packets";
        return Err(error("imu_profile", expected, wanted.imu_profile.name().to_owned()));
    }
    let header = HeaderKind::of(wanted.profile).unwrap_or(wanted.header);
    let azimuths = model.beams().iter().map(|beam| beam.azimuth_offset_rad / std::f64::consts::TAU);
    let pixel_shift_by_row = azimuths.map(|turns| (turns * columns as f64).round() as i32).collect();
    let accel32 = wanted.imu_profile == ImuProfile::Accel32Gyro32Nmea;
    model.name.clone_from(&product_line);
    let metadata = Metadata {
        product_line,
        serial: wanted.serial.to_string(),
        firmware: firmware_of(wanted.profile).to_owned(),
        init_id: wanted.init_id,
        profile: wanted.profile,
        imu_profile: wanted.imu_profile,
        header,
        columns_per_frame: columns,
        columns_per_packet: per_packet,
        pixels_per_column: model.channels(),
        column_window: wanted.column_window,
        pixel_shift_by_row,
        frame_rate_hz: wanted.frame_rate_hz,
        lidar_port: (wanted.profile != Profile::Off).then_some(wanted.lidar_port),
        imu_port: (wanted.imu_profile != ImuProfile::Off).then_some(wanted.imu_port),
        zone_port: None,
        destination: None,
        timestamp_mode: Some(wanted.timestamp_mode),
        imu_packets_per_frame: if accel32 { 8 } else { 0 },
        imu_samples_per_packet: if accel32 { 8 } else { 0 },
        sensor_from_imu: DAffine3::from_translation(DVec3::new(-0.002_441, -0.009_725, 0.007_533)),
        model,
    };
    let bytes = metadata.packet_format().packet_bytes();
    if bytes > 65_507 {
        return Err(error("columns_per_packet", "packets of at most 65507 B", format!("{bytes} B")));
    }
    Ok(metadata)
}

/// A firmware that speaks the profile; clients look at it to decide what else to expect.
fn firmware_of(profile: Profile) -> &'static str {
    match profile {
        Profile::Legacy => "ousteros-image-prod-bootes-v2.5.3+mock",
        _ => "ousteros-image-prod-bootes-v3.2.0+mock",
    }
}
