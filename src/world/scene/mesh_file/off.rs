//! OFF in text (Geomview manual, "OFF Files"): counts, vertices, faces; colours, normals and texture coordinates are passed
//! over.

use glam::DVec3;

use super::{Fault, Soup};
use crate::base::text;

/// Reads vertices and faces.
pub(super) fn read(bytes: &[u8]) -> Result<Soup, Fault> {
    let lines = text::lines(bytes).map_err(|reason| Fault::at("text", reason))?;
    let mut lines = lines.filter_map(|(number, line)| {
        let data = line.split('#').next().unwrap_or_default().trim().to_owned();
        (!data.is_empty()).then_some((number, data))
    });
    let ends = |what: &str| Fault::at("text", format!("the file ends before its {what}"));
    let (number, first) = lines.next().ok_or_else(|| ends("keyword OFF"))?;
    // the keyword may be left out, and some writers put the counts right behind it
    let counts = match first.find("OFF") {
        Some(at) => {
            let (prefix, rest) = (&first[..at], first[at + 3..].trim());
            if let Some(letter) = prefix.chars().find(|letter| !"STCN".contains(*letter)) {
                let reason = format!("{first:?}: {letter:?} before OFF, expected a mesh in three dimensions");
                return Err(Fault::line(number, reason));
            }
            if rest.to_ascii_uppercase().starts_with("BINARY") {
                return Err(Fault::line(number, "a binary OFF, expected one in text: save it as text"));
            }
            match rest {
                "" => lines.next().ok_or_else(|| ends("counts"))?,
                rest => (number, rest.to_owned()),
            }
        }
        None => (number, first),
    };
    let (number, counts) = counts;
    let given: Vec<usize> = counts.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let [vertices, faces, ..] = given[..] else {
        let reason = format!("{counts:?}, expected the keyword OFF and the numbers of vertices and faces");
        return Err(Fault::line(number, reason));
    };
    let mut soup = Soup::default();
    for at in 0..vertices {
        let (number, line) = lines.next().ok_or_else(|| ends(&format!("vertex {at} of {vertices}")))?;
        let mut words = line.split_whitespace();
        let mut point = DVec3::ZERO;
        for axis in 0..3 {
            let word = words
                .next()
                .ok_or_else(|| Fault::line(number, format!("a vertex of {axis} coordinates, expected 3")))?;
            point[axis] = super::coordinate(word, number)?;
        }
        soup.vertices.push(point);
    }
    let mut polygon = Vec::new();
    for at in 0..faces {
        let (number, line) = lines.next().ok_or_else(|| ends(&format!("face {at} of {faces}")))?;
        let mut words = line.split_whitespace().map(str::parse::<u32>);
        let corners = words.next().and_then(Result::ok).unwrap_or(0) as usize;
        polygon.clear();
        polygon.extend(words.take(corners).map_while(Result::ok));
        if polygon.len() != corners || corners < 3 {
            let reason =
                format!("{line:?}, expected the number of corners, 3 or more, and that many vertices");
            return Err(Fault::line(number, reason));
        }
        soup.push_polygon(&polygon);
    }
    Ok(soup)
}
