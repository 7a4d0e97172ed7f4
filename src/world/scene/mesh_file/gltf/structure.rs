//! What holds of a sound glTF file: chunks within it, nodes that are trees, extensions that are known.

use super::Fault;
use super::document::Document;

/// Bytes of the header of a `.glb` file, and of that of a chunk.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// Extensions that this program reads, by their whole name.
const READ: [&str; 2] = ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing"];
/// Beginnings of the names of extensions that are about how a surface looks, not where it is.
const LOOKS: [&str; 9] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_techniques_webgl",
    "KHR_animation_pointer",
];

/// The JSON of a file, and the binary chunk of a `.glb` file (section 4.4).
pub(super) fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    }
    let word = |at: usize| bytes.get(at..at + 4).and_then(|four| four.first_chunk().copied());
    let word = |at: usize| word(at).map(|four| u32::from_le_bytes(four) as usize);
    let (Some(version), Some(length), Some(json)) = (word(4), word(8), word(HEADER)) else {
        return Err(Fault::byte(bytes.len(), "the file ends in its header of 20 bytes"));
    };
    if version != 2 {
        return Err(Fault::byte(4, format!("binary glTF {version}, expected 2: convert the file to glTF 2")));
    }
    let start = HEADER + CHUNK_HEADER;
    if length < start || length > bytes.len() {
        let reason = format!("the header says {length} bytes, the file holds {}", bytes.len());
        return Err(Fault::byte(8, reason));
    }
    let text = bytes[start..length].get(..json).ok_or_else(|| {
        let reason = format!("a chunk of {json} bytes, {} are left in the file", length - start);
        Fault::byte(HEADER, reason)
    })?;
    // chunks begin at multiples of 4, and the second one holds the bytes
    let second = (start + json).next_multiple_of(4);
    let Some(binary) = word(second).filter(|_| bytes.get(second + 4..second + 8) == Some(b"BIN\0")) else {
        return Ok((text, None));
    };
    let from = second + CHUNK_HEADER;
    let held = bytes.get(from..).and_then(|rest| rest.get(..binary)).ok_or_else(|| {
        let left = bytes.len().saturating_sub(from);
        Fault::byte(second, format!("a chunk of {binary} bytes, {left} are left in the file"))
    })?;
    Ok((text, Some(held)))
}

/// Refuses another version, an extension without which the triangles are not known, and nodes that are no trees.
pub(super) fn check(document: &Document) -> Result<(), Fault> {
    let version = &document.asset.version;
    if !version.starts_with("2.") {
        let reason = format!("glTF {version:?}, expected 2.0: convert the file to glTF 2");
        return Err(Fault::at("asset.version", reason));
    }
    let is_known =
        |name: &String| READ.contains(&name.as_str()) || LOOKS.iter().any(|looks| name.starts_with(looks));
    if let Some(extension) = document.extensions_required.iter().find(|name| !is_known(name)) {
        let reason = format!("{extension} is not supported: save the file again without it");
        return Err(Fault::at("extensionsRequired", reason));
    }
    nodes(document)
}

/// Nodes are trees (section 3.5.2): each has one parent at most, and no node is its own ancestor.
fn nodes(document: &Document) -> Result<(), Fault> {
    let nodes = &document.nodes;
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for &child in &node.children {
            let Some(slot) = parents.get_mut(child) else {
                let reason = format!("child {child}, expected the number of one of {} nodes", nodes.len());
                return Err(Fault::at(format!("node {parent}"), reason));
            };
            if let Some(other) = slot.replace(parent) {
                let reason =
                    format!("child of node {other} and of node {parent}; a node has one parent at most");
                return Err(Fault::at(format!("node {child}"), reason));
            }
        }
    }
    for (number, scene) in document.scenes.iter().enumerate() {
        let mut seen = std::collections::HashSet::new();
        for &root in &scene.nodes {
            let reason = match parents.get(root) {
                None => {
                    format!("a root of scene {number}, expected the number of one of {} nodes", nodes.len())
                }
                Some(Some(parent)) => format!("a root of scene {number} and child of node {parent}"),
                Some(None) if !seen.insert(root) => format!("named twice as a root of scene {number}"),
                Some(None) => continue,
            };
            return Err(Fault::at(format!("node {root}"), reason));
        }
    }
    // with one parent each and roots that have none, no scene reaches a circle
    Ok(())
}

/// Where reading begins: the roots of the scene that the file shows, or of all nodes where it names no scene.
pub(super) fn roots(document: &Document) -> Result<Vec<usize>, Fault> {
    match (document.scene, &document.scenes[..]) {
        (Some(number), scenes) => match scenes.get(number) {
            Some(scene) => Ok(scene.nodes.clone()),
            None => Err(Fault::at(
                "scene",
                format!("{number}, expected the number of one of {} scenes", scenes.len()),
            )),
        },
        (None, [first, ..]) => Ok(first.nodes.clone()),
        (None, []) => {
            let children: std::collections::HashSet<usize> =
                document.nodes.iter().flat_map(|node| node.children.iter().copied()).collect();
            Ok((0..document.nodes.len()).filter(|node| !children.contains(node)).collect())
        }
    }
}
