//! LAS 1.4 and LAZ, point format 6 with the ring as an extra dimension, adjusted standard GPS time. Source: ASPRS LAS specification 1.4 R15.

use std::fs::File;
use std::io::Write as _;

use las::point::Format;
use las::{Builder, GpsTimeType, Header, Point, Transform, Vector, Version, Vlr, Writer, raw};

use super::gps::{gps_ns, year_and_day};
use super::sink::{Failure, Sink};
use super::{Cause, Cloud, CloudWriter, FileFrame};

/// Steps of stored coordinates, m: a tenth of what sensors resolve; 32 bits reach 214 km with it.
const STEP_M: f64 = 1e-4;

/// What GPS time is less by, so that it keeps more digits, ns ("adjusted standard GPS time").
const ADJUSTMENT_NS: i64 = 1_000_000_000_000_000_000;

/// Begun with the first frame: the header has its day, so that the same points give the same bytes.
pub(super) struct LasWriter {
    sink: Option<Sink>,
    writer: Option<Writer<Sink>>,
    compressed: bool,
    frame: FileFrame,
    failure: Failure,
}

impl LasWriter {
    pub(super) fn new(file: File, compressed: bool, frame: FileFrame) -> Self {
        let (sink, failure) = Sink::new(file);
        Self { sink: Some(sink), writer: None, compressed, frame, failure }
    }

    fn begin(&mut self, day: Option<(u16, u16)>) -> Result<(), Cause> {
        if let Some(sink) = self.sink.take() {
            self.writer = Some(Writer::new(sink, header(day, self.compressed, &self.frame)?)?);
        }
        Ok(())
    }
}

impl CloudWriter for LasWriter {
    /// `gps_time` is adjusted standard GPS time, `point_source_id` the sensor's number from 1.
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        let start_ns = cloud.stamp_ns();
        self.begin(Some(year_and_day(start_ns, cloud.scale())))?;
        let Some(writer) = &mut self.writer else { return self.failure.check() };
        for (point, echo) in cloud.echoes() {
            let gps_ns = gps_ns(start_ns.saturating_add(cloud.since_start_ns(point).into()), cloud.scale());
            writer.write_point(Point {
                x: point.position_m.x,
                y: point.position_m.y,
                z: point.position_m.z,
                intensity: point.intensity.clamp(0.0, f32::from(u16::MAX)) as u16,
                return_number: echo.number,
                number_of_returns: echo.of,
                point_source_id: cloud.source.number.saturating_add(1),
                user_data: point.reflectivity,
                gps_time: Some((gps_ns - ADJUSTMENT_NS) as f64 * 1e-9),
                extra_bytes: point.ring.to_le_bytes().to_vec(),
                ..Point::default()
            })?;
        }
        self.failure.check()
    }

    fn close(mut self: Box<Self>) -> Result<(), Cause> {
        self.begin(None)?;
        if let Some(writer) = self.writer {
            writer.into_inner()?.flush()?;
        }
        self.failure.check()
    }
}

fn header(day: Option<(u16, u16)>, compressed: bool, frame: &FileFrame) -> Result<Header, Cause> {
    let mut format = Format::new(6)?;
    format.extra_bytes = 2;
    format.is_compressed = compressed;
    let axis = |offset| Transform { scale: STEP_M, offset };
    let [x, y, z] = frame.origin.world_m().to_array().map(axis);
    let (file_creation_year, file_creation_day_of_year) = day.unwrap_or_default();
    let mut builder = Builder::new(raw::Header {
        file_creation_year,
        file_creation_day_of_year,
        ..raw::Header::default()
    })?;
    builder.version = Version::new(1, 4);
    builder.gps_time_type = GpsTimeType::Standard;
    builder.point_format = format;
    builder.transforms = Vector { x, y, z };
    builder.generating_software = concat!("outrigger ", env!("CARGO_PKG_VERSION")).into();
    builder.system_identifier = format!("LiDAR, {} frame", frame.name.unwrap_or("sensor"));
    builder.vlrs = vec![ring_dimension()];
    let mut header = builder.into_header()?;
    if let Some(wkt) = &frame.wkt {
        header.set_wkt_crs(format!("{wkt}\0").into_bytes())?; // the specification asks for a string that ends in 0
    }
    Ok(header)
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
