//! Foxglove's own messages, in protobuf, for MCAP files and for the live server. Source: Foxglove message schemas
//! `foxglove.PointCloud`, `foxglove.VoxelGrid`, `foxglove.FrameTransforms`, `foxglove.JointStates`.

use std::borrow::Cow;

use ::foxglove::messages::packed_element_field::NumericType;
use ::foxglove::messages::{
    FrameTransform, FrameTransforms, JointState, JointStates, PackedElementField, PointCloud, Quaternion,
    Timestamp, Vector3, VoxelGrid,
};
use ::foxglove::{Encode, messages};
use glam::DVec3;

use super::{Cause, Cloud, Kind};
use crate::base::geometry::Pose;

/// Points of one frame.
pub const POINTS: Kind = kind("points", "foxglove.PointCloud", schema::<PointCloud>);
/// Cells of a map.
pub const VOXELS: Kind = kind("voxels", "foxglove.VoxelGrid", schema::<VoxelGrid>);
/// Where frames stand in each other.
pub const TRANSFORMS: Kind = kind("tf", "foxglove.FrameTransforms", schema::<FrameTransforms>);
/// Angles of axes.
pub const JOINTS: Kind = kind("joints", "foxglove.JointStates", schema::<JointStates>);

const fn kind(topic: &'static str, schema: &'static str, schema_data: fn() -> Cow<'static, [u8]>) -> Kind {
    Kind { topic, schema, schema_encoding: "protobuf", schema_data, encoding: "protobuf" }
}

fn schema<M: Encode>() -> Cow<'static, [u8]> {
    M::get_schema().map_or(Cow::Borrowed(&[]), |schema| schema.data)
}

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
pub(crate) fn points(cloud: &Cloud) -> Result<Vec<u8>, Cause> {
    let message = PointCloud {
        timestamp: Some(timestamp(cloud.stamp_ns())?),
        frame_id: cloud.frame_name().to_owned(),
        pose: Some(pose(&Pose::IDENTITY)),
        point_stride: STRIDE as u32,
        fields: FIELDS.map(field).into(),
        data: packed(cloud).into(),
    };
    encoded(&message)
}

/// Cells of a map that stand side by side, x first, then y, then z.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Voxels {
    /// Least corner, m.
    pub origin_m: DVec3,
    /// Edge of a cell, m.
    pub edge_m: f64,
    /// How many along x, y and z.
    pub cells: [usize; 3],
    /// What each is, and its red, green, blue and opacity.
    pub values: Vec<[u8; 5]>,
}

/// A `foxglove.VoxelGrid` with the fields `state`, `red`, `green`, `blue` and `alpha`.
pub(crate) fn voxels(time_ns: u64, frame_id: &str, voxels: &Voxels) -> Result<Vec<u8>, Cause> {
    let [columns, rows, _] = voxels.cells;
    let names = ["state", "red", "green", "blue", "alpha"];
    let field_of = |(offset, name)| field((name, offset, NumericType::Uint8));
    let message = VoxelGrid {
        timestamp: Some(timestamp(time_ns)?),
        frame_id: frame_id.into(),
        pose: Some(pose(&Pose { translation_m: voxels.origin_m, ..Pose::IDENTITY })),
        row_count: u32::try_from(rows)?,
        column_count: u32::try_from(columns)?,
        cell_size: Some(vector(DVec3::splat(voxels.edge_m))),
        slice_stride: u32::try_from(names.len() * columns * rows)?,
        row_stride: u32::try_from(names.len() * columns)?,
        cell_stride: names.len() as u32,
        fields: (0..).zip(names).map(field_of).collect(),
        data: voxels.values.concat().into(),
    };
    encoded(&message)
}

/// `foxglove.FrameTransforms`: the name of a frame, that of another, and the pose of the other in the first.
pub(crate) fn transforms(time_ns: u64, frames: &[(&str, &str, Pose)]) -> Result<Vec<u8>, Cause> {
    let timestamp = timestamp(time_ns)?;
    let transform = |(parent, child, pose): &(&str, &str, Pose)| FrameTransform {
        timestamp: Some(timestamp),
        parent_frame_id: (*parent).into(),
        child_frame_id: (*child).into(),
        translation: Some(vector(pose.translation_m)),
        rotation: Some(rotation(pose)),
    };
    encoded(&FrameTransforms { transforms: frames.iter().map(transform).collect() })
}

/// `foxglove.JointStates`: names of axes with their angles, rad.
pub(crate) fn joints(time_ns: u64, axes: &[(String, f64)]) -> Result<Vec<u8>, Cause> {
    let joint = |(name, angle_rad): &(String, f64)| JointState {
        name: name.clone(),
        position: Some(*angle_rad),
        ..JointState::default()
    };
    let joints = axes.iter().map(joint).collect();
    encoded(&JointStates { timestamp: Some(timestamp(time_ns)?), joints })
}

fn encoded<M: Encode>(message: &M) -> Result<Vec<u8>, Cause>
where
    M::Error: std::error::Error + Send + Sync + 'static,
{
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
    message.encode(&mut bytes)?;
    Ok(bytes)
}

fn timestamp(time_ns: u64) -> Result<Timestamp, Cause> {
    let seconds = u32::try_from(time_ns / 1_000_000_000)?;
    Ok(Timestamp::new(seconds, (time_ns % 1_000_000_000) as u32))
}

fn field((name, offset, kind): (&str, u32, NumericType)) -> PackedElementField {
    PackedElementField { name: name.into(), offset, r#type: kind as i32 }
}

fn vector(vector_m: DVec3) -> Vector3 {
    Vector3 { x: vector_m.x, y: vector_m.y, z: vector_m.z }
}

fn rotation(pose: &Pose) -> Quaternion {
    let [x, y, z, w] = pose.rotation.to_array();
    Quaternion { x, y, z, w }
}

fn pose(pose: &Pose) -> messages::Pose {
    messages::Pose { position: Some(vector(pose.translation_m)), orientation: Some(rotation(pose)) }
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
        data.extend_from_slice(&point.near_ir.unwrap_or(0).to_le_bytes());
        data.extend_from_slice(&[point.reflectivity, point.return_number]);
    }
    data
}
