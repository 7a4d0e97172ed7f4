//! PLY, text and binary of both byte orders: the elements `vertex` (x, y, z), `face` (a list of vertex numbers) and
//! `tristrips` (lists of strips, with -1 between them).

use std::borrow::Cow;
use std::io::Cursor;

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, Property, PropertyAccess};
use ply_rs_bw::ply::{PropertyAccessResult, PropertyType, ScalarType};

use super::{Fault, MeshUnit, Soup};

/// Reads vertices, faces and strips; other elements are passed over.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let bytes = &*with_numbers(bytes);
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<DefaultElement>::new()
        .read_header(&mut reader)
        .map_err(|error| header_fault(bytes, &error))?;
    check(&header)?;
    let unit = header.comments.iter().find_map(|comment| MeshUnit::of_comment(comment));
    let mut soup = Soup { unit, ..Soup::default() };
    for (name, element) in &header.elements {
        let fault =
            |reader: &Reader<Cursor<&[u8]>>, error| element_fault(&header, name, reader, bytes, error);
        match name.as_str() {
            "vertex" => {
                let points = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| fault(&reader, error))?;
                soup.vertices = points.into_iter().map(|vertex| vertex.0).collect();
                if is_single_precision(element) {
                    soup.note_single_precision();
                }
            }
            "face" | "tristrips" => {
                let lists = Parser::<Corners>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| fault(&reader, error))?;
                for (number, Corners(corners)) in lists.iter().enumerate() {
                    let place = || format!("{name} {number} (counted from 0)");
                    match name.as_str() {
                        "face" => soup.push_polygon(&vertices(corners, place)?),
                        _ => push_strips(&mut soup, corners, place)?,
                    }
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

/// The parser knows no `nan` and no `inf` in text: they become a number that no float holds.
pub(in crate::world::scene) fn with_numbers(bytes: &[u8]) -> Cow<'_, [u8]> {
    const END: &[u8] = b"end_header";
    const ENDLESS: &[u8] = b"9e999";
    let start = bytes.windows(END.len()).position(|window| window == END).unwrap_or(bytes.len());
    let (header, body) = bytes.split_at(start);
    let is_text = header.windows(12).any(|window| window == b"format ascii");
    let is_endless = |word: &[u8]| {
        let word = std::str::from_utf8(word).ok().and_then(super::number);
        word.is_some_and(|number| !number.is_finite())
    };
    let mut words = body.split(u8::is_ascii_whitespace);
    if !is_text || !words.any(is_endless) {
        return Cow::Borrowed(bytes);
    }
    let mut written = header.to_vec();
    for word in body.split_inclusive(u8::is_ascii_whitespace) {
        let blank = word.last().filter(|byte| byte.is_ascii_whitespace());
        let text = &word[..word.len() - usize::from(blank.is_some())];
        written.extend(if is_endless(text) { ENDLESS } else { text });
        written.extend(blank);
    }
    Cow::Owned(written)
}

fn vertices(corners: &[i64], place: impl Fn() -> String) -> Result<Vec<u32>, Fault> {
    let vertex = |corner: &i64| {
        u32::try_from(*corner).map_err(|_| Fault::at(place(), format!("vertex number {corner}")))
    };
    corners.iter().map(vertex).collect()
}

/// Strips of triangles: each corner makes one with the two before it; -1 begins a new strip.
fn push_strips(soup: &mut Soup, corners: &[i64], place: impl Fn() -> String) -> Result<(), Fault> {
    for strip in corners.split(|corner| *corner == -1) {
        let strip = vertices(strip, &place)?;
        // a corner that comes twice joins two strips, and makes no surface
        let triangles = strip.windows(3).map(|t| [t[0], t[1], t[2]]);
        soup.triangles.extend(triangles.filter(|[a, b, c]| a != b && b != c && a != c));
    }
    Ok(())
}

fn is_single_precision(vertex: &ElementDef) -> bool {
    let scalar = |axis| vertex.properties.get(axis).map(|property| &property.data_type);
    ["x", "y", "z"].iter().any(|axis| matches!(scalar(*axis), Some(PropertyType::Scalar(ScalarType::Float))))
}

/// Whether an element of a PLY file makes a surface.
pub(in crate::world::scene) fn makes_surface(name: &str, count: usize) -> bool {
    count > 0 && matches!(name, "face" | "tristrips")
}

fn check(header: &Header) -> Result<(), Fault> {
    let missing = |what: &str| Err(Fault::at("header", format!("no {what}")));
    let Some(vertex) = header.elements.get("vertex") else { return missing("element vertex") };
    for axis in ["x", "y", "z"] {
        if !vertex.properties.contains_key(axis) {
            return missing(&format!("property {axis} of element vertex"));
        }
    }
    let surfaces = header.elements.iter().filter(|(name, _)| matches!(name.as_str(), "face" | "tristrips"));
    let mut surfaces = surfaces.peekable();
    if surfaces.peek().is_none() {
        return missing("element face: this is a point cloud, not a mesh");
    }
    for (name, element) in surfaces {
        let is_list = |name: &str| {
            element.properties.get(name).is_some_and(|p| matches!(p.data_type, PropertyType::List(_, _)))
        };
        if !CORNERS.iter().any(|name| is_list(name)) {
            return missing(&format!("list property vertex_indices of element {name}"));
        }
    }
    Ok(())
}

/// Names under which programs write the corners of a face.
const CORNERS: [&str; 4] = ["vertex_indices", "vertex_index", "vertex_indexes", "indices"];

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
            let stated = first_line(&error);
            // what the parser counts as lines are elements: a binary file has none
            let line = error.line().map_or(String::new(), |line| format!("Line {line}: "));
            let stated = stated.strip_prefix(&line).unwrap_or(&stated);
            Fault::byte(byte, format!("element {name} of {count}: {stated}"))
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

/// The corners of a face or of strips; other properties are passed over.
struct Corners(Vec<i64>);

impl PropertyAccess for Corners {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !CORNERS.contains(&name) {
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
