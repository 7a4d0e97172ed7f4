//! Rows to SVG.
