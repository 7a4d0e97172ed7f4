//! E57, one scan per frame. Source: ASTM E2807-11.

use std::fs::File;

use e57::{DateTime, E57Writer as Writer, Record, RecordDataType, RecordName, RecordValue};
use sha2::{Digest, Sha256};

use super::gps::gps_ns;
use super::{Cause, Cloud, CloudWriter};
use crate::base::files::hexadecimal;

pub(super) struct E57Writer {
    writer: Writer<File>,
    scans: u64,
    is_wide: bool,
}

impl E57Writer {
    /// `is_wide`: coordinates of 64 bits, for points far from the origin.
    pub(super) fn new(file: File, is_wide: bool) -> Result<Self, Cause> {
        Ok(Self { writer: Writer::new(file, &guid(b"outrigger file"))?, scans: 0, is_wide })
    }
}

impl CloudWriter for E57Writer {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        let source = &cloud.source;
        let name = format!("{} {}", source.id, cloud.frame_id);
        let identity = format!("{} {} {name} {}", self.scans, source.serial, cloud.start_time_ns);
        let columns = cloud.points.iter().map(|point| i64::from(point.column)).max().unwrap_or(0);
        let rings = cloud.points.iter().map(|point| i64::from(point.ring)).max().unwrap_or(0);
        let intensity = cloud.points.iter().map(|point| point.intensity).fold(0.0_f32, f32::max);
        let whole = |max| RecordDataType::Integer { min: 0, max };
        let metres = match self.is_wide {
            true => RecordDataType::Double { min: None, max: None },
            false => RecordDataType::Single { min: None, max: None },
        };
        let prototype = vec![
            Record { name: RecordName::CartesianX, data_type: metres.clone() },
            Record { name: RecordName::CartesianY, data_type: metres.clone() },
            Record { name: RecordName::CartesianZ, data_type: metres },
            Record {
                name: RecordName::Intensity,
                data_type: RecordDataType::Single { min: Some(0.0), max: Some(intensity) },
            },
            Record { name: RecordName::RowIndex, data_type: whole(rings) },
            Record { name: RecordName::ColumnIndex, data_type: whole(columns) },
            Record { name: RecordName::ReturnIndex, data_type: whole(1) },
            Record { name: RecordName::ReturnCount, data_type: whole(2) },
            Record {
                name: RecordName::TimeStamp,
                data_type: RecordDataType::Double { min: None, max: None },
            },
        ];
        let mut scan = self.writer.add_pointcloud(&guid(identity.as_bytes()), prototype)?;
        scan.set_name(Some(name));
        scan.set_sensor_vendor(Some(source.vendor.clone()));
        scan.set_sensor_model(Some(source.model.clone()));
        if !source.serial.is_empty() {
            scan.set_sensor_serial(Some(source.serial.clone()));
        }
        let gps_time = gps_ns(cloud.stamp_ns(), cloud.scale()) as f64 * 1e-9;
        scan.set_acquisition_start(Some(DateTime { gps_time, atomic_reference: false }));
        for (point, echo) in cloud.echoes() {
            let metres = |value: f64| match self.is_wide {
                true => RecordValue::Double(value),
                false => RecordValue::Single(value as f32),
            };
            let [x, y, z] = point.position_m.to_array().map(metres);
            scan.add_point(vec![
                x,
                y,
                z,
                RecordValue::Single(point.intensity),
                RecordValue::Integer(i64::from(point.ring)),
                RecordValue::Integer(i64::from(point.column)),
                RecordValue::Integer(i64::from(echo.number) - 1),
                RecordValue::Integer(i64::from(echo.of)),
                RecordValue::Double(f64::from(cloud.since_start_ns(point)) * 1e-9),
            ])?;
        }
        scan.finalize()?;
        self.scans += 1;
        Ok(())
    }

    fn close(mut self: Box<Self>) -> Result<(), Cause> {
        Ok(self.writer.finalize()?)
    }
}

/// A GUID that follows from what is described: the same points give the same bytes.
fn guid(of: &[u8]) -> String {
    let hash = Sha256::digest(of);
    let hex = hexadecimal(&hash[..16]);
    format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}
