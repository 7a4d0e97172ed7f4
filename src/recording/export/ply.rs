//! PLY 1.0, binary little-endian. Source: G. Turk, "The PLY Polygon File Format", 1994.

use super::record::FIELDS;

/// The header has the same length whatever the count: a comment fills it up.
pub(super) fn header(points: u64) -> String {
    let fill = "-".repeat(20 - points.to_string().len());
    let properties: String =
        FIELDS.iter().map(|(name, _, _, kind)| format!("property {kind} {name}\n")).collect();
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment outrigger; t: ns since the frame's start; timestamp: s {fill}\n\
         element vertex {points}\n{properties}end_header\n"
    )
}
