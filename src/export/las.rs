//! LAS 1.4 and LAZ, point format 6 with the ring as an extra dimension. Source: ASPRS LAS specification 1.4 R15.

use std::fs::File;
use std::io::Write as _;

use las::point::Format;
use las::{Builder, Point, Transform, Vector, Vlr, Writer};

use super::record::seconds;
use super::sink::{Failure, Sink};
use super::{Cause, Cloud, CloudWriter};

/// Steps of stored coordinates, m: a tenth of what sensors resolve; 32 bits reach 214 km with it.
const STEP_M: f64 = 1e-4;

pub(super) struct LasWriter {
    writer: Writer<Sink>,
    failure: Failure,
}

impl LasWriter {
    pub(super) fn new(file: File, compressed: bool) -> Result<Self, Cause> {
        let mut format = Format::new(6)?;
        format.extra_bytes = 2;
        format.is_compressed = compressed;
        let axis = Transform { scale: STEP_M, offset: 0.0 };
        let mut builder = Builder::default();
        builder.version = las::Version::new(1, 4);
        builder.point_format = format;
        builder.transforms = Vector { x: axis, y: axis, z: axis };
        builder.generating_software = concat!("outrigger ", env!("CARGO_PKG_VERSION")).into();
        builder.system_identifier = "LiDAR, sensor frame".into();
        builder.vlrs = vec![ring_dimension()];
        let (sink, failure) = Sink::new(file);
        Ok(Self { writer: Writer::new(sink, builder.into_header()?)?, failure })
    }
}

impl CloudWriter for LasWriter {
    /// `gps_time` is the device clock in seconds, `point_source_id` the sensor's number from 1.
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        for (point, echo) in cloud.echoes() {
            self.writer.write_point(Point {
                x: point.position_m.x,
                y: point.position_m.y,
                z: point.position_m.z,
                intensity: point.intensity.clamp(0.0, f32::from(u16::MAX)) as u16,
                return_number: echo.number,
                number_of_returns: echo.of,
                point_source_id: cloud.source.number.saturating_add(1),
                user_data: point.reflectivity,
                gps_time: Some(seconds(point.time_ns)),
                extra_bytes: point.ring.to_le_bytes().to_vec(),
                ..Point::default()
            })?;
        }
        self.failure.check()
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        let Self { writer, failure } = *self;
        writer.into_inner()?.flush()?;
        failure.check()
    }
}

/// Describes the two extra bytes of every point (specification, "Extra Bytes").
fn ring_dimension() -> Vlr {
    const UNSIGNED_SHORT: u8 = 3;
    let mut data = vec![0; 192];
    data[2] = UNSIGNED_SHORT;
    data[4..8].copy_from_slice(b"ring");
    let description = b"beam of the sensor";
    data[160..160 + description.len()].copy_from_slice(description);
    Vlr { user_id: "LASF_Spec".into(), record_id: 4, description: "Extra Bytes".into(), data }
}
