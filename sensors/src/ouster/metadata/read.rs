//! Metadata from JSON: the flat shape of old clients and the nested shape of the sensor's HTTP interface.
//!
//! Source of the two shapes and of what old firmware leaves out: Ouster firmware user manual, "Sensor metadata", and
//! metadata files of firmware 1.12 to 3.2.

use glam::{DAffine3, DMat3, DVec3};
use serde_json::Value;

use super::json::{MetadataError, Section, describe};
use super::{HeaderKind, ImuProfile, Metadata, Profile, TimestampMode};
use crate::catalogue;
use crate::model::{Beam, SensorModel};

const SECTIONS: [&str; 7] = [
    "beam_intrinsics",
    "calibration_status",
    "config_params",
    "imu_intrinsics",
    "lidar_data_format",
    "lidar_intrinsics",
    "sensor_info",
];
const MAX_UDP_PAYLOAD: usize = 65_535;
/// Gen-1 sensors, which do not say it: distance of the beams' origin from the axis.
const GEN1_BEAM_ORIGIN_MM: f64 = 12.163;
/// Sensors before firmware 2.0, which do not say it.
const DEFAULT_SENSOR_FROM_LIDAR_MM: [f64; 16] =
    [-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 36.18, 0.0, 0.0, 0.0, 1.0];
const DEFAULT_SENSOR_FROM_IMU_MM: [f64; 16] =
    [1.0, 0.0, 0.0, 6.253, 0.0, 1.0, 0.0, -11.775, 0.0, 0.0, 1.0, 7.645, 0.0, 0.0, 0.0, 1.0];

/// The document by topic; in the flat shape most topics are the document itself.
struct Document<'a> {
    info: Section<'a>,
    config: Section<'a>,
    beams: Section<'a>,
    lidar: Section<'a>,
    imu: Section<'a>,
    format: Option<Section<'a>>,
    imu_format: Option<Section<'a>>,
}

pub(super) fn parse(text: &str, name: &str) -> Result<Metadata, MetadataError> {
    let text = super::json::without_comments(text);
    let value: Value = serde_json::from_str(&text).map_err(|error| MetadataError::NotJson {
        name: name.to_owned(),
        line: error.line(),
        column: error.column(),
        reason: error.to_string(),
    })?;
    Document::new(only_one(&value, name)?, name)?.metadata()
}

/// Programs that know several sensors write a list of their metadata: one of one sensor is as good as what it lists.
fn only_one<'a>(value: &'a Value, name: &str) -> Result<&'a Value, MetadataError> {
    match value.as_array().map(Vec::as_slice) {
        None => Ok(value),
        Some([only]) => Ok(only),
        Some(list) => Err(MetadataError::Unexpected {
            name: name.to_owned(),
            path: "document".to_owned(),
            expected: "the metadata of one sensor".to_owned(),
            found: format!("a list of {}; give each in a file of its own", list.len()),
        }),
    }
}

impl<'a> Document<'a> {
    fn new(value: &'a Value, name: &'a str) -> Result<Self, MetadataError> {
        let top = value.as_object().ok_or_else(|| MetadataError::Unexpected {
            name: name.to_owned(),
            path: "document".to_owned(),
            expected: "an object".to_owned(),
            found: describe(value),
        })?;
        let whole = Section { name, path: "", object: top };
        if !SECTIONS.iter().any(|section| top.contains_key(*section)) {
            let format = optional(&whole, "data_format")?;
            let imu_format = optional(&whole, "imu_data_format")?;
            return Ok(Self {
                info: whole,
                config: whole,
                beams: whole,
                lidar: whole,
                imu: whole,
                format,
                imu_format,
            });
        }
        let missing: Vec<_> = SECTIONS.into_iter().filter(|section| !top.contains_key(*section)).collect();
        if !missing.is_empty() {
            let mixed = top.contains_key("prod_line") || top.contains_key("beam_altitude_angles");
            let hint = if mixed { ", and fields of the flat shape next to the nested ones" } else { "" };
            let expected = format!("the sections {} of nested metadata", missing.join(", "));
            return Err(whole.error(missing[0], expected, format!("nothing{hint}")));
        }
        let section =
            |key| optional(&whole, key)?.ok_or_else(|| whole.error(key, "an object", describe(&top[key])));
        Ok(Self {
            info: section("sensor_info")?,
            config: section("config_params")?,
            beams: section("beam_intrinsics")?,
            lidar: section("lidar_intrinsics")?,
            imu: section("imu_intrinsics")?,
            format: optional(&whole, "lidar_data_format")?,
            imu_format: optional(&whole, "imu_data_format")?,
        })
    }

    fn metadata(&self) -> Result<Metadata, MetadataError> {
        let product_line = self.info.text("prod_line")?.unwrap_or_default().to_owned();
        let (mode_columns, frame_rate_hz) = self.lidar_mode()?;
        let altitudes = self.angles("beam_altitude_angles", 90.0)?;
        let azimuths = self.angles("beam_azimuth_angles", 360.0)?;
        let pixels_per_column = self.format_integer("pixels_per_column", 1, 1024)?.unwrap_or(altitudes.len());
        for (key, angles) in [("beam_altitude_angles", &altitudes), ("beam_azimuth_angles", &azimuths)] {
            if angles.len() != pixels_per_column {
                let expected = format!("{pixels_per_column} angles, one per pixel of a column");
                return Err(self.beams.error(key, expected, format!("{} angles", angles.len())));
            }
        }
        let columns_per_frame = self.format_integer("columns_per_frame", 1, 16_384)?.unwrap_or(mode_columns);
        let last_column = columns_per_frame - 1;
        let columns_per_packet =
            self.format_integer("columns_per_packet", 1, columns_per_frame as u64)?.unwrap_or(16);
        let lidar_port = self.port("udp_port_lidar", "lidar")?;
        let profile = self.profile(lidar_port)?;
        let metadata = Metadata {
            serial: self.serial()?,
            firmware: self.info.text("image_rev")?.unwrap_or_default().to_owned(),
            init_id: self.info.integer("initialization_id", 0..=0xFF_FFFF)?.unwrap_or(0) as u32,
            profile,
            imu_profile: self.imu_profile()?,
            header: self.header(profile)?,
            columns_per_frame,
            columns_per_packet,
            pixels_per_column,
            column_window: self.column_window(last_column)?,
            pixel_shift_by_row: self.pixel_shifts(&azimuths, columns_per_frame)?,
            frame_rate_hz: self
                .format
                .map_or(Ok(None), |format| format.number("fps"))?
                .filter(|rate| *rate > 0.0)
                .unwrap_or(frame_rate_hz),
            lidar_port: lidar_port.filter(|port| *port != 0),
            imu_port: self.port("udp_port_imu", "imu")?.filter(|port| *port != 0),
            zone_port: self.port("udp_port_zm", "zm")?.filter(|port| *port != 0),
            destination: self.destination()?,
            timestamp_mode: named(&self.config, "timestamp_mode", TimestampMode::from_name)?,
            imu_packets_per_frame: self.imu_integer("imu_packets_per_frame")?,
            imu_samples_per_packet: self.imu_integer("imu_measurements_per_packet")?,
            sensor_from_imu: self.transform(
                &self.imu,
                "imu_to_sensor_transform",
                DEFAULT_SENSOR_FROM_IMU_MM,
            )?,
            model: self.model(&product_line, &altitudes, &azimuths)?,
            product_line,
        };
        let bytes = metadata.packet_format().packet_bytes();
        if bytes > MAX_UDP_PAYLOAD {
            let found = format!("{pixels_per_column} pixels in {columns_per_packet} columns, {bytes} B");
            return Err(self.beams.error("pixels_per_column", "packets of at most 65535 B", found));
        }
        Ok(metadata)
    }

    fn serial(&self) -> Result<String, MetadataError> {
        // some programs write it as a number
        match self.info.object.get("prod_sn").and_then(Value::as_u64) {
            Some(number) => Ok(number.to_string()),
            None => Ok(self.info.text("prod_sn")?.unwrap_or_default().to_owned()),
        }
    }

    /// `1024x10`: columns per revolution and revolutions per second. Reduced metadata without it: 1024x10.
    fn lidar_mode(&self) -> Result<(usize, f64), MetadataError> {
        let Some(mode) = self.config.text("lidar_mode")? else { return Ok((1024, 10.0)) };
        let parsed = mode.split_once('x').and_then(|(columns, rate)| {
            let columns: usize = columns.parse().ok()?;
            let rate: f64 = rate.parse().ok()?;
            ((1..=16_384).contains(&columns) && rate > 0.0 && rate.is_finite()).then_some((columns, rate))
        });
        parsed.ok_or_else(|| {
            self.config.error("lidar_mode", "columns x revolutions per second (1024x10)", format!("{mode:?}"))
        })
    }

    fn angles(&self, key: &str, limit_deg: f64) -> Result<Vec<f64>, MetadataError> {
        let angles = self.beams.numbers(key)?;
        let angles = angles.ok_or_else(|| self.beams.error(key, "a list of angles in degrees", "nothing"))?;
        if angles.is_empty() {
            return Err(self.beams.error(key, "at least one angle", "an empty list"));
        }
        if let Some(index) = angles.iter().position(|angle| angle.abs() > limit_deg) {
            let expected = format!("an angle within {limit_deg} degrees");
            return Err(self.beams.error(&format!("{key}[{index}]"), expected, angles[index].to_string()));
        }
        Ok(angles)
    }

    fn format_integer(&self, key: &str, least: u64, most: u64) -> Result<Option<usize>, MetadataError> {
        let Some(format) = self.format else { return Ok(None) };
        Ok(format.integer(key, least..=most)?.map(|number| number as usize))
    }

    fn imu_integer(&self, key: &str) -> Result<usize, MetadataError> {
        let Some(format) = self.imu_format else { return Ok(0) };
        Ok(format.integer(key, 0..=1024)?.unwrap_or(0) as usize)
    }

    /// The port under its own key, or in the newer per-stream objects of the configuration.
    fn port(&self, key: &str, stream: &str) -> Result<Option<u16>, MetadataError> {
        if let Some(port) = self.config.integer(key, 0..=65_535)? {
            return Ok(Some(port as u16));
        }
        let port = self.config.object.get(stream).and_then(|value| value.get("udp")?.get("port")?.as_u64());
        Ok(port.and_then(|port| u16::try_from(port).ok()))
    }

    fn destination(&self) -> Result<Option<String>, MetadataError> {
        let destination = match self.config.text("udp_dest")? {
            Some(text) => Some(text),
            None => self.config.text("udp_ip")?,
        };
        Ok(destination.filter(|text| !text.is_empty()).map(str::to_owned))
    }

    fn profile(&self, lidar_port: Option<u16>) -> Result<Profile, MetadataError> {
        if lidar_port == Some(0) {
            return Ok(Profile::Off);
        }
        let Some(format) = self.format else { return Ok(Profile::Legacy) };
        Ok(named(&format, "udp_profile_lidar", Profile::from_name)?.unwrap_or(Profile::Legacy))
    }

    fn imu_profile(&self) -> Result<ImuProfile, MetadataError> {
        let Some(format) = self.format else { return Ok(ImuProfile::Legacy) };
        Ok(named(&format, "udp_profile_imu", ImuProfile::from_name)?.unwrap_or(ImuProfile::Legacy))
    }

    fn header(&self, profile: Profile) -> Result<HeaderKind, MetadataError> {
        if let Some(kind) = HeaderKind::of(profile) {
            return Ok(kind);
        }
        let stated = match self.format {
            Some(format) => named(&format, "header_type", HeaderKind::from_name)?,
            None => None,
        };
        let stated = stated.map_or_else(
            || named(&self.config, "header_type", HeaderKind::from_name),
            |kind| Ok(Some(kind)),
        )?;
        Ok(stated.unwrap_or(HeaderKind::Standard))
    }

    fn column_window(&self, last_column: usize) -> Result<[usize; 2], MetadataError> {
        let Some(format) = self.format else { return Ok([0, last_column]) };
        let Some(window) = format.integers("column_window")? else { return Ok([0, last_column]) };
        let columns: Vec<usize> = window.iter().filter_map(|column| usize::try_from(*column).ok()).collect();
        match columns[..] {
            [first, last] if window.len() == 2 && first <= last_column && last <= last_column => {
                Ok([first, last])
            }
            _ => Err(format.error(
                "column_window",
                format!("two columns from 0 to {last_column}"),
                format!("{window:?}"),
            )),
        }
    }

    /// Gen-1 sensors with 64 beams do not say their shifts; they are those of the beam pattern.
    fn pixel_shifts(&self, azimuths_deg: &[f64], columns: usize) -> Result<Vec<i32>, MetadataError> {
        let rows = azimuths_deg.len();
        let stated = self.format.map_or(Ok(None), |format| format.integers("pixel_shift_by_row"))?;
        if let (Some(shifts), Some(format)) = (stated, self.format) {
            let key = "pixel_shift_by_row";
            if shifts.len() != rows {
                return Err(format.error(key, format!("{rows} shifts"), format!("{} shifts", shifts.len())));
            }
            let small = |shift: i64| {
                i32::try_from(shift).ok().filter(|shift| shift.unsigned_abs() as usize <= columns)
            };
            let shifts: Option<Vec<i32>> = shifts.iter().map(|shift| small(*shift)).collect();
            return shifts.ok_or_else(|| format.error(key, "shifts within one revolution", "a greater one"));
        }
        if rows == 64 {
            return Ok((0..rows).map(|row| ((3 - row % 4) * 6 * columns / 1024) as i32).collect());
        }
        Ok(azimuths_deg.iter().map(|azimuth| (azimuth / 360.0 * columns as f64).round() as i32).collect())
    }

    /// A rigid transform of 16 row-major numbers in mm, or the default of old firmware.
    fn transform(
        &self,
        section: &Section<'_>,
        key: &str,
        default: [f64; 16],
    ) -> Result<DAffine3, MetadataError> {
        let matrix = self.matrix(section, key)?.unwrap_or(default);
        let row = |row: usize| DVec3::new(matrix[4 * row], matrix[4 * row + 1], matrix[4 * row + 2]);
        let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        if (rotation * rotation.transpose() - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-3) {
            let translation_m = DVec3::new(matrix[3], matrix[7], matrix[11]) * 1e-3;
            Ok(DAffine3::from_mat3_translation(rotation, translation_m))
        } else {
            Err(section.error(key, "a rotation and a translation in mm", format!("{matrix:?}")))
        }
    }

    fn matrix(&self, section: &Section<'_>, key: &str) -> Result<Option<[f64; 16]>, MetadataError> {
        let Some(numbers) = section.numbers(key)? else { return Ok(None) };
        let found = format!("{} numbers", numbers.len());
        numbers.try_into().map(Some).map_err(|_| section.error(key, "16 numbers, row by row", found))
    }

    fn model(
        &self,
        product_line: &str,
        altitudes: &[f64],
        azimuths: &[f64],
    ) -> Result<SensorModel, MetadataError> {
        let (radial_mm, z_mm) = match self.matrix(&self.beams, "beam_to_lidar_transform")? {
            Some(matrix) => (matrix[3], matrix[11]),
            None => {
                let stated = self.beams.number("lidar_origin_to_beam_origin_mm")?;
                (stated.unwrap_or_else(|| default_beam_origin_mm(product_line)), 0.0)
            }
        };
        let beams = altitudes.iter().zip(azimuths).map(|(altitude, azimuth)| Beam {
            elevation_rad: altitude.to_radians(),
            azimuth_offset_rad: azimuth.to_radians(),
            origin_radial_m: radial_mm * 1e-3,
            origin_z_m: z_mm * 1e-3,
            range_offset_m: radial_mm.hypot(z_mm) * 1e-3,
            fire_offset_ns: 0.0,
        });
        let sensor_from_lidar =
            self.transform(&self.lidar, "lidar_to_sensor_transform", DEFAULT_SENSOR_FROM_LIDAR_MM)?;
        let nominal = match catalogue_name(product_line) {
            Some(name) => catalogue::nominal(&name).ok(),
            None => nominal_of_beams(altitudes),
        };
        let name = match &nominal {
            Some(nominal) if product_line.is_empty() => &nominal.name,
            _ => product_line,
        };
        let mut model = SensorModel::new(name, beams.collect(), sensor_from_lidar);
        if let Some(nominal) = nominal {
            model.min_range_m = nominal.min_range_m;
            model.max_range_m = nominal.max_range_m;
            model.divergence_rad = nominal.divergence_rad;
            model.housing_radius_m = nominal.housing_radius_m;
            model.housing_height_m = nominal.housing_height_m;
        }
        Ok(model)
    }
}

/// Beams of a unit lie this near to those of its product, degrees.
const UNIT_SPREAD_DEG: f64 = 1.0;

/// `OS-1-128-AH` -> `os1-128`.
fn catalogue_name(product_line: &str) -> Option<String> {
    let mut parts = product_line.split('-');
    Some(format!("{}{}-{}", parts.next()?, parts.next()?, parts.next()?).to_ascii_lowercase())
}

/// The nominal sensor with these elevations, degrees, top first: the first ones do not state their product.
fn nominal_of_beams(altitudes: &[f64]) -> Option<SensorModel> {
    let off_deg = |model: &SensorModel| {
        let beams = model.beams().iter().zip(altitudes);
        beams.map(|(beam, altitude)| (beam.elevation_rad.to_degrees() - altitude).abs()).fold(0.0, f64::max)
    };
    let ousters = catalogue::names().into_iter().filter(|name| name.starts_with("os"));
    let nominals = ousters.filter_map(|name| catalogue::nominal(name).ok());
    let alike = nominals.filter(|model| model.channels() == altitudes.len());
    alike.min_by(|a, b| off_deg(a).total_cmp(&off_deg(b))).filter(|model| off_deg(model) <= UNIT_SPREAD_DEG)
}

/// What sensors of firmware before 2.0 leave out.
fn default_beam_origin_mm(product_line: &str) -> f64 {
    match product_line.get(..5) {
        Some("OS-0-") => 27.67,
        Some("OS-1-") => 15.806,
        Some("OS-2-") => 13.762,
        _ => GEN1_BEAM_ORIGIN_MM,
    }
}

/// A section, or `None` when the firmware does not know it: old sensors answer with an error text in its place.
fn optional<'a>(whole: &Section<'a>, key: &'a str) -> Result<Option<Section<'a>>, MetadataError> {
    match whole.object.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(text)) if text.starts_with("error") => Ok(None),
        Some(Value::Object(object)) => Ok(Some(Section { name: whole.name, path: key, object })),
        Some(other) => Err(whole.error(key, "an object", describe(other))),
    }
}

/// A value that must be one of a list of names.
fn named<T>(
    section: &Section<'_>,
    key: &str,
    from_name: fn(&str) -> Option<T>,
) -> Result<Option<T>, MetadataError> {
    let Some(name) = section.text(key)? else { return Ok(None) };
    from_name(name).map(Some).ok_or_else(|| section.error(key, "a known name", format!("{name:?}")))
}
