//! Wavefront OBJ: the `v` and `f` statements (specification: Wavefront Advanced Visualizer manual, appendix B1).

use std::borrow::Cow;

use glam::DVec3;

use super::{Fault, MeshUnit, Soup};
use crate::base::text;

/// Reads vertices and faces. Everything that is not geometry is passed over, but for a comment that names the unit.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let mut soup = Soup::default();
    let mut polygon = Vec::new();
    let mut lines = text::lines(bytes).map_err(|reason| Fault::at("text", reason))?;
    while let Some((number, line)) = lines.next() {
        let (statement, comment) = parts(&line);
        let mut statement = Cow::Borrowed(statement);
        if soup.unit.is_none() && !comment.is_empty() {
            soup.unit = MeshUnit::of_comment(comment);
        }
        // a backslash at the end joins the next line
        while let Some(begun) = statement.trim_end().strip_suffix('\\') {
            let mut joined = begun.to_owned();
            let Some((_, next)) = lines.next() else { break };
            joined.push(' ');
            joined.push_str(parts(&next).0);
            statement = Cow::Owned(joined);
        }
        let mut words = statement.split_ascii_whitespace();
        match words.next().unwrap_or_default() {
            "v" | "V" => soup.vertices.push(vertex(&mut words, number)?),
            // `fo` was a face too, before version 3
            "f" | "F" | "fo" | "FO" => {
                polygon.clear();
                for word in words {
                    polygon.push(corner(word, soup.vertices.len(), number)?);
                }
                if polygon.len() < 3 {
                    let reason = format!("a face of {} corners, expected at least 3", polygon.len());
                    return Err(Fault::line(number, reason));
                }
                soup.push_polygon(&polygon);
            }
            _ => {}
        }
    }
    Ok(soup)
}

/// A line without its comment, and the comment.
fn parts(line: &str) -> (&str, &str) {
    line.split_once('#').unwrap_or((line, ""))
}

fn vertex<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<DVec3, Fault> {
    let mut point = DVec3::ZERO;
    for axis in 0..3 {
        let word = words
            .next()
            .ok_or_else(|| Fault::line(line, format!("a vertex of {axis} coordinates, expected 3")))?;
        point[axis] = super::coordinate(word, line)?;
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
