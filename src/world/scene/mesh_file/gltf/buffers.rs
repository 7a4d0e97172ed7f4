//! The bytes of a glTF file: buffers inside it and next to it, accessors into them.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

use super::Fault;
use super::document::{AccessorDef, Document};

/// Elements that an accessor without bytes of its own may ask for: they take memory.
const MOST_ZEROS: usize = 1 << 24;

/// Every buffer of the file, and what lies in it.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    bytes: Vec<Rc<[u8]>>,
}

/// The elements of an accessor.
pub(super) struct Elements<'a> {
    pub component_type: u32,
    normalized: bool,
    /// Numbers of one element.
    width: usize,
    list: Vec<Cow<'a, [u8]>>,
}

impl<'a> Buffers<'a> {
    /// Reads every buffer; `folder` is where the file lies, `binary` its binary chunk.
    pub(crate) fn read(document: &'a Document, folder: &Path, binary: Option<&[u8]>) -> Result<Self, Fault> {
        let mut bytes: Vec<Rc<[u8]>> = Vec::new();
        let mut read: HashMap<&str, Rc<[u8]>> = HashMap::new(); // many buffers may name one file
        for (number, buffer) in document.buffers.iter().enumerate() {
            let place = format!("buffer {number}");
            let held: Rc<[u8]> = match buffer.uri.as_deref() {
                // the chunk is that of the first buffer (section 3.6.1.2)
                None if number > 0 => {
                    return Err(Fault::at(
                        &place,
                        "no uri; only buffer 0 may be the binary chunk of the file",
                    ));
                }
                None => binary.ok_or_else(|| Fault::at(&place, "the file has no binary chunk"))?.into(),
                Some(uri) => match read.get(uri) {
                    Some(bytes) => bytes.clone(),
                    None => {
                        let bytes: Rc<[u8]> =
                            named(uri, folder).map_err(|reason| Fault::at(&place, reason))?.into();
                        read.insert(uri, bytes.clone());
                        bytes
                    }
                },
            };
            if held.len() < buffer.byte_length {
                let reason = format!("{} bytes, expected {}", held.len(), buffer.byte_length);
                return Err(Fault::at(place, reason));
            }
            bytes.push(held);
        }
        Ok(Self { document, bytes })
    }

    /// Bytes of all buffers.
    pub(crate) fn total(&self) -> usize {
        self.bytes.iter().map(|bytes| bytes.len()).sum()
    }

    /// The elements of an accessor of `width` numbers each.
    pub(crate) fn elements(&self, accessor: usize, width: usize, place: &str) -> Result<Elements<'_>, Fault> {
        let Some(definition) = self.document.accessors.get(accessor) else {
            let there = self.document.accessors.len();
            return Err(Fault::at(
                place,
                format!("accessor {accessor}, expected one of the {there} of the file"),
            ));
        };
        let fault = |reason: String| Fault::at(format!("{place}, accessor {accessor}"), reason);
        let AccessorDef { component_type, normalized, count, ref kind, .. } = *definition;
        let expected = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][width];
        if kind != expected {
            return Err(fault(format!("elements of type {kind:?}, expected {expected}")));
        }
        let Some(each) = component_bytes(component_type) else {
            return Err(fault(format!("numbers of type {component_type}, which glTF does not have")));
        };
        let size = each * width;
        let mut list: Vec<Cow<'_, [u8]>> = match definition.buffer_view {
            Some(view) => self
                .view(view, definition.byte_offset, count, size)
                .map_err(fault)?
                .into_iter()
                .map(Cow::Borrowed)
                .collect(),
            None if definition.sparse.is_none() => return Err(fault("no buffer view".into())),
            None if count > MOST_ZEROS => {
                return Err(fault(format!("{count} elements without bytes, expected {MOST_ZEROS} at most")));
            }
            None => vec![Cow::Owned(vec![0; size]); count],
        };
        if let Some(sparse) = &definition.sparse {
            let index_bytes = component_bytes(sparse.indices.component_type).unwrap_or(4);
            let at =
                self.view(sparse.indices.buffer_view, sparse.indices.byte_offset, sparse.count, index_bytes);
            let values = self.view(sparse.values.buffer_view, sparse.values.byte_offset, sparse.count, size);
            for (at, value) in at.map_err(fault)?.into_iter().zip(values.map_err(fault)?) {
                let at = whole(at) as usize;
                let slot = list.get_mut(at);
                *slot.ok_or_else(|| fault(format!("sparse element {at} of {count}")))? = Cow::Borrowed(value);
            }
        }
        Ok(Elements { component_type, normalized, width, list })
    }

    /// Elements of `size` bytes in a buffer view.
    fn view(&self, view: usize, offset: usize, count: usize, size: usize) -> Result<Vec<&[u8]>, String> {
        let views = &self.document.buffer_views;
        let definition = views.get(view).ok_or_else(|| format!("buffer view {view} of {}", views.len()))?;
        if definition.extensions.keys().any(|name| name.contains("meshopt")) {
            return Err(format!("buffer view {view} is compressed (meshopt): save the file uncompressed"));
        }
        let Some(buffer) = self.bytes.get(definition.buffer) else {
            return Err(format!("buffer {} of {}", definition.buffer, self.bytes.len()));
        };
        let stride = definition.byte_stride.unwrap_or(size);
        let start = definition.byte_offset.checked_add(offset);
        if count == 0 {
            return Ok(Vec::new());
        }
        let end =
            (count - 1).checked_mul(stride).and_then(|last| last.checked_add(size)?.checked_add(start?));
        match (start, end) {
            (Some(start), Some(end)) if end <= buffer.len() && stride >= size => {
                Ok((0..count).map(|n| &buffer[start + n * stride..][..size]).collect())
            }
            _ => Err(format!(
                "{count} elements of {size} bytes every {stride} do not fit buffer {} of {} bytes",
                definition.buffer,
                buffer.len()
            )),
        }
    }
}

impl Elements<'_> {
    pub(crate) fn len(&self) -> usize {
        self.list.len()
    }

    /// The numbers of an element; whole ones between -1 and 1 where the accessor says so (section 3.11).
    pub(crate) fn numbers<const N: usize>(&self, at: usize) -> [f64; N] {
        debug_assert_eq!(self.width, N);
        let each = self.list[at].len() / N;
        std::array::from_fn(|part| self.number(&self.list[at][part * each..][..each]))
    }

    fn number(&self, bytes: &[u8]) -> f64 {
        let raw = whole(bytes);
        let (value, most) = match self.component_type {
            5120 => (f64::from(raw as u8 as i8), 127.0),
            5121 => (f64::from(raw as u8), 255.0),
            5122 => (f64::from(raw as u16 as i16), 32_767.0),
            5123 => (f64::from(raw as u16), 65_535.0),
            5125 => return f64::from(raw),
            _ => return f64::from(f32::from_bits(raw)),
        };
        if self.normalized { (value / most).max(-1.0) } else { value }
    }

    /// The elements as numbers of vertices.
    pub(crate) fn indices(&self, place: &str) -> Result<Vec<u32>, Fault> {
        match self.component_type {
            5121 | 5123 | 5125 => Ok(self.list.iter().map(|bytes| whole(bytes)).collect()),
            other => Err(Fault::at(place, format!("indices of type {other}, expected 5121, 5123 or 5125"))),
        }
    }
}

fn component_bytes(component_type: u32) -> Option<usize> {
    match component_type {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | 5126 => Some(4),
        _ => None,
    }
}

/// Up to four bytes, the lowest first.
fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
}

/// The bytes behind a URI: inside it, or a file next to the document.
fn named(uri: &str, folder: &Path) -> Result<Vec<u8>, String> {
    if let Some(inside) = uri.strip_prefix("data:") {
        let Some((kind, text)) = inside.split_once(',') else {
            return Err("a data URI without a comma".into());
        };
        return match kind.ends_with(";base64") {
            true => base64(text).ok_or_else(|| "not base64".into()),
            false => Ok(percent_decoded(text)),
        };
    }
    if uri.contains(':') {
        return Err(format!("{uri:?} is no file in the folder of this one"));
    }
    // RFC 3986: a name may be written with %20; some writers leave it as it is, and some write the separator of Windows
    let decoded = String::from_utf8_lossy(&percent_decoded(uri)).replace('\\', "/");
    let read = |name: &str| crate::base::files::read_inside(folder, name);
    read(&decoded).or_else(|error| read(uri).map_err(|_| format!("{uri:?}: {error}")))
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digits = after.get(..2).and_then(|two| std::str::from_utf8(two).ok());
        let byte = digits.filter(|_| first == b'%').and_then(|two| u8::from_str_radix(two, 16).ok());
        bytes.push(byte.unwrap_or(first));
        rest = if byte.is_some() { &after[2..] } else { after };
    }
    bytes
}

/// RFC 4648, with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches(|letter: char| letter == '=' || letter.is_ascii_whitespace());
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut held) = (0_u32, 0);
    for letter in text.bytes() {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'\n' | b'\r' => continue,
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
