//! PLY, text and binary of both byte orders: the element `vertex`.

use std::io::Cursor;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Property, PropertyAccess, PropertyAccessResult};

use super::{CloudPoint, Fault, point, slot};
use crate::world::scene::mesh_file::{Passed, element_fault, header_fault, whole_number, with_numbers};

pub(super) fn read(bytes: &[u8], take: &mut dyn FnMut(CloudPoint)) -> Result<(), Fault> {
    let bytes = &*with_numbers(bytes);
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<DefaultElement>::new()
        .read_header(&mut reader)
        .map_err(|error| header_fault(bytes, &error))?;
    let Some(vertex) = header.elements.get("vertex") else {
        return Err(Fault::at("header", "no element vertex"));
    };
    for axis in ["x", "y", "z"] {
        if !vertex.properties.contains_key(axis) {
            return Err(Fault::at("header", format!("no property {axis} of element vertex")));
        }
    }
    for (name, element) in &header.elements {
        let fault =
            |reader: &Reader<Cursor<&[u8]>>, error| element_fault(&header, name, reader, bytes, error);
        if name != "vertex" {
            let passed = Parser::<Passed>::new().read_payload_for_element(&mut reader, element, &header);
            passed.map_err(|error| fault(&reader, error))?;
            continue;
        }
        let points = Parser::<Vertex>::new()
            .read_payload_for_element(&mut reader, element, &header)
            .map_err(|error| fault(&reader, error))?;
        points.iter().for_each(|vertex| take(point(&vertex.0)));
    }
    Ok(())
}

/// The numbers of a point; other properties are passed over.
struct Vertex([f64; 9]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([f64::NAN; 9])
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let Some(slot) = slot(name) else { return PropertyAccessResult::Ignored };
        self.0[slot] = value;
        PropertyAccessResult::Set
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match whole_number(&property) {
            Some(value) => self.set_double(name, value as f64),
            None => PropertyAccessResult::Ignored,
        }
    }
}
