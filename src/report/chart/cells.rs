//! Pictures of coverage: a map of square cells, each of one class, drawn as runs so that a wall of ten thousand cells
//! stays small.

use std::fmt::Write as _;

use super::{Plan, escape, number};

/// A class of cells: CSS class and name in the legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellClass {
    /// CSS class of the page.
    pub css: &'static str,
    /// Tooltip of the class.
    pub name: String,
}

impl CellClass {
    /// A class.
    pub(crate) fn new(css: &'static str, name: impl Into<String>) -> Self {
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
    /// Where it lies; none of what is no plan.
    pub(crate) plan: Option<Plan>,
}

impl CellMap {
    /// Number of rows.
    pub(crate) fn height(&self) -> usize {
        self.cells.len().checked_div(self.width).unwrap_or(0)
    }

    /// Width of its picture at most: it fills at most half a wide page.
    pub(crate) fn width_px(&self) -> usize {
        match &self.plan {
            Some(_) => Plan::width_px([self.width, self.height()]) as usize,
            None => self.width * (560 / self.width.max(self.height()).max(1)).clamp(2, 16),
        }
    }

    /// The same in squares of several cells, so that neither side has more than `most`: the class of most of a square's
    /// cells, of equals the last. The title says so.
    pub(crate) fn coarse(&self, most: usize) -> Self {
        let step = self.width.max(self.height()).div_ceil(most.max(1));
        if step <= 1 {
            return self.clone();
        }
        let (width, height) = (self.width.div_ceil(step), self.height().div_ceil(step));
        let square = |place: usize| {
            let (row, column) = (place / width * step, place % width * step);
            let rows = row..(row + step).min(self.height());
            let mut counts: Vec<u32> = Vec::new();
            for row in rows {
                let cells = &self.cells[row * self.width..(row + 1) * self.width];
                for class in cells[column..(column + step).min(self.width)].iter().flatten() {
                    counts.resize(counts.len().max(class + 1), 0);
                    counts[*class] += 1;
                }
            }
            (0..counts.len()).max_by_key(|class| counts[*class])
        };
        Self {
            title: format!("{} (squares of {step} x {step} voxels)", self.title),
            width,
            cells: (0..width * height).map(square).collect(),
            plan: self.plan.as_ref().map(|plan| plan.coarse(step)),
        }
    }

    /// How many cells each class has, in words.
    fn counts(&self, classes: &[CellClass]) -> String {
        let count = |class| self.cells.iter().filter(|cell| **cell == Some(class)).count();
        let counts = classes.iter().enumerate().map(|(at, class)| (count(at), &class.name));
        let words: Vec<_> = counts
            .filter(|(count, _)| *count > 0)
            .map(|(count, name)| format!("{} {name}", number(count as f64, 0)))
            .collect();
        if words.is_empty() { "nothing".into() } else { words.join(", ") }
    }
}

/// One map; a cell is a unit of the picture. The label for those who do not see it says how many cells each class has.
pub(crate) fn cell_map_svg(label: &str, map: &CellMap, classes: &[CellClass]) -> String {
    let (width, height) = (map.width.max(1), map.height().max(1));
    let mut body = String::new();
    for (place, class) in classes.iter().enumerate() {
        let path = runs(map, place, height);
        if !path.is_empty() {
            let _ = write!(body, "<path class=\"{}\" d=\"{path}\"/>", class.css);
        }
    }
    let words = format!("{label}, {}: {}", map.title, map.counts(classes));
    let view = format!("0 0 {width} {height}");
    let (view, body) = match &map.plan {
        Some(plan) => plan.around([width, height], &body),
        None => (view, body),
    };
    format!(
        "<svg class=\"cells\" viewBox=\"{view}\" data-rows=\"{height}\" shape-rendering=\"crispEdges\" role=\"img\" \
         aria-label=\"{}\">{body}</svg>",
        escape(&words)
    )
}

fn runs(map: &CellMap, class: usize, rows: usize) -> String {
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
            let _ = write!(path, "M{start} {}h{}v1h-{}z", rows - 1 - row, column - start, column - start);
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_one_rectangle_and_row_zero_lies_at_the_bottom() {
        let classes = [CellClass::new("a", "seen"), CellClass::new("b", "not seen")];
        let map = CellMap {
            title: "t".into(),
            width: 3,
            cells: vec![Some(0), Some(0), None, None, None, Some(1)],
            plan: None,
        };
        let svg = cell_map_svg("x", &map, &classes);
        assert!(svg.contains("d=\"M0 1h2v1h-2z\""), "{svg}");
        assert!(svg.contains("aria-label=\"x, t: 2 seen, 1 not seen\""), "{svg}");
    }

    #[test]
    fn a_coarse_map_shows_what_most_cells_are() {
        let cells = [Some(0), Some(1), None, Some(1), Some(0), None, Some(0), Some(0), Some(1)].to_vec();
        let map = CellMap { title: "t".into(), width: 3, cells, plan: None };
        let coarse = map.coarse(2);
        assert_eq!((coarse.width, coarse.height()), (2, 2));
        // of equal counts the last class, of an edge what is there
        assert_eq!(coarse.cells, [Some(1), None, Some(0), Some(1)]);
        assert_eq!(map.coarse(3).cells, map.cells);
    }
}
