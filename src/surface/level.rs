//! The points that one threshold still misses, by cell.

use glam::DVec3;

use crate::scene::bricks::{BrickIndex, CELLS, cell_of, split};

/// For every cell that a helpful hit could lie in, the missing points within the threshold of the cell.
#[derive(Debug)]
pub(super) struct Level {
    per_m: f64,
    bricks: BrickIndex,
    /// Which cells of a brick have a list, and the number of lists before the brick.
    present: Vec<([u64; CELLS / 64], u32)>,
    /// List `n` is `points[starts[n]..starts[n + 1]]`.
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
        // far outside the reach of brick coordinates, so nothing is there
        Self { brick: [i32::MAX; 3], number: None }
    }
}

impl Level {
    /// For the points numbered in `missing` (best in the order of a space-filling curve).
    pub fn new(threshold_m: f64, points_m: &[DVec3], missing: &[u32]) -> Self {
        // with cells of twice the threshold a point is in reach of at most two cells along each axis
        let cell_m = 2.0 * threshold_m;
        let mut level = Self {
            per_m: 1.0 / cell_m,
            bricks: BrickIndex::default(),
            present: Vec::new(),
            starts: Vec::new(),
            points: Vec::new(),
        };
        let mut entries: Vec<(u32, u16, u32)> = Vec::with_capacity(7 * missing.len());
        let mut last = LastBrick::default();
        for &point in missing {
            level.for_cells_near(points_m[point as usize], threshold_m, |level, cell| {
                let (brick, inside) = split(cell);
                if brick != last.brick {
                    last = LastBrick { brick, number: level.bricks.find_or_add(brick) };
                }
                let Some(number) = last.number else { return };
                if number as usize == level.present.len() {
                    level.present.push(([0; CELLS / 64], 0));
                }
                level.present[number as usize].0[inside / 64] |= 1 << (inside % 64);
                entries.push((number, inside as u16, point));
            });
        }
        level.fill(&entries);
        level
    }

    /// Missing points near a hit: every one within the threshold, and some beyond.
    #[inline]
    pub fn near(&self, hit_m: DVec3, last: &mut LastBrick) -> &[u32] {
        let (brick, inside) = split(cell_of(hit_m, self.per_m));
        if brick != last.brick {
            *last = LastBrick { brick, number: self.bricks.find(brick) };
        }
        let Some(number) = last.number else { return &[] };
        let (present, _) = &self.present[number as usize];
        if present[inside / 64] >> (inside % 64) & 1 == 0 {
            return &[];
        }
        let list = self.list(number, inside);
        &self.points[self.starts[list] as usize..self.starts[list + 1] as usize]
    }

    fn list(&self, number: u32, inside: usize) -> usize {
        let (present, before) = &self.present[number as usize];
        let whole: u32 = present[..inside / 64].iter().map(|word| word.count_ones()).sum();
        let part = (present[inside / 64] & ((1 << (inside % 64)) - 1)).count_ones();
        (before + whole + part) as usize
    }

    fn fill(&mut self, entries: &[(u32, u16, u32)]) {
        let mut lists = 0;
        for (present, before) in &mut self.present {
            *before = lists;
            lists += present.iter().map(|word| word.count_ones()).sum::<u32>();
        }
        self.starts = vec![0; lists as usize + 2];
        for (number, inside, _) in entries {
            let list = self.list(*number, usize::from(*inside));
            self.starts[list + 2] += 1;
        }
        for list in 1..self.starts.len() {
            self.starts[list] += self.starts[list - 1];
        }
        self.points = vec![0; entries.len()];
        for (number, inside, point) in entries {
            let list = self.list(*number, usize::from(*inside));
            self.points[self.starts[list + 1] as usize] = *point;
            self.starts[list + 1] += 1;
        }
        self.starts.pop();
    }

    fn for_cells_near(
        &mut self,
        point_m: DVec3,
        threshold_m: f64,
        mut visit: impl FnMut(&mut Self, [i32; 3]),
    ) {
        // a hair wider than the threshold, so that rounding cannot lose a cell
        let reach_m = threshold_m * (1.0 + 1e-9) + 1e-12;
        let low = cell_of(point_m - reach_m, self.per_m);
        let high = cell_of(point_m + reach_m, self.per_m);
        let cell_m = 1.0 / self.per_m;
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let corner = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * cell_m;
                    let nearest = point_m.clamp(corner, corner + cell_m);
                    if nearest.distance_squared(point_m) <= reach_m * reach_m {
                        visit(self, [x, y, z]);
                    }
                }
            }
        }
    }
}
