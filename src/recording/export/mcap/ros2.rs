//! ROS 2 messages: `sensor_msgs/msg/PointCloud2` and `sensor_msgs/msg/Imu`.
//!
//! Fields are those of the sensors' own ROS drivers. Sources: ouster-ros `ouster_ros::Point` (point type `original`),
//! velodyne_pointcloud `PointXYZIRT`; sensor_msgs of ROS 2 Humble; ROS REP-103 and REP-145.

use std::borrow::Cow;

use sensors::ouster::ImuSample;

use super::super::{Cause, Cloud, Kind, Point, Source};
use super::cdr::Cdr;
use crate::recording::packet_writer::ros2_transforms_definition;

/// Points of one frame.
pub(super) const POINTS: Kind = Kind {
    topic: "points",
    schema: "sensor_msgs/msg/PointCloud2",
    schema_encoding: "ros2msg",
    schema_data: || Cow::Borrowed(include_bytes!("PointCloud2.msg")),
    encoding: "cdr",
};

/// One inertial sample.
pub(super) const IMU: Kind = Kind {
    topic: "imu",
    schema: "sensor_msgs/msg/Imu",
    schema_encoding: "ros2msg",
    schema_data: || Cow::Borrowed(include_bytes!("Imu.msg")),
    encoding: "cdr",
};

/// Frames and where they are in others.
pub(super) const TRANSFORMS: Kind = Kind {
    topic: "tf",
    schema: "tf2_msgs/msg/TFMessage",
    schema_encoding: "ros2msg",
    schema_data: || Cow::Owned(ros2_transforms_definition().into_bytes()),
    encoding: "cdr",
};

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

/// A `PointCloud2`.
pub(super) fn points(cloud: &Cloud) -> Result<Vec<u8>, Cause> {
    let velodyne = cloud.source.vendor == "Velodyne";
    let (fields, step) = if velodyne { VELODYNE } else { OUSTER };
    let points = u32::try_from(cloud.points.len())?;
    let bytes = points.checked_mul(step).ok_or("more points than a message can hold")?;
    let mut cdr = Cdr::new();
    header(&mut cdr, cloud.frame_name(), cloud.stamp_ns());
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
    out.extend_from_slice(&point.near_ir.unwrap_or(0).to_le_bytes());
    out.extend_from_slice(&[0; 2]);
    out.extend_from_slice(&point.range_mm.to_le_bytes());
}

/// An `Imu`. A covariance that begins with -1 says that orientation is not measured; zeros, that the variance is not known.
pub(super) fn imu(source: &Source, sample: &ImuSample, stamp_ns: u64) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, &source.id, stamp_ns);
    let mut no_orientation = [0.0; 9];
    no_orientation[0] = -1.0;
    let unknown = [0.0; 9];
    for values in [
        &[0.0, 0.0, 0.0, 1.0][..],
        &no_orientation,
        &sample.angular_rate_rad_s,
        &unknown,
        &sample.acceleration_m_s2,
        &unknown,
    ] {
        for value in values {
            cdr.f64(*value);
        }
    }
    cdr.into_bytes()
}

fn header(cdr: &mut Cdr, frame: &str, stamp_ns: u64) {
    cdr.u32((stamp_ns / 1_000_000_000) as u32); // builtin_interfaces/Time holds 32 bits of seconds
    cdr.u32((stamp_ns % 1_000_000_000) as u32);
    cdr.string(frame);
}
