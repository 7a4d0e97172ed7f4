//! glTF 2.0, `.gltf` and `.glb` (Khronos specification, sections 3.5 to 3.7): triangles of every node of the scene,
//! placed by the node transforms. Buffers are read by hand: the crate would also decode every image.

mod structure;

use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

use glam::{DMat4, DVec3, Mat4};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Gltf, Node, Semantic};

use super::{Fault, Soup};

/// Corners that nodes may make of meshes beyond what the file itself holds: many nodes may place one mesh.
const MOST_PLACED: usize = 1 << 24;

/// Reads all triangles; `folder` is where the file lies, for its buffers.
pub(super) fn read(bytes: &[u8], folder: &Path) -> Result<Soup, Fault> {
    structure::check(bytes)?;
    let gltf = Gltf::from_slice(bytes).map_err(|error| Fault::at("document", error.to_string()))?;
    if let Some(extension) = gltf.extensions_required().find(|name| changes_geometry(name)) {
        return Err(Fault::at("extensionsRequired", format!("{extension} is not supported")));
    }
    let buffers = buffers(&gltf, folder)?;
    let mut soup = Soup::default();
    let scene = gltf.default_scene().or_else(|| gltf.scenes().next());
    let Some(scene) = scene else { return Err(Fault::at("scenes", "none, expected one")) };
    let most = MOST_PLACED + buffers.iter().map(|buffer| buffer.len()).sum::<usize>();
    let mut open: Vec<(Node, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((node, scene_from_parent)) = open.pop() {
        let local = Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        let scene_from_node = scene_from_parent * local;
        if let Some(mesh) = node.mesh() {
            for primitive in mesh.primitives() {
                let place = format!("mesh {} primitive {}", mesh.index(), primitive.index());
                add_primitive(&mut soup, &primitive, &scene_from_node, &buffers, &place)?;
                if soup.vertices.len().max(3 * soup.triangles.len()) > most {
                    let reason =
                        format!("its nodes place meshes of more than {most} corners in all, which is most");
                    return Err(Fault::at(place, reason));
                }
            }
        }
        open.extend(node.children().map(|child| (child, scene_from_node)));
    }
    Ok(soup)
}

fn changes_geometry(extension: &str) -> bool {
    extension.contains("draco") || extension.contains("meshopt") || extension.contains("quantization")
}

fn add_primitive(
    soup: &mut Soup,
    primitive: &gltf::Primitive,
    scene_from_node: &DMat4,
    buffers: &[Rc<[u8]>],
    place: &str,
) -> Result<(), Fault> {
    if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        return Ok(());
    }
    let Some(positions) = primitive.get(&Semantic::Positions) else {
        return Err(Fault::at(place, "no POSITION attribute"));
    };
    let first = soup.vertices.len() as u32;
    if positions.data_type() != DataType::F32 || positions.dimensions() != Dimensions::Vec3 {
        return Err(Fault::at(place, "POSITION is not a list of three floats"));
    }
    let positions = elements(&positions, buffers, 12, place)?;
    for element in &positions {
        let (numbers, _) = element.as_chunks::<4>();
        let [x, y, z] = [numbers[0], numbers[1], numbers[2]].map(|n| f64::from(f32::from_le_bytes(n)));
        soup.vertices.push(scene_from_node.transform_point3(DVec3::new(x, y, z)));
    }
    let order = match primitive.indices() {
        Some(accessor) => indices(&accessor, buffers, place)?,
        None => (0..positions.len() as u32).collect(),
    };
    for (number, index) in order.iter().enumerate() {
        if *index as usize >= positions.len() {
            let reason = format!("index {number} names vertex {index}, there are {}", positions.len());
            return Err(Fault::at(place, reason));
        }
    }
    let corner = |place: usize| first + order[place];
    match primitive.mode() {
        Mode::Triangles => {
            soup.triangles.extend(order.chunks_exact(3).map(|t| [first + t[0], first + t[1], first + t[2]]));
        }
        Mode::TriangleStrip => {
            for start in 2..order.len() {
                soup.triangles.push([corner(start - 2), corner(start - 1), corner(start)]);
            }
        }
        _ => {
            for start in 2..order.len() {
                soup.triangles.push([corner(0), corner(start - 1), corner(start)]);
            }
        }
    }
    Ok(())
}

fn indices(accessor: &Accessor, buffers: &[Rc<[u8]>], place: &str) -> Result<Vec<u32>, Fault> {
    let size = match accessor.data_type() {
        DataType::U8 => 1,
        DataType::U16 => 2,
        DataType::U32 => 4,
        other => return Err(Fault::at(place, format!("indices of type {other:?}"))),
    };
    let elements = elements(accessor, buffers, size, place)?;
    Ok(elements.iter().map(|e| e.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))).collect())
}

/// The elements of an accessor, each `size` bytes.
fn elements<'a>(
    accessor: &Accessor,
    buffers: &'a [Rc<[u8]>],
    size: usize,
    place: &str,
) -> Result<Vec<&'a [u8]>, Fault> {
    let fault = |reason: String| Fault::at(format!("{place}, accessor {}", accessor.index()), reason);
    if accessor.sparse().is_some() {
        return Err(fault("sparse accessors are not supported".into()));
    }
    let Some(view) = accessor.view() else { return Err(fault("no buffer view".into())) };
    let buffer = &buffers[view.buffer().index()];
    let stride = view.stride().unwrap_or(size);
    let start = view.offset().checked_add(accessor.offset());
    let end = accessor
        .count()
        .checked_sub(1)
        .and_then(|last| last.checked_mul(stride)?.checked_add(size)?.checked_add(start?));
    match (start, end) {
        (Some(start), Some(end)) if end <= buffer.len() && stride >= size => {
            Ok((0..accessor.count()).map(|n| &buffer[start + n * stride..][..size]).collect())
        }
        _ => Err(fault(format!(
            "{} elements of {size} bytes every {stride} do not fit buffer {} of {} bytes",
            accessor.count(),
            view.buffer().index(),
            buffer.len()
        ))),
    }
}

fn buffers(gltf: &Gltf, folder: &Path) -> Result<Vec<Rc<[u8]>>, Fault> {
    let document: &Document = gltf;
    let mut all: Vec<Rc<[u8]>> = Vec::new();
    let mut read: HashMap<&str, Rc<[u8]>> = HashMap::new(); // many buffers may name one file
    for buffer in document.buffers() {
        let place = format!("buffer {}", buffer.index());
        let bytes = match buffer.source() {
            // the chunk is that of the first buffer (section 3.6.1.2)
            gltf::buffer::Source::Bin if buffer.index() > 0 => {
                return Err(Fault::at(&place, "no uri; only buffer 0 may be the binary chunk of the file"));
            }
            gltf::buffer::Source::Bin => {
                let chunk = gltf.blob.as_deref();
                chunk.ok_or_else(|| Fault::at(&place, "the file has no binary chunk"))?.into()
            }
            gltf::buffer::Source::Uri(uri) => match (read.get(uri), uri.split_once(";base64,")) {
                (Some(bytes), _) => bytes.clone(),
                (None, Some((_, text))) if uri.starts_with("data:") => {
                    base64(text).ok_or_else(|| Fault::at(&place, "not base64"))?.into()
                }
                _ => external(uri, folder).map_err(|reason| Fault::at(&place, reason))?.into(),
            },
        };
        if let gltf::buffer::Source::Uri(uri) = buffer.source() {
            read.insert(uri, bytes.clone());
        }
        if bytes.len() < buffer.length() {
            let reason = format!("{} bytes, expected {}", bytes.len(), buffer.length());
            return Err(Fault::at(place, reason));
        }
        all.push(bytes);
    }
    Ok(all)
}

fn external(uri: &str, folder: &Path) -> Result<Vec<u8>, String> {
    if uri.contains(':') {
        return Err(format!("{uri:?} is no file beside this one"));
    }
    crate::base::files::read_inside(folder, uri).map_err(|error| format!("{uri:?}: {error}"))
}

/// RFC 4648, with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut held) = (0_u32, 0);
    for letter in text.bytes() {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
            bits &= (1 << held) - 1;
        }
    }
    Some(bytes)
}
