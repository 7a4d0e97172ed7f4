//! PCD 0.7, binary. Source: Point Cloud Library, "The PCD file format".

use super::record::{BYTES, FIELDS, Field};

/// The header has the same length whatever the count: a comment fills it up.
pub(super) fn header(points: u64, _: bool) -> String {
    let list = |of: &dyn Fn(&Field) -> String| FIELDS.iter().map(of).collect::<Vec<_>>().join(" ");
    let fill = "-".repeat(2 * (20 - points.to_string().len()));
    debug_assert_eq!(FIELDS.iter().map(|(_, _, size, _)| size).sum::<usize>(), BYTES);
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# outrigger; t: ns since the frame's start; timestamp: s {fill}\n\
         VERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n\
         POINTS {points}\nDATA binary\n",
        list(&|field| field.0.to_owned()),
        list(&|field| field.2.to_string()),
        list(&|field| field.1.to_string()),
        list(&|_| "1".to_owned()),
    )
}
