//! The JSON of a glTF file, as far as it says where triangles are. Numbers are read in f64: a node may place a mesh in a
//! national grid.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3};
use serde::Deserialize;
use serde_json::Value;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub asset: Asset,
    pub scene: Option<usize>,
    pub scenes: Vec<SceneDef>,
    pub nodes: Vec<NodeDef>,
    pub meshes: Vec<MeshDef>,
    pub accessors: Vec<AccessorDef>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<BufferDef>,
    pub extensions_required: Vec<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Asset {
    pub version: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct SceneDef {
    pub nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeDef {
    pub mesh: Option<usize>,
    pub children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    pub extensions: NodeExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
}

/// Accessors by what they hold: TRANSLATION, ROTATION, SCALE.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Instancing {
    pub attributes: BTreeMap<String, usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct MeshDef {
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub attributes: BTreeMap<String, usize>,
    pub indices: Option<usize>,
    pub mode: Option<u32>,
    pub extensions: BTreeMap<String, Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct AccessorDef {
    pub buffer_view: Option<usize>,
    pub byte_offset: usize,
    pub component_type: u32,
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Sparse>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: usize,
    pub indices: SparsePart,
    pub values: SparsePart,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct SparsePart {
    pub buffer_view: usize,
    pub byte_offset: usize,
    pub component_type: u32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct BufferView {
    pub buffer: usize,
    pub byte_offset: usize,
    pub byte_stride: Option<usize>,
    pub extensions: BTreeMap<String, Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct BufferDef {
    pub uri: Option<String>,
    pub byte_length: usize,
}

impl NodeDef {
    /// Where the node stands in its parent (section 3.5.3).
    pub(crate) fn parent_from_node(&self) -> DMat4 {
        match self.matrix {
            Some(columns) => DMat4::from_cols_array(&columns),
            None => placed(self.scale, self.rotation, self.translation),
        }
    }
}

/// Scale, then turn, then move; what is not there changes nothing.
pub(super) fn placed(
    scale: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    translation: Option<[f64; 3]>,
) -> DMat4 {
    let turn = rotation.map(DQuat::from_array).filter(|turn| turn.length_squared() > 0.0);
    DMat4::from_scale_rotation_translation(
        scale.map_or(DVec3::ONE, DVec3::from),
        turn.map_or(DQuat::IDENTITY, DQuat::normalize),
        translation.map_or(DVec3::ZERO, DVec3::from),
    )
}
