//! PLY 1.0, binary little-endian. Source: G. Turk, "The PLY Polygon File Format", 1994.

use super::record::FIELDS;

/// The header has the same length whatever the count: a comment fills it up.
pub(super) fn header(points: u64, is_wide: bool) -> String {
    let fill = "-".repeat(20 - points.to_string().len());
    let kind_of = |name: &str, kind: &'static str| match name {
        "x" | "y" | "z" if is_wide => "double",
        _ => kind,
    };
    let properties: String = FIELDS
        .iter()
        .map(|(name, _, _, kind)| format!("property {} {name}\n", kind_of(name, kind)))
        .collect();
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment outrigger; t: ns since the frame's start; timestamp: s {fill}\n\
         element vertex {points}\n{properties}end_header\n"
    )
}
