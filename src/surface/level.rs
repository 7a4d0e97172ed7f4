//! The points that one threshold still misses, by cell.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use crate::scene::bricks::{BrickIndex, CELLS, EDGE, cell_of, split};

/// Lists of a brick: 2 x 2 x 2.
const LISTS: usize = 8;

/// Bricks of 8 x 8 x 8 cells, a cell half a threshold wide. A quarter of a brick's edge is the threshold, so a list for
/// each eighth of a brick holds every missing point that a hit there can be within the threshold of. A cell from which
/// no missing point can be reached is done for good.
#[derive(Debug)]
pub(super) struct Level {
    threshold_m: f64,
    per_m: f64,
    bricks: BrickIndex,
    done: Vec<[AtomicU64; CELLS / 64]>,
    /// List `l` of brick `b` is `points[starts[8 b + l]..starts[8 b + l + 1]]`.
    starts: Vec<u32>,
    points: Vec<u32>,
}

/// The brick that the last hit of a thread fell into: the next is likely in the same one.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastBrick {
    brick: [i32; 3],
    number: Option<u32>,
}

impl Default for LastBrick {
    fn default() -> Self {
        // outside the reach of brick coordinates, so nothing is there
        Self { brick: [i32::MAX; 3], number: None }
    }
}

/// A cell that a hit fell into and that is not done.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpenCell {
    cell: [i32; 3],
    number: u32,
    inside: usize,
}

impl Level {
    /// For all points (best in the order of a space-filling curve).
    pub fn new(threshold_m: f64, points_m: &[DVec3]) -> Self {
        let mut level = Self {
            threshold_m,
            per_m: 2.0 / threshold_m,
            bricks: BrickIndex::default(),
            done: Vec::new(),
            starts: Vec::new(),
            points: Vec::new(),
        };
        let all: Vec<u32> = (0..points_m.len() as u32).collect();
        level.list(points_m, &all);
        let bricks = level.bricks.len();
        level.done = (0..bricks).map(|_| [const { AtomicU64::new(0) }; CELLS / 64]).collect();
        level
    }

    /// Makes the lists again, of the points numbered in `missing` only.
    pub fn list(&mut self, points_m: &[DVec3], missing: &[u32]) {
        let mut entries: Vec<(u32, u32)> = Vec::with_capacity(7 * missing.len());
        let mut last = LastBrick::default();
        for &point in missing {
            for_eighths_near(points_m[point as usize], self.threshold_m, |brick, eighth| {
                if brick != last.brick {
                    last = LastBrick { brick, number: self.bricks.find_or_add(brick) };
                }
                if let Some(number) = last.number {
                    entries.push((LISTS as u32 * number + eighth, point));
                }
            });
        }
        // a counting sort; starts[l + 1] moves from the start to the end of list l while it fills
        self.starts = vec![0; LISTS * self.bricks.len() + 2];
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

    /// The cell around a hit, unless nothing is missing near it.
    #[inline]
    pub fn open_cell(&self, hit_m: DVec3, last: &mut LastBrick) -> Option<OpenCell> {
        let cell = cell_of(hit_m, self.per_m);
        let (brick, inside) = split(cell);
        if brick != last.brick {
            *last = LastBrick { brick, number: self.bricks.find(brick) };
        }
        let number = last.number?;
        let done = self.done[number as usize][inside / 64].load(Ordering::Relaxed);
        (done >> (inside % 64) & 1 == 0).then_some(OpenCell { cell, number, inside })
    }

    /// Points that may be within the threshold of the cell.
    #[inline]
    pub fn near(&self, open: OpenCell) -> &[u32] {
        // the high bit of each coordinate in the brick: bits 2, 5 and 8 of the number
        let eighth = open.inside >> 2 & 1 | open.inside >> 4 & 2 | open.inside >> 6 & 4;
        let list = LISTS * open.number as usize + eighth;
        &self.points[self.starts[list] as usize..self.starts[list + 1] as usize]
    }

    /// Whether some hit in the cell can be within the threshold of the point.
    #[inline]
    pub fn reaches(&self, open: OpenCell, point_m: DVec3) -> bool {
        let cell_m = 0.5 * self.threshold_m;
        let corner = DVec3::from(open.cell.map(f64::from)) * cell_m;
        // rounding of the corner must not make a cell done that is not
        let slack = 1e-6 * self.threshold_m;
        let nearest = point_m.clamp(corner - slack, corner + (cell_m + slack));
        nearest.distance_squared(point_m) <= self.threshold_m * self.threshold_m
    }

    /// Nothing is left to find from the cell.
    #[inline]
    pub fn close(&self, open: OpenCell) {
        let word = &self.done[open.number as usize][open.inside / 64];
        word.fetch_or(1 << (open.inside % 64), Ordering::Relaxed);
    }
}

fn for_eighths_near(point_m: DVec3, threshold_m: f64, mut visit: impl FnMut([i32; 3], u32)) {
    // a hair wider than the threshold, so that rounding cannot lose an eighth
    let reach_m = threshold_m * (1.0 + 1e-6);
    let edge_m = 2.0 * threshold_m;
    let cells_per_eighth = EDGE / 2;
    let per_m = 2.0 / threshold_m;
    let eighth = |at: DVec3| cell_of(at, per_m).map(|cell| cell.div_euclid(cells_per_eighth));
    let (low, high) = (eighth(point_m - reach_m), eighth(point_m + reach_m));
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                let corner = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * edge_m;
                let nearest = point_m.clamp(corner, corner + edge_m);
                if nearest.distance_squared(point_m) <= reach_m * reach_m {
                    visit([x >> 1, y >> 1, z >> 1], (x & 1 | (y & 1) << 1 | (z & 1) << 2) as u32);
                }
            }
        }
    }
}
