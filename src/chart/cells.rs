//! Pictures of coverage: a map of square cells, each of one class, drawn as runs so that a wall of ten thousand cells
//! stays small.

use std::fmt::Write as _;

use super::escape;

/// A class of cells: CSS class and name in the legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellClass {
    /// CSS class of the page.
    pub css: &'static str,
    /// What the reader is told.
    pub name: String,
}

impl CellClass {
    /// A class.
    pub fn new(css: &'static str, name: impl Into<String>) -> Self {
        Self { css, name: name.into() }
    }
}

/// A rectangle of cells, row 0 at the bottom; `None` is left blank.
#[derive(Clone, Debug)]
pub struct CellMap {
    /// Caption above the map.
    pub title: String,
    /// Cells per row.
    pub width: usize,
    /// Class of each cell as an index into the picture's classes, row by row.
    pub cells: Vec<Option<usize>>,
}

/// Pixels per cell.
const CELL_PX: usize = 3;
const TITLE_PX: usize = 18;
const GAP_PX: usize = 16;

/// Maps beside each other, wrapped into rows of at most `columns`.
pub fn cell_map_svg(label: &str, maps: &[CellMap], classes: &[CellClass], columns: usize) -> String {
    let columns = columns.max(1);
    let mut body = String::new();
    let (mut width_px, mut top) = (0, 0);
    for row in maps.chunks(columns) {
        let mut left = 0;
        let mut tallest = 0;
        for map in row {
            let rows = map.cells.len().checked_div(map.width).unwrap_or(0);
            let _ = write!(body, "<text x=\"{left}\" y=\"{}\">{}</text>", top + 12, escape(&map.title));
            let (wide, tall) = (map.width * CELL_PX, rows * CELL_PX);
            let _ = write!(
                body,
                "<rect class=\"frame\" x=\"{left}\" y=\"{}\" width=\"{wide}\" height=\"{tall}\"/>",
                top + TITLE_PX
            );
            for (place, class) in classes.iter().enumerate() {
                let path = runs(map, place, left, top + TITLE_PX, rows);
                if !path.is_empty() {
                    let _ = write!(body, "<path class=\"{}\" d=\"{path}\"/>", class.css);
                }
            }
            left += wide + GAP_PX;
            tallest = tallest.max(tall);
        }
        width_px = width_px.max(left.saturating_sub(GAP_PX));
        top += TITLE_PX + tallest + GAP_PX;
    }
    format!(
        "<svg class=\"cells\" viewBox=\"0 0 {} {}\" style=\"max-width:{}px\" role=\"img\" aria-label=\"{}\">{body}</svg>",
        width_px.max(1),
        top.max(1),
        width_px.max(1) * 3 / 2,
        escape(label)
    )
}

fn runs(map: &CellMap, class: usize, left: usize, top: usize, rows: usize) -> String {
    let mut path = String::new();
    for (row, cells) in map.cells.chunks(map.width.max(1)).enumerate() {
        let mut column = 0;
        while column < cells.len() {
            if cells[column] != Some(class) {
                column += 1;
                continue;
            }
            let start = column;
            while column < cells.len() && cells[column] == Some(class) {
                column += 1;
            }
            let _ = write!(
                path,
                "M{} {}h{}v{CELL_PX}h-{}z",
                left + start * CELL_PX,
                top + (rows - 1 - row) * CELL_PX,
                (column - start) * CELL_PX,
                (column - start) * CELL_PX
            );
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_one_rectangle_and_row_zero_lies_at_the_bottom() {
        let classes = [CellClass::new("a", "A")];
        let map =
            CellMap { title: "t".into(), width: 3, cells: vec![Some(0), Some(0), None, None, None, None] };
        let svg = cell_map_svg("x", &[map], &classes, 1);
        assert!(svg.contains("d=\"M0 21h6v3h-6z\""), "{svg}");
    }
}
