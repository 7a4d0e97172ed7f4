//! MCAP with `sensor_msgs/msg/PointCloud2` in CDR, as ROS 2 bags hold them: Foxglove, Rerun and `ros2 bag` read it.
//!
//! Fields are those of the sensors' own ROS drivers. Sources: ouster-ros `ouster_ros::Point` (point type `original`),
//! velodyne_pointcloud `PointXYZIRT`; MCAP specification; ROS REP-103.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use super::cdr::Cdr;
use super::{Cause, Cloud, CloudWriter, Point};

const SCHEMA: &str = include_str!("PointCloud2.msg");
const UINT16: u8 = 4;
const UINT32: u8 = 6;
const FLOAT32: u8 = 7;

/// Name, offset, type of each field; bytes per point.
type Layout = (&'static [(&'static str, u32, u8)], u32);

const OUSTER: Layout = (
    &[
        ("x", 0, FLOAT32),
        ("y", 4, FLOAT32),
        ("z", 8, FLOAT32),
        ("intensity", 16, FLOAT32),
        ("t", 20, UINT32),
        ("reflectivity", 24, UINT16),
        ("ring", 26, UINT16),
        ("ambient", 28, UINT16),
        ("range", 32, UINT32),
    ],
    48,
);

const VELODYNE: Layout = (
    &[
        ("x", 0, FLOAT32),
        ("y", 4, FLOAT32),
        ("z", 8, FLOAT32),
        ("intensity", 12, FLOAT32),
        ("ring", 16, UINT16),
        ("time", 18, FLOAT32),
    ],
    22,
);

pub(super) struct McapWriter {
    writer: Writer<BufWriter<File>>,
    schema: u16,
    topics: BTreeMap<String, (u16, u32)>,
}

impl McapWriter {
    pub(super) fn new(file: File) -> Result<Self, Cause> {
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("outrigger ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd));
        let mut writer = options.create(BufWriter::new(file))?;
        let schema = writer.add_schema("sensor_msgs/msg/PointCloud2", "ros2msg", SCHEMA.as_bytes())?;
        Ok(Self { writer, schema, topics: BTreeMap::new() })
    }
}

impl CloudWriter for McapWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        let id = &cloud.source.id;
        if !self.topics.contains_key(id) {
            let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
            let channel = self.writer.add_channel(self.schema, &topic(id), "cdr", &metadata)?;
            self.topics.insert(id.clone(), (channel, 0));
        }
        let message = message(cloud)?;
        if let Some((channel_id, sequence)) = self.topics.get_mut(id) {
            let header = MessageHeader {
                channel_id: *channel_id,
                sequence: *sequence,
                log_time: if cloud.host_time_ns > 0 { cloud.host_time_ns } else { cloud.stamp_ns() },
                publish_time: cloud.stamp_ns(),
            };
            *sequence = sequence.wrapping_add(1);
            self.writer.write_to_known_channel(&header, &message)?;
        }
        Ok(())
    }

    fn close(mut self: Box<Self>) -> Result<(), Cause> {
        self.writer.finish()?;
        Ok(())
    }
}

/// `/NAME/points`, with what a ROS name may not hold turned into underscores.
fn topic(id: &str) -> String {
    let name: String = id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let digit_first = name.starts_with(|c: char| c.is_ascii_digit());
    format!("/{}{name}/points", if digit_first { "_" } else { "" })
}

fn message(cloud: &Cloud) -> Result<Vec<u8>, Cause> {
    let velodyne = cloud.source.vendor == "Velodyne";
    let (fields, step) = if velodyne { VELODYNE } else { OUSTER };
    let points = u32::try_from(cloud.points.len())?;
    let bytes = points.checked_mul(step).ok_or("more points than a message can hold")?;
    let mut cdr = Cdr::new();
    let stamp_ns = cloud.stamp_ns();
    cdr.u32((stamp_ns / 1_000_000_000) as u32); // builtin_interfaces/Time holds 32 bits of seconds
    cdr.u32((stamp_ns % 1_000_000_000) as u32);
    cdr.string(&cloud.source.id);
    cdr.u32(1); // height: a list, not a picture
    cdr.u32(points);
    cdr.u32(fields.len() as u32);
    for (name, offset, kind) in fields {
        cdr.string(name);
        cdr.u32(*offset);
        cdr.u8(*kind);
        cdr.u32(1);
    }
    cdr.u8(0); // little-endian
    cdr.u32(step);
    cdr.u32(bytes);
    cdr.byte_sequence(bytes, |out| {
        for point in &cloud.points {
            let start = out.len();
            append(cloud, point, velodyne, out);
            out.resize(start + step as usize, 0);
        }
    });
    cdr.u8(1); // dense: no point is invalid
    Ok(cdr.into_bytes())
}

fn append(cloud: &Cloud, point: &Point, velodyne: bool, out: &mut Vec<u8>) {
    let position = point.position_m.as_vec3();
    for value in [position.x, position.y, position.z] {
        out.extend_from_slice(&value.to_le_bytes());
    }
    let since_start_ns = cloud.since_start_ns(point);
    if velodyne {
        out.extend_from_slice(&point.intensity.to_le_bytes());
        out.extend_from_slice(&point.ring.to_le_bytes());
        out.extend_from_slice(&((f64::from(since_start_ns) * 1e-9) as f32).to_le_bytes());
        return;
    }
    out.extend_from_slice(&[0; 4]);
    out.extend_from_slice(&point.intensity.to_le_bytes());
    out.extend_from_slice(&since_start_ns.to_le_bytes());
    out.extend_from_slice(&u16::from(point.reflectivity).to_le_bytes());
    out.extend_from_slice(&point.ring.to_le_bytes());
    out.extend_from_slice(&point.near_ir.to_le_bytes());
    out.extend_from_slice(&[0; 2]);
    out.extend_from_slice(&point.range_mm.to_le_bytes());
}
