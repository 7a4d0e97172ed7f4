//! Foxglove's own schema of point clouds, in protobuf. Source: Foxglove message schemas, `foxglove.PointCloud`.

use std::borrow::Cow;

use ::foxglove::Encode;
use ::foxglove::messages::packed_element_field::NumericType;
use ::foxglove::messages::{PackedElementField, PointCloud, Pose, Quaternion, Timestamp, Vector3};

use super::super::{Cause, Cloud};
use super::Kind;

/// Points of one frame.
pub(super) const POINTS: Kind = Kind {
    topic: "points",
    schema: "foxglove.PointCloud",
    schema_encoding: "protobuf",
    schema_data: || PointCloud::get_schema().map_or(Cow::Borrowed(&[]), |schema| schema.data),
    encoding: "protobuf",
};

const FIELDS: [(&str, u32, NumericType); 10] = [
    ("x", 0, NumericType::Float32),
    ("y", 4, NumericType::Float32),
    ("z", 8, NumericType::Float32),
    ("intensity", 12, NumericType::Float32),
    ("t", 16, NumericType::Uint32),
    ("range", 20, NumericType::Uint32),
    ("ring", 24, NumericType::Uint16),
    ("ambient", 26, NumericType::Uint16),
    ("reflectivity", 28, NumericType::Uint8),
    ("return_number", 29, NumericType::Uint8),
];
const STRIDE: usize = 30;

/// A `foxglove.PointCloud`.
pub(super) fn points(cloud: &Cloud) -> Result<Vec<u8>, Cause> {
    let stamp_ns = cloud.stamp_ns();
    let seconds = u32::try_from(stamp_ns / 1_000_000_000)?;
    let field = |(name, offset, kind): (&str, u32, NumericType)| PackedElementField {
        name: name.into(),
        offset,
        r#type: kind as i32,
    };
    let message = PointCloud {
        timestamp: Some(Timestamp::new(seconds, (stamp_ns % 1_000_000_000) as u32)),
        frame_id: cloud.source.id.clone(),
        pose: Some(Pose {
            position: Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 }),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        point_stride: STRIDE as u32,
        fields: FIELDS.map(field).into(),
        data: packed(cloud).into(),
    };
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
    message.encode(&mut bytes)?;
    Ok(bytes)
}

fn packed(cloud: &Cloud) -> Vec<u8> {
    let mut data = Vec::with_capacity(cloud.points.len() * STRIDE);
    for point in &cloud.points {
        let position = point.position_m.as_vec3();
        for value in [position.x, position.y, position.z, point.intensity] {
            data.extend_from_slice(&value.to_le_bytes());
        }
        data.extend_from_slice(&cloud.since_start_ns(point).to_le_bytes());
        data.extend_from_slice(&point.range_mm.to_le_bytes());
        data.extend_from_slice(&point.ring.to_le_bytes());
        data.extend_from_slice(&point.near_ir.to_le_bytes());
        data.extend_from_slice(&[point.reflectivity, point.return_number]);
    }
    data
}
