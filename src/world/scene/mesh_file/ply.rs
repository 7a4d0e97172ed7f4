//! PLY, text and binary of both byte orders: the elements `vertex` (x, y, z) and `face` (a list of vertex numbers).

use std::io::Cursor;

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, Property, PropertyAccess};
use ply_rs_bw::ply::{PropertyAccessResult, PropertyType};

use super::{Fault, Soup};

/// Reads vertices and faces; polygons become fans, other elements are passed over.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<DefaultElement>::new()
        .read_header(&mut reader)
        .map_err(|error| header_fault(bytes, &error))?;
    check(&header)?;
    let mut soup = Soup::default();
    for (name, element) in &header.elements {
        let fault =
            |reader: &Reader<Cursor<&[u8]>>, error| element_fault(&header, name, reader, bytes, error);
        match name.as_str() {
            "vertex" => {
                let points = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| fault(&reader, error))?;
                soup.vertices = points.into_iter().map(|vertex| vertex.0).collect();
            }
            "face" => {
                let faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| fault(&reader, error))?;
                for (number, Face(corners)) in faces.iter().enumerate() {
                    let mut polygon = Vec::with_capacity(corners.len());
                    for corner in corners {
                        polygon.push(u32::try_from(*corner).map_err(|_| {
                            Fault::at(
                                format!("face {number} (counted from 0)"),
                                format!("vertex number {corner}"),
                            )
                        })?);
                    }
                    soup.push_polygon(&polygon);
                }
            }
            _ => {
                Parser::<Passed>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| fault(&reader, error))?;
            }
        }
    }
    Ok(soup)
}

fn check(header: &Header) -> Result<(), Fault> {
    let missing = |what: &str| Err(Fault::at("header", format!("no {what}")));
    let Some(vertex) = header.elements.get("vertex") else { return missing("element vertex") };
    let Some(face) = header.elements.get("face") else {
        return missing("element face: this is a point cloud, not a mesh");
    };
    for axis in ["x", "y", "z"] {
        if !vertex.properties.contains_key(axis) {
            return missing(&format!("property {axis} of element vertex"));
        }
    }
    let is_list = |property: &str| {
        face.properties.get(property).is_some_and(|p| matches!(p.data_type, PropertyType::List(_, _)))
    };
    if is_list("vertex_indices") || is_list("vertex_index") {
        Ok(())
    } else {
        missing("list property vertex_indices of element face")
    }
}

pub(in crate::world::scene) fn element_fault(
    header: &Header,
    name: &str,
    reader: &Reader<Cursor<&[u8]>>,
    bytes: &[u8],
    error: ParseError,
) -> Fault {
    let element = header.elements.get(name);
    let count = element.map_or(0, |element: &ElementDef| element.count);
    match (header.encoding, error.line()) {
        (Encoding::Ascii, Some(line)) => {
            let names: Vec<&str> =
                element.iter().flat_map(|e| e.properties.keys()).map(String::as_str).collect();
            let found = text_of(bytes, line);
            let expected = format!("expected the numbers of element {name} of {count}: {}", names.join(", "));
            Fault::line(line, format!("{found:?}, {expected}"))
        }
        _ => {
            let byte = (reader.get_ref().position() as usize).min(bytes.len());
            let said = first_line(&error);
            // what the parser counts as lines are elements: a binary file has none
            let line = error.line().map_or(String::new(), |line| format!("Line {line}: "));
            let said = said.strip_prefix(&line).unwrap_or(&said);
            Fault::byte(byte, format!("element {name} of {count}: {said}"))
        }
    }
}

pub(in crate::world::scene) fn header_fault(bytes: &[u8], error: &ParseError) -> Fault {
    match error.line() {
        Some(line) => {
            Fault::line(line, format!("{:?}, expected a line of a PLY header", text_of(bytes, line)))
        }
        None => Fault::at("header", first_line(error)),
    }
}

/// The parser goes on with what it expected, character by character.
fn first_line(error: &ParseError) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

/// A line of the file, counted from 1, as far as it is worth showing.
fn text_of(bytes: &[u8], line: usize) -> String {
    const SHOWN: usize = 60;
    let text = bytes.split(|byte| *byte == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    String::from_utf8_lossy(&text[..text.len().min(SHOWN)]).trim_end().to_owned()
}

/// The coordinates of a vertex; its other properties are passed over.
struct Vertex(DVec3);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(DVec3::NAN)
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        match name {
            "x" => self.0.x = value,
            "y" => self.0.y = value,
            "z" => self.0.z = value,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match whole_number(&property) {
            Some(value) => self.set_double(name, value as f64),
            None => PropertyAccessResult::Ignored,
        }
    }
}

/// The corners of a face; its other properties are passed over.
struct Face(Vec<i64>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        self.0 = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element of no interest.
pub(in crate::world::scene) struct Passed;

impl PropertyAccess for Passed {
    fn new() -> Self {
        Self
    }
}

/// A whole number of any size.
pub(in crate::world::scene) fn whole_number(property: &Property) -> Option<i64> {
    match property {
        Property::Char(value) => Some(i64::from(*value)),
        Property::UChar(value) => Some(i64::from(*value)),
        Property::Short(value) => Some(i64::from(*value)),
        Property::UShort(value) => Some(i64::from(*value)),
        Property::Int(value) => Some(i64::from(*value)),
        Property::UInt(value) => Some(i64::from(*value)),
        _ => None,
    }
}
