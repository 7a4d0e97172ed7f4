//! Rows to SVG: line charts and pictures of coverage. Colours come from CSS classes of the page around them, so one
//! picture serves light and dark; a picture carries its data's numbers in its text, so it can be read alone.

mod axis;
mod cells;
mod line;
mod plan;
mod scatter;

pub(crate) use crate::base::numbers::{count, decimals_of};
pub use crate::base::numbers::{number, signed};
pub(crate) use cells::cell_map_svg;
pub use cells::{CellClass, CellMap};
pub use line::{LineChart, Series};
pub(crate) use plan::{Plan, PlanAxis};
pub use scatter::{NamedPoint, ScatterChart};

/// The data of a chart as CSV, inside its picture: what a page offers to save.
fn metadata<'a>(labels: [&str; 3], rows: impl Iterator<Item = (&'a str, [f64; 2])>) -> String {
    let word = |text: &str| match text.contains([',', '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    };
    let mut csv = labels.map(word).join(",");
    for (name, [x, y]) in rows {
        csv += &format!("\r\n{},{x},{y}", word(name));
    }
    format!("<metadata>{}</metadata>", escape(&csv))
}

/// Text safe inside SVG and HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
