//! Wavefront OBJ: the `v` and `f` statements (specification: Wavefront Advanced Visualizer manual, appendix B1).

use glam::DVec3;

use super::{Fault, Soup};

/// Reads vertices and faces; polygons become fans. Everything that is not geometry is passed over.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let mut soup = Soup::default();
    let mut polygon = Vec::new();
    let mut lines = bytes.split(|byte| *byte == b'\n').enumerate();
    while let Some((index, line)) = lines.next() {
        let line = std::str::from_utf8(line)
            .map_err(|_| Fault::line(index + 1, "not text; is this an OBJ file?"))?
            .trim_end();
        if !line.starts_with(['v', 'f']) {
            continue;
        }
        let mut statement = line.to_owned();
        // a backslash at the end joins the next line
        while statement.ends_with('\\') {
            statement.pop();
            match lines.next() {
                Some((_, next)) => statement.push_str(String::from_utf8_lossy(next).trim_end()),
                None => break,
            }
        }
        let mut words = statement.split_ascii_whitespace();
        match words.next() {
            Some("v") => soup.vertices.push(vertex(&mut words, index + 1)?),
            Some("f") => {
                polygon.clear();
                for word in words {
                    polygon.push(corner(word, soup.vertices.len(), index + 1)?);
                }
                if polygon.len() < 3 {
                    let reason = format!("a face of {} corners, expected at least 3", polygon.len());
                    return Err(Fault::line(index + 1, reason));
                }
                soup.push_polygon(&polygon);
            }
            _ => {}
        }
    }
    Ok(soup)
}

fn vertex<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<DVec3, Fault> {
    let mut point = DVec3::ZERO;
    for axis in 0..3 {
        let word = words
            .next()
            .ok_or_else(|| Fault::line(line, format!("a vertex of {axis} coordinates, expected 3")))?;
        let value: f64 = word
            .parse()
            .map_err(|_| Fault::line(line, format!("{word:?} where a coordinate is expected")))?;
        if !value.is_finite() {
            return Err(Fault::line(line, format!("the coordinate {word} is not finite")));
        }
        point[axis] = value;
    }
    Ok(point)
}

/// `7`, `7/1`, `7//3` or `-1` (counted back from the last vertex so far) to an index from 0. Forward references are
/// checked at the end with all vertices known.
fn corner(word: &str, vertices: usize, line: usize) -> Result<u32, Fault> {
    let number = word.split('/').next().unwrap_or_default();
    let fault = || Fault::line(line, format!("{word:?} where a vertex number is expected"));
    let given: i64 = number.parse().map_err(|_| fault())?;
    let index = match given {
        0 => return Err(Fault::line(line, "vertex number 0; OBJ counts from 1")),
        1.. => given - 1,
        _ => vertices as i64 + given,
    };
    u32::try_from(index).map_err(|_| {
        Fault::line(line, format!("vertex number {given} with {vertices} vertices before this line"))
    })
}
