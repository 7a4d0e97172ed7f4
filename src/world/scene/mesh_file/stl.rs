//! STL, text and binary. A file is binary when its length is what its triangle count asks for: many binary files
//! begin with the word `solid` too.

use glam::DVec3;

use super::{Fault, Soup};

const HEADER: usize = 84;
const FACET: usize = 50;

/// Reads every facet of every solid. Corners stay unshared: ray casting needs no topology.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let expected = facets(bytes).map(|count| HEADER as u64 + FACET as u64 * u64::from(count));
    let binary = expected == Some(bytes.len() as u64);
    let text_start = bytes.trim_ascii_start();
    if !binary && text_start.starts_with(b"solid") && text_start.is_ascii() {
        return read_text(text_start, bytes.len() - text_start.len(), bytes);
    }
    match expected {
        None => Err(Fault::byte(
            bytes.len(),
            format!("the file ends inside the header of {HEADER} bytes of a binary STL"),
        )),
        Some(length) if length > bytes.len() as u64 => Err(Fault::byte(
            bytes.len(),
            format!(
                "the file ends in facet {}, expected {length} bytes for {} facets",
                (bytes.len() - HEADER) / FACET,
                facets(bytes).unwrap_or_default()
            ),
        )),
        // exporters append colours or padding; what the count promises is there
        Some(_) => Ok(read_binary(bytes)),
    }
}

fn facets(bytes: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(80..)?.first_chunk()?))
}

fn read_binary(bytes: &[u8]) -> Soup {
    let mut soup = Soup::default();
    let count = facets(bytes).unwrap_or_default() as usize;
    for facet in bytes[HEADER..].chunks_exact(FACET).take(count) {
        let first = soup.vertices.len() as u32;
        let (numbers, _) = facet[12..48].as_chunks::<4>();
        for point in numbers.chunks_exact(3) {
            let [x, y, z] = [point[0], point[1], point[2]].map(|n| f64::from(f32::from_le_bytes(n)));
            soup.vertices.push(DVec3::new(x, y, z));
        }
        soup.triangles.push([first, first + 1, first + 2]);
    }
    soup
}

fn read_text(text: &[u8], skipped: usize, whole: &[u8]) -> Result<Soup, Fault> {
    let mut soup = Soup::default();
    let before = whole[..skipped].iter().filter(|byte| **byte == b'\n').count();
    let mut corners = 0;
    let mut open = false;
    let mut line_number = before;
    for line in text.split(|byte| *byte == b'\n') {
        line_number += 1;
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_ascii_whitespace();
        match words.next().map(str::to_ascii_lowercase).as_deref() {
            Some("solid") => open = true,
            Some("endsolid") => open = false,
            Some("facet") => corners = 0,
            Some("vertex") => {
                soup.vertices.push(vertex(&mut words, line_number)?);
                corners += 1;
            }
            Some("endfacet") => {
                if corners != 3 {
                    return Err(Fault::line(
                        line_number,
                        format!("a facet of {corners} vertices, expected 3"),
                    ));
                }
                let end = soup.vertices.len() as u32;
                soup.triangles.push([end - 3, end - 2, end - 1]);
                corners = 0;
            }
            None | Some("outer" | "endloop") => {}
            Some(other) => {
                return Err(Fault::line(line_number, format!("{other:?} is no word of a text STL")));
            }
        }
    }
    if open || corners != 0 {
        return Err(Fault::line(line_number, "the file ends before endsolid"));
    }
    Ok(soup)
}

fn vertex<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<DVec3, Fault> {
    let mut point = DVec3::ZERO;
    for axis in 0..3 {
        let word = words.next().unwrap_or_default();
        point[axis] = word
            .parse()
            .map_err(|_| Fault::line(line, format!("{word:?} where a coordinate is expected")))?;
    }
    Ok(point)
}
