//! glTF 2.0, `.gltf` and `.glb` (Khronos specification, sections 3.5 to 3.7): triangles of every node of the scene,
//! placed by the node transforms; instances (EXT_mesh_gpu_instancing) and whole numbers (KHR_mesh_quantization) too. Read
//! by hand: a reader that checks the whole file refuses those that lack what no triangle needs (bounds of positions,
//! images, extensions about looks), and keeps transforms in f32.

mod buffers;
mod document;
mod structure;

use std::path::Path;

use glam::{DMat4, DVec3};

use super::{Fault, Soup};
use buffers::Buffers;
use document::{Document, NodeDef, Primitive, placed};

/// Corners that nodes may make of meshes beyond what the file itself holds: many nodes may place one mesh.
const MOST_PLACED: usize = 1 << 24;

/// Reads all triangles; `folder` is where the file lies, for its buffers.
pub(super) fn read(bytes: &[u8], folder: &Path) -> Result<Soup, Fault> {
    let (text, binary) = structure::chunks(bytes)?;
    let mut json = serde_json::Deserializer::from_slice(text);
    let document: Document = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let path = error.path().to_string();
        let place = if path == "." { "document".into() } else { path };
        Fault::at(place, error.into_inner().to_string())
    })?;
    structure::check(&document)?;
    let buffers = Buffers::read(&document, folder, binary)?;
    let mut reader = Reader {
        document: &document,
        buffers: &buffers,
        most: MOST_PLACED + bytes.len() + buffers.total(),
        soup: Soup::default(),
    };
    let mut open: Vec<(usize, DMat4)> =
        structure::roots(&document)?.into_iter().map(|root| (root, DMat4::IDENTITY)).collect();
    while let Some((number, scene_from_parent)) = open.pop() {
        let node = &document.nodes[number];
        let scene_from_node = scene_from_parent * node.parent_from_node();
        reader.add_node(number, node, &scene_from_node)?;
        open.extend(node.children.iter().map(|child| (*child, scene_from_node)));
    }
    Ok(reader.soup)
}

struct Reader<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    most: usize,
    soup: Soup,
}

impl Reader<'_> {
    fn add_node(&mut self, number: usize, node: &NodeDef, scene_from_node: &DMat4) -> Result<(), Fault> {
        let Some(mesh) = node.mesh else { return Ok(()) };
        let Some(definition) = self.document.meshes.get(mesh) else {
            let reason =
                format!("mesh {mesh}, expected one of the {} of the file", self.document.meshes.len());
            return Err(Fault::at(format!("node {number}"), reason));
        };
        let instances = self.instances(number, node)?;
        for (part, primitive) in definition.primitives.iter().enumerate() {
            let place = format!("mesh {mesh} primitive {part}");
            for node_from_instance in instances.as_deref().unwrap_or(&[DMat4::IDENTITY]) {
                self.add_primitive(primitive, &(*scene_from_node * *node_from_instance), &place)?;
                if self.soup.vertices.len().max(3 * self.soup.triangles.len()) > self.most {
                    let reason = format!(
                        "its nodes place meshes of more than {} corners in all, which is most",
                        self.most
                    );
                    return Err(Fault::at(place, reason));
                }
            }
        }
        Ok(())
    }

    /// Where a node places its mesh many times.
    fn instances(&self, number: usize, node: &NodeDef) -> Result<Option<Vec<DMat4>>, Fault> {
        let Some(instancing) = &node.extensions.instancing else { return Ok(None) };
        let place = format!("node {number}, EXT_mesh_gpu_instancing");
        let of = |name: &str, width| {
            let accessor = instancing.attributes.get(name);
            accessor.map(|accessor| self.buffers.elements(*accessor, width, &place)).transpose()
        };
        let [translation, rotation, scale] = [of("TRANSLATION", 3)?, of("ROTATION", 4)?, of("SCALE", 3)?];
        let counts = [&translation, &rotation, &scale].into_iter().flatten().map(|elements| elements.len());
        let (Some(least), Some(most)) = (counts.clone().min(), counts.max()) else { return Ok(None) };
        if least != most {
            let reason = format!("attributes of {least} and of {most} instances, expected as many of each");
            return Err(Fault::at(place, reason));
        }
        let instance = |at| {
            let triple =
                |elements: &Option<buffers::Elements<'_>>| elements.as_ref().map(|e| e.numbers::<3>(at));
            placed(triple(&scale), rotation.as_ref().map(|e| e.numbers::<4>(at)), triple(&translation))
        };
        Ok(Some((0..most).map(instance).collect()))
    }

    fn add_primitive(
        &mut self,
        primitive: &Primitive,
        scene_from_mesh: &DMat4,
        place: &str,
    ) -> Result<(), Fault> {
        // points and lines are no surface
        let mode @ 4..=6 = primitive.mode.unwrap_or(4) else { return Ok(()) };
        let Some(accessor) = primitive.attributes.get("POSITION") else {
            return Err(Fault::at(place, "no POSITION attribute"));
        };
        if self.document.accessors.get(*accessor).is_some_and(|accessor| accessor.buffer_view.is_none())
            && let Some(name) = primitive.extensions.keys().find(|name| name.contains("draco"))
        {
            return Err(Fault::at(place, format!("compressed ({name}): save the file again uncompressed")));
        }
        let positions = self.buffers.elements(*accessor, 3, place)?;
        let first = self.soup.vertices.len() as u32;
        let mut largest = 0.0_f64;
        for at in 0..positions.len() {
            let position = DVec3::from(positions.numbers::<3>(at));
            largest = largest.max(position.abs().max_element());
            self.soup.vertices.push(scene_from_mesh.transform_point3(position));
        }
        if positions.component_type == 5126 {
            let scale = scene_from_mesh.x_axis.truncate().length();
            self.soup.note_single_step(largest, scale);
        }
        let order = match primitive.indices {
            Some(accessor) => self
                .buffers
                .elements(accessor, 1, place)?
                .indices(&format!("{place}, accessor {accessor}"))?,
            None => (0..positions.len() as u32).collect(),
        };
        for (number, index) in order.iter().enumerate() {
            if *index as usize >= positions.len() {
                let reason = format!("index {number} names vertex {index}, there are {}", positions.len());
                return Err(Fault::at(place, reason));
            }
        }
        let corner = |place: usize| first + order[place];
        let triangles = &mut self.soup.triangles;
        match mode {
            4 => triangles.extend(order.chunks_exact(3).map(|t| [first + t[0], first + t[1], first + t[2]])),
            5 => (2..order.len()).for_each(|at| triangles.push([corner(at - 2), corner(at - 1), corner(at)])),
            _ => (2..order.len()).for_each(|at| triangles.push([corner(0), corner(at - 1), corner(at)])),
        }
        Ok(())
    }
}
