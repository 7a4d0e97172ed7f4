//! Rows to SVG: line charts and pictures of coverage. Colours come from CSS classes of the page around them, so one
//! picture serves light and dark; a picture carries its data's numbers in its text, so it can be read alone.

mod axis;
mod cells;
mod line;
mod scatter;

pub use crate::base::numbers::{number, signed};
pub use cells::{CellClass, CellMap, cell_map_svg};
pub use line::{LineChart, Series};
pub use scatter::{NamedPoint, ScatterChart};

/// Text safe inside SVG and HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
