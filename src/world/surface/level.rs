//! The points that one threshold still misses, by cell.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::DVec3;

use crate::world::scene::bricks::{BrickIndex, CELLS, EDGE, LastRegion, cell_of, split};

/// Which bricks, and which of their cells, need no more hits. Flags are only ever set.
#[derive(Debug, Default)]
pub(super) struct DoneCells {
    index: BrickIndex,
    bricks: Vec<AtomicBool>,
    cells: Vec<[AtomicU64; CELLS / 64]>,
}

/// How much around a hit needs no more hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Done {
    /// Nothing: there are points that another hit in the same cell may find.
    Nothing,
    /// The cell.
    Cell,
    /// The brick around it.
    Brick,
}

/// A cell of [`DoneCells`].
#[derive(Clone, Copy, Debug)]
pub(super) struct CellPlace {
    number: u32,
    inside: usize,
}

impl DoneCells {
    /// Makes room for a brick.
    pub(crate) fn add(&mut self, brick: [i32; 3], last: &mut LastRegion) -> Option<u32> {
        let number = self.index.find_or_add_near(brick, last)?;
        if number as usize == self.cells.len() {
            self.bricks.push(AtomicBool::new(false));
            self.cells.push([const { AtomicU64::new(0) }; CELLS / 64]);
        }
        Some(number)
    }

    /// Where a cell is, if its brick exists.
    #[inline]
    pub(crate) fn find(&self, cell: [i32; 3], last: &mut LastRegion) -> Option<CellPlace> {
        let (brick, inside) = split(cell);
        Some(CellPlace { number: self.index.find_near(brick, last)?, inside })
    }

    /// What is done at a place.
    #[inline]
    pub(crate) fn done(&self, place: CellPlace) -> Done {
        if self.bricks[place.number as usize].load(Ordering::Relaxed) {
            return Done::Brick;
        }
        let word = self.cells[place.number as usize][place.inside / 64].load(Ordering::Relaxed);
        if word >> (place.inside % 64) & 1 == 1 { Done::Cell } else { Done::Nothing }
    }

    /// Notes what is done at a place.
    #[inline]
    pub(crate) fn close(&self, place: CellPlace, done: Done) {
        match done {
            Done::Nothing => {}
            Done::Cell => {
                let word = &self.cells[place.number as usize][place.inside / 64];
                word.fetch_or(1 << (place.inside % 64), Ordering::Relaxed);
            }
            Done::Brick => self.bricks[place.number as usize].store(true, Ordering::Relaxed),
        }
    }
}

/// Bricks, each with a list of every missing point that a hit in it can be within the threshold of.
#[derive(Debug)]
pub(super) struct Level {
    threshold_m: f64,
    cell_m: f64,
    cells: DoneCells,
    /// The list of brick `b` is `points[starts[b]..starts[b + 1]]`.
    starts: Vec<u32>,
    points: Vec<u32>,
}

impl Level {
    /// For all points (best in the order of a space-filling curve).
    pub(crate) fn new(threshold_m: f64, cell_m: f64, points_m: &[DVec3]) -> Self {
        let mut level =
            Self { threshold_m, cell_m, cells: DoneCells::default(), starts: Vec::new(), points: Vec::new() };
        let all: Vec<u32> = (0..points_m.len() as u32).collect();
        level.list(points_m, &all);
        level
    }

    /// Makes the lists again, of the points numbered in `missing` only.
    pub(crate) fn list(&mut self, points_m: &[DVec3], missing: &[u32]) {
        let mut entries: Vec<(u32, u32)> = Vec::with_capacity(4 * missing.len());
        let mut last = LastRegion::default();
        for &point in missing {
            let point_m = points_m[point as usize];
            for_cubes_near(point_m, self.threshold_m, f64::from(EDGE) * self.cell_m, |brick| {
                entries.extend(self.cells.add(brick, &mut last).map(|number| (number, point)));
            });
        }
        // a counting sort; starts[l + 1] moves from the start to the end of list l while it fills
        self.starts = vec![0; self.cells.cells.len() + 2];
        for (list, _) in &entries {
            self.starts[*list as usize + 2] += 1;
        }
        for list in 1..self.starts.len() {
            self.starts[list] += self.starts[list - 1];
        }
        self.points = vec![0; entries.len()];
        for (list, point) in &entries {
            let end = &mut self.starts[*list as usize + 1];
            self.points[*end as usize] = *point;
            *end += 1;
        }
        self.starts.pop();
    }

    /// Which cells need no more hits.
    #[inline]
    pub(crate) fn cells(&self) -> &DoneCells {
        &self.cells
    }

    /// Points that a hit in the brick can be within the threshold of.
    #[inline]
    pub(crate) fn near(&self, place: CellPlace) -> &[u32] {
        let list = place.number as usize;
        &self.points[self.starts[list] as usize..self.starts[list + 1] as usize]
    }

    /// Whether some hit in the cell can be within the threshold of the point.
    #[inline]
    pub(crate) fn reaches(&self, cell: [i32; 3], point_m: DVec3) -> bool {
        let corner = DVec3::from(cell.map(f64::from)) * self.cell_m;
        // rounding of the corner must not make a cell done that is not
        let slack = 1e-6 * self.threshold_m;
        let nearest = point_m.clamp(corner - slack, corner + (self.cell_m + slack));
        nearest.distance_squared(point_m) <= self.threshold_m * self.threshold_m
    }
}

/// Visits the cubes of edge `edge_m` that come within the threshold of a point.
pub(super) fn for_cubes_near(point_m: DVec3, threshold_m: f64, edge_m: f64, mut visit: impl FnMut([i32; 3])) {
    // a hair wider than the threshold, so that rounding cannot lose a cube
    let reach_m = threshold_m * (1.0 + 1e-6);
    let per_m = 1.0 / edge_m;
    let (low, high) = (cell_of(point_m - reach_m, per_m), cell_of(point_m + reach_m, per_m));
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                let corner = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * edge_m;
                let nearest = point_m.clamp(corner, corner + edge_m);
                if nearest.distance_squared(point_m) <= reach_m * reach_m {
                    visit([x, y, z]);
                }
            }
        }
    }
}
