//! What the crate takes for granted of a glTF file: lengths of chunks, accessors that are there, nodes that are a tree.

use serde_json::Value;

use super::Fault;

/// Bytes of the header of a `.glb` file, and of that of a chunk.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// Refuses a file whose structure would be followed for ever or out of its bounds.
pub(super) fn check(bytes: &[u8]) -> Result<(), Fault> {
    let text = if bytes.starts_with(b"glTF") { json_chunk(bytes)? } else { bytes };
    let document: Value =
        serde_json::from_slice(text).map_err(|error| Fault::at("document", error.to_string()))?;
    accessors(&document)?;
    nodes(&document)
}

/// The first chunk of a `.glb` file (section 4.4).
fn json_chunk(bytes: &[u8]) -> Result<&[u8], Fault> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|four| four.first_chunk().copied());
    let word = |at: usize| word(at).map(|four| u32::from_le_bytes(four) as usize);
    let (Some(length), Some(chunk)) = (word(8), word(HEADER)) else {
        return Err(Fault::byte(bytes.len(), "the file ends in its header of 20 bytes"));
    };
    let start = HEADER + CHUNK_HEADER;
    if length < start || length > bytes.len() {
        let reason = format!("the header says {length} bytes, the file holds {}", bytes.len());
        return Err(Fault::byte(8, reason));
    }
    bytes[start..].get(..chunk).ok_or_else(|| {
        let reason = format!("a chunk of {chunk} bytes, {} are left in the file", bytes.len() - start);
        Fault::byte(HEADER, reason)
    })
}

fn list<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// The crate looks at the accessor of every POSITION before it has checked that there is one.
fn accessors(document: &Value) -> Result<(), Fault> {
    let there = list(document, "accessors").len();
    for (mesh, value) in list(document, "meshes").iter().enumerate() {
        for (number, primitive) in list(value, "primitives").iter().enumerate() {
            let named = primitive.get("attributes").and_then(Value::as_object);
            for (attribute, accessor) in named.into_iter().flatten() {
                if accessor.as_u64().is_none_or(|accessor| accessor >= there as u64) {
                    let place = format!("mesh {mesh} primitive {number}");
                    let reason = format!(
                        "{attribute} is accessor {accessor}, expected one of the {there} of the file"
                    );
                    return Err(Fault::at(place, reason));
                }
            }
        }
    }
    Ok(())
}

/// Nodes are trees (section 3.5.2): each has one parent at most, and no node is its own ancestor.
fn nodes(document: &Value) -> Result<(), Fault> {
    let nodes = list(document, "nodes");
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in list(node, "children") {
            let child = child.as_u64().filter(|child| *child < nodes.len() as u64).ok_or_else(|| {
                let reason = format!("child {child}, expected the number of one of {} nodes", nodes.len());
                Fault::at(format!("node {parent}"), reason)
            })? as usize;
            if let Some(other) = parents[child].replace(parent) {
                let reason =
                    format!("child of node {other} and of node {parent}; a node has one parent at most");
                return Err(Fault::at(format!("node {child}"), reason));
            }
        }
    }
    for (number, scene) in list(document, "scenes").iter().enumerate() {
        let mut seen = std::collections::HashSet::new();
        for root in list(scene, "nodes").iter().filter_map(Value::as_u64) {
            let parent = usize::try_from(root).ok().and_then(|root| *parents.get(root)?);
            let reason = match parent {
                Some(parent) => format!("a root of scene {number} and child of node {parent}"),
                None if !seen.insert(root) => format!("named twice as a root of scene {number}"),
                None => continue,
            };
            return Err(Fault::at(format!("node {root}"), reason));
        }
    }
    // with one parent each and roots that have none, no scene reaches a circle
    Ok(())
}
