//! STL, text and binary. A file is binary when its length is what its triangle count asks for: many binary files
//! begin with the word `solid` too.

use glam::DVec3;

use super::{Fault, MeshUnit, Soup};
use crate::base::text;

const HEADER: usize = 84;
const FACET: usize = 50;

/// Reads every facet of every solid. Corners stay unshared: ray casting needs no topology.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let expected = facets(bytes).map(|count| HEADER as u64 + FACET as u64 * u64::from(count));
    let binary = expected == Some(bytes.len() as u64);
    if !binary && is_text(bytes) {
        return read_text(bytes);
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

/// Whether a file begins as a text STL does; a binary one holds zeros, a text none.
fn is_text(bytes: &[u8]) -> bool {
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let word = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    (word || start.starts_with(b"#")) && !bytes.contains(&0) || bytes.starts_with(b"\xff\xfe")
}

fn facets(bytes: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(80..)?.first_chunk()?))
}

fn read_binary(bytes: &[u8]) -> Soup {
    let mut soup =
        Soup { unit: MeshUnit::of_comment(&String::from_utf8_lossy(&bytes[..80])), ..Soup::default() };
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
    soup.note_single_precision();
    soup
}

fn read_text(bytes: &[u8]) -> Result<Soup, Fault> {
    let mut soup = Soup::default();
    let mut corners = 0;
    let mut open = false;
    let mut last = 0;
    for (number, line) in text::lines(bytes).map_err(|reason| Fault::at("text", reason))? {
        last = number;
        // several statements may share a line, and one may go on in the next after a backslash
        let mut words = line.split(['#', '\\']).next().unwrap_or_default().split_whitespace();
        while let Some(word) = words.next() {
            match word.to_ascii_lowercase().as_str() {
                "solid" | "endsolid" => {
                    open = word.eq_ignore_ascii_case("solid");
                    break; // its name
                }
                "facet" => {
                    corners = 0;
                    soup.vertices.truncate(3 * soup.triangles.len());
                }
                "vertex" => {
                    soup.vertices.push(vertex(&mut words, number)?);
                    corners += 1;
                }
                "endfacet" => {
                    if corners != 3 {
                        return Err(Fault::line(
                            number,
                            format!("a facet of {corners} vertices, expected 3"),
                        ));
                    }
                    let end = soup.vertices.len() as u32;
                    soup.triangles.push([end - 3, end - 2, end - 1]);
                    corners = 0;
                }
                "normal" | "outer" | "loop" | "endloop" | "color" => {}
                other if super::number(other).is_some() => {} // of a normal: it follows from the corners
                _ => return Err(Fault::line(number, format!("{word:?} is no word of a text STL"))),
            }
        }
    }
    if open || corners != 0 {
        return Err(Fault::line(last, "the file ends before endsolid"));
    }
    Ok(soup)
}

fn vertex<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<DVec3, Fault> {
    let mut point = DVec3::ZERO;
    for axis in 0..3 {
        point[axis] = super::coordinate(words.next().unwrap_or_default(), line)?;
    }
    Ok(point)
}
