//! Clouds in a bag: PointCloud2 as the drivers of Ouster, Velodyne, Hesai, RoboSense, Livox and nebula write it, and Livox's own
//! message. Where a field lies and how it is written comes from the message, never from its topic's name.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::cursor::{Cursor, Encoding};
use super::files;
use super::roles::Role;
use super::unpack::{ZSTD, unpack_zstd};
use super::{BagError, BagReader, Topic};
use crate::recording::export::Point;

/// Fields that hold a point's time, the first that there is.
const TIME_FIELDS: [&str; 6] = ["t", "time", "timestamp", "time_stamp", "offset_time", "timeStamp"];
/// Times of a point as fractions of a second lie so near the stamp of its cloud, s.
const MOST_OFFSET_S: f64 = 10.0;
/// Absolute times lie so near the stamp of their cloud, s.
const MOST_APART_S: f64 = 86_400.0;

/// One cloud.
pub struct BagCloud {
    /// Number of its topic.
    pub topic: usize,
    /// The frame of its points.
    pub frame_id: String,
    /// Of its header, ns since 1970: of the first or the last point, as its driver likes.
    pub stamp_ns: u64,
    /// When it was recorded, ns since 1970.
    pub record_time_ns: u64,
    /// Points with a return, in the order of the message; without times of their own they have that of the header.
    pub points: Vec<Point>,
}

/// Reads the clouds of a bag in the order of their record.
pub struct BagClouds {
    reader: BagReader,
    message: Vec<u8>,
    malformed: Vec<u64>,
    without_time: Vec<u64>,
}

impl BagClouds {
    /// Opens a bag, which messages call so.
    pub fn open(path: &Path, name: &str) -> Result<Self, BagError> {
        let mut reader = BagReader::new(Arc::new(files::find(path, name)?))?;
        let is_cloud = |topic: &Topic| matches!(Role::of(topic), Role::Cloud | Role::LivoxCloud);
        let clouds = reader.topics().iter().enumerate().filter(|(_, topic)| is_cloud(topic));
        let wanted = clouds.map(|(at, _)| at).collect();
        reader.restrict(wanted);
        Ok(Self { reader, message: Vec::new(), malformed: Vec::new(), without_time: Vec::new() })
    }

    /// All topics met so far.
    pub fn topics(&self) -> &[Topic] {
        self.reader.topics()
    }

    /// What is missing so far, in words.
    pub fn losses(&self) -> Vec<String> {
        let named = |counts: &[u64], what: &str| -> Vec<String> {
            let counted = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            counted.map(|(at, count)| format!("{}: {count} {what}", self.topics()[at].name)).collect()
        };
        let mut losses = self.reader.losses();
        losses.extend(named(&self.malformed, "clouds cannot be read"));
        losses.extend(named(&self.without_time, "clouds have no time for each point: all have the header's"));
        losses
    }

    /// The next cloud.
    #[expect(clippy::should_implement_trait, reason = "its errors end it")]
    pub fn next(&mut self) -> Result<Option<BagCloud>, BagError> {
        while let Some((topic, record_time_ns)) = self.reader.advance()? {
            let about = &self.reader.topics()[topic];
            let (role, encoding) = (Role::of(about), about.encoding);
            if !matches!(role, Role::Cloud | Role::LivoxCloud) {
                continue;
            }
            let is_second = about.name.ends_with("points2");
            let mut data = self.reader.data();
            if data.starts_with(&ZSTD) {
                // what does not unpack is no cloud
                data = if unpack_zstd(data, &mut self.message).is_ok() { &self.message } else { &[] };
            }
            let count = self.reader.topics().len();
            self.malformed.resize(count, 0);
            self.without_time.resize(count, 0);
            let read = match role {
                Role::LivoxCloud => livox(encoding, data),
                _ => point_cloud(encoding, data, if is_second { 2 } else { 1 }),
            };
            match read {
                Some(Read { frame_id, stamp_ns, points, has_times }) => {
                    self.without_time[topic] += u64::from(!has_times);
                    return Ok(Some(BagCloud { topic, frame_id, stamp_ns, record_time_ns, points }));
                }
                None => self.malformed[topic] += 1,
            }
        }
        Ok(None)
    }
}

struct Read {
    frame_id: String,
    stamp_ns: u64,
    points: Vec<Point>,
    has_times: bool,
}

/// Where a value lies in a point, and how it is written.
#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    datatype: u8,
    is_big_endian: bool,
}

impl Field {
    fn bytes(self) -> usize {
        match self.datatype {
            1 | 2 => 1,
            3 | 4 => 2,
            5..=7 => 4,
            _ => 8,
        }
    }

    fn is_float(self) -> bool {
        self.datatype >= 7
    }

    /// Its value in a point; none of these types loses a digit as `f64`.
    fn of(self, point: &[u8]) -> f64 {
        let mut bytes = [0; 8];
        let count = self.bytes();
        bytes[..count].copy_from_slice(&point[self.offset..self.offset + count]);
        if self.is_big_endian {
            bytes[..count].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        match self.datatype {
            1 => f64::from(a.cast_signed()),
            2 => f64::from(a),
            3 => f64::from(i16::from_le_bytes([a, b])),
            4 => f64::from(u16::from_le_bytes([a, b])),
            5 => f64::from(i32::from_le_bytes([a, b, c, d])),
            6 => f64::from(u32::from_le_bytes([a, b, c, d])),
            7 => f64::from(f32::from_le_bytes([a, b, c, d])),
            _ => f64::from_le_bytes(bytes),
        }
    }
}

fn point_cloud(encoding: Encoding, data: &[u8], return_number: u8) -> Option<Read> {
    let mut cursor = Cursor::new(encoding, data)?;
    let header = cursor.header()?;
    let (height, width) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let fields: Option<Vec<(&str, Field)>> = (0..cursor.count(13)?)
        .map(|_| {
            let (name, offset, datatype, _) = (cursor.string()?, cursor.u32()?, cursor.u8()?, cursor.u32()?);
            Some((name, Field { offset: offset as usize, datatype, is_big_endian: false }))
        })
        .collect();
    let is_big_endian = cursor.u8()? != 0;
    let (point_bytes, row_bytes) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let content = cursor.bytes()?;
    let row_bytes = if row_bytes == 0 { width.checked_mul(point_bytes)? } else { row_bytes };
    let is_whole = point_bytes > 0
        && width.checked_mul(point_bytes)? <= row_bytes
        && height.checked_mul(row_bytes)? <= content.len();
    if !is_whole {
        return None;
    }
    let fields = fields?;
    let known = |field: &Field| {
        (1..=8).contains(&field.datatype)
            && field.offset.checked_add(field.bytes()).is_some_and(|end| end <= point_bytes)
    };
    let field = |names: &[&str]| {
        let find = |wanted: &&str| fields.iter().find(|(name, field)| name == wanted && known(field));
        names.iter().find_map(find).map(|(_, field)| Field { is_big_endian, ..*field })
    };
    let [x, y, z] = [field(&["x"])?, field(&["y"])?, field(&["z"])?];
    let time = field(&TIME_FIELDS);
    let [intensity, reflectivity] = [field(&["intensity", "signal"]), field(&["reflectivity"])];
    let [ring, range] = [field(&["ring", "channel", "line"]), field(&["range"])];
    let near_ir = field(&["ambient", "near_ir", "noise"]);
    let mut points = Vec::with_capacity(height * width);
    let mut times = Vec::new();
    for row in content.chunks(row_bytes.max(1)).take(height) {
        for (column, point) in row.chunks_exact(point_bytes).take(width).enumerate() {
            let position_m = DVec3::new(x.of(point), y.of(point), z.of(point));
            // drivers write a missing return as NaN, or as zero
            if !position_m.is_finite() || position_m == DVec3::ZERO {
                continue;
            }
            let value = |field: Option<Field>| field.map(|field| field.of(point));
            times.extend(value(time));
            points.push(Point {
                position_m,
                range_mm: match range {
                    Some(range) if !range.is_float() => range.of(point) as u32,
                    _ => (position_m.length() * 1e3).round() as u32,
                },
                time_ns: header.stamp_ns,
                ring: value(ring).unwrap_or(0.0) as u16,
                column: column as u32,
                return_number,
                intensity: value(intensity).unwrap_or(0.0) as f32,
                reflectivity: value(reflectivity).unwrap_or(0.0) as u8,
                near_ir: value(near_ir).map(|value| value as u16),
            });
        }
    }
    let has_times = time.is_some_and(|time| set_times(&mut points, &times, time.is_float(), header.stamp_ns));
    Some(Read { frame_id: header.frame_id.to_owned(), stamp_ns: header.stamp_ns, points, has_times })
}

/// Dates points by the values of their time field; false where these make no sense.
fn set_times(points: &mut [Point], values: &[f64], is_float: bool, stamp_ns: u64) -> bool {
    let stamp_s = stamp_ns as f64 * 1e-9;
    let most = |apart: &dyn Fn(f64) -> f64| values.iter().map(|value| apart(*value)).fold(0.0, f64::max);
    if values.iter().any(|value| !value.is_finite()) {
        return false;
    }
    let since_stamp = |ns: f64| stamp_ns.saturating_add_signed(ns.round() as i64);
    let time_ns: &dyn Fn(f64) -> u64 = if !is_float {
        &|value| since_stamp(value)
    } else if most(&f64::abs) <= MOST_OFFSET_S {
        &|value| since_stamp(value * 1e9)
    } else if most(&|value| (value - stamp_s).abs()) <= MOST_APART_S {
        // whole seconds apart from the rest: ns since 1970 need more digits than there are
        &|value| (value.trunc() as u64).saturating_mul(1_000_000_000) + (value.fract() * 1e9).round() as u64
    } else if most(&|value| (value * 1e-9 - stamp_s).abs()) <= MOST_APART_S {
        &|value| value as u64
    } else {
        return false;
    };
    for (point, value) in points.iter_mut().zip(values) {
        point.time_ns = time_ns(*value);
    }
    true
}

/// `livox_ros_driver2/CustomMsg`.
fn livox(encoding: Encoding, data: &[u8]) -> Option<Read> {
    let mut cursor = Cursor::new(encoding, data)?;
    let header = cursor.header()?;
    let begin_ns = cursor.u64()?;
    cursor.u32()?; // number of points, which the sequence says again
    cursor.take(4)?; // the sensor's number, reserved
    let mut points = Vec::new();
    for _ in 0..cursor.count(19)? {
        let since_begin_ns = cursor.u32()?;
        let position_m = DVec3::new(cursor.f32()?.into(), cursor.f32()?.into(), cursor.f32()?.into());
        let (reflectivity, _tag, line) = (cursor.u8()?, cursor.u8()?, cursor.u8()?);
        if !position_m.is_finite() || position_m == DVec3::ZERO {
            continue;
        }
        points.push(Point {
            position_m,
            range_mm: (position_m.length() * 1e3).round() as u32,
            time_ns: begin_ns.saturating_add(since_begin_ns.into()),
            ring: line.into(),
            column: 0,
            return_number: 1,
            intensity: reflectivity.into(),
            reflectivity,
            near_ir: None,
        });
    }
    Some(Read { frame_id: header.frame_id.to_owned(), stamp_ns: header.stamp_ns, points, has_times: true })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMP_NS: u64 = 1_700_000_000_123_456_789;

    fn dated(values: &[f64], is_float: bool) -> Option<Vec<u64>> {
        let point = Point {
            position_m: DVec3::X,
            range_mm: 1000,
            time_ns: STAMP_NS,
            ring: 0,
            column: 0,
            return_number: 1,
            intensity: 0.0,
            reflectivity: 0,
            near_ir: None,
        };
        let mut points = vec![point; values.len()];
        set_times(&mut points, values, is_float, STAMP_NS)
            .then(|| points.iter().map(|point| point.time_ns).collect())
    }

    #[test]
    fn times_of_points_in_every_form() {
        assert_eq!(dated(&[0.0, 5e7], false), Some(vec![STAMP_NS, STAMP_NS + 50_000_000]));
        assert_eq!(dated(&[-0.1, 0.0], true), Some(vec![STAMP_NS - 100_000_000, STAMP_NS]));
        let absolute_s = dated(&[1_700_000_000.125, 1_700_000_000.25], true).unwrap();
        assert_eq!(absolute_s, [1_700_000_000_125_000_000, 1_700_000_000_250_000_000]);
        assert_eq!(dated(&[1.7e18], true), Some(vec![1_700_000_000_000_000_000]));
        assert_eq!(dated(&[1e12], true), None);
        assert_eq!(dated(&[f64::NAN], true), None);
    }
}
