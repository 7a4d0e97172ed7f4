//! Which cells of space were hit, by which sensor. [`Coverage::add`] alone adds points, for predicted and recorded
//! points alike.

mod ply;

use std::borrow::Cow;

use glam::DVec3;
use sha2::{Digest as _, Sha256};

use crate::base::files::hexadecimal;
use crate::world::scene::bricks::{self, BrickIndex};

/// A regular grid of cubic cells; cell (i, j, k) spans `origin_m + voxel_m * (i..i+1, j..j+1, k..k+1)`.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    /// Least corner, m.
    pub origin_m: DVec3,
    /// Edge length, m.
    pub voxel_m: f64,
    /// Cells along x, y, z.
    pub cells: [usize; 3],
}

impl VoxelGrid {
    /// A grid in which the planes of `bounds_m` run through cell centres, so that range noise does not move a wall's
    /// hits into the next cell.
    pub fn centred_on(bounds_m: [DVec3; 2], voxel_m: f64) -> Self {
        let size = (bounds_m[1] - bounds_m[0]) / voxel_m;
        let cells = [size.x, size.y, size.z].map(|n| n.round() as usize + 1);
        Self { origin_m: bounds_m[0] - DVec3::splat(0.5 * voxel_m), voxel_m, cells }
    }

    /// A grid from the least corner of `bounds_m` on: for a map, the bounds of which lie on faces of its voxels.
    pub(crate) fn from_corner([low_m, high_m]: [DVec3; 2], voxel_m: f64) -> Self {
        let cells = ((high_m - low_m) / voxel_m - 1e-6).ceil().max(DVec3::ONE);
        Self { origin_m: low_m, voxel_m, cells: cells.to_array().map(|count| count as usize) }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.iter().product()
    }

    /// No cells at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Linear index of the cell around a point, x fastest; none outside.
    #[inline]
    pub(crate) fn index(&self, point_m: DVec3) -> Option<usize> {
        let cell = (point_m - self.origin_m) / self.voxel_m;
        let [nx, ny, nz] = self.cells;
        let is_inside = (cell.x >= 0.0 && cell.x < nx as f64)
            & (cell.y >= 0.0 && cell.y < ny as f64)
            & (cell.z >= 0.0 && cell.z < nz as f64);
        // of what is not negative the whole part is the floor; cells are far fewer than an i64 holds
        let (i, j, k) = (cell.x as i64 as usize, cell.y as i64 as usize, cell.z as i64 as usize);
        is_inside.then(|| i + nx * (j + ny * k))
    }

    /// Number of the cells that touch the outside.
    pub(crate) fn outer_count(&self) -> f64 {
        let inner = |cells: usize| cells.saturating_sub(2) as f64;
        let [all, within] = [self.cells.map(|cells| cells as f64), self.cells.map(inner)];
        all.iter().product::<f64>() - within.iter().product::<f64>()
    }

    /// The cells that touch the outside, ascending.
    pub(crate) fn outer_cells(&self) -> impl Iterator<Item = usize> + use<> {
        let [nx, ny, nz] = self.cells;
        (0..nz).flat_map(move |k| (0..ny).map(move |j| (j, k))).flat_map(move |(j, k)| {
            let is_wall = [(j, ny), (k, nz)].iter().any(|(at, cells)| *at == 0 || at + 1 == *cells);
            // of a row within only the ends touch the outside
            let step = if is_wall { 1 } else { nx.saturating_sub(1).max(1) };
            (0..nx).step_by(step).map(move |i| i + nx * (j + ny * k))
        })
    }

    /// Brick of a cell, and the cell's number in it.
    fn brick(&self, cell: usize) -> ([i32; 3], usize) {
        let [i, j, k] = self.place(cell);
        bricks::split([i as i32, j as i32, k as i32])
    }

    /// i, j, k of a cell.
    pub(crate) fn place(&self, cell: usize) -> [usize; 3] {
        let [nx, ny, _] = self.cells;
        [cell % nx, cell / nx % ny, cell / (nx * ny)]
    }

    /// Centre of a cell, m.
    pub(crate) fn centre_m(&self, index: usize) -> DVec3 {
        let [i, j, k] = self.place(index);
        self.origin_m + self.voxel_m * (DVec3::new(i as f64, j as f64, k as f64) + 0.5)
    }
}

/// Cells hit by each sensor. Bit `index` of a bitmap is bit `index % 64` of word `index / 64`. Small grids are stored as
/// whole bitmaps; of large ones only the bricks of 8 x 8 x 8 cells that were hit, so that memory grows with the surface.
#[derive(Clone, Debug)]
pub struct Coverage {
    grid: VoxelGrid,
    sensors: Vec<Cells>,
    outside: u64,
}

/// Grids up to this many cells are stored whole (8 MiB per sensor).
const WHOLE_CELLS: usize = 1 << 26;

#[derive(Clone, Debug)]
enum Cells {
    Whole(Vec<u64>),
    Bricks { index: BrickIndex, words: Vec<[u64; 8]> },
}

impl Coverage {
    /// Nothing covered yet.
    pub fn new(grid: VoxelGrid, sensors: usize) -> Self {
        let whole = grid.len() <= WHOLE_CELLS;
        Self::with_storage(grid, sensors, whole)
    }

    fn with_storage(grid: VoxelGrid, sensors: usize, whole: bool) -> Self {
        let empty = if whole {
            Cells::Whole(vec![0; grid.len().div_ceil(64)])
        } else {
            Cells::Bricks { index: BrickIndex::default(), words: Vec::new() }
        };
        Self { grid, sensors: vec![empty; sensors], outside: 0 }
    }

    /// Coverage from whole bitmaps, one per sensor, for kernels that mark many cells at once. Bits beyond the grid must
    /// be zero.
    pub(crate) fn from_bitmaps(grid: VoxelGrid, sensors: Vec<Vec<u64>>) -> Self {
        let words = grid.len().div_ceil(64);
        let last = grid.len() % 64;
        for bitmap in &sensors {
            assert_eq!(bitmap.len(), words, "a bitmap covers the whole grid");
            assert!(last == 0 || bitmap[words - 1] >> last == 0, "no bit lies beyond the grid");
        }
        Self { grid, sensors: sensors.into_iter().map(Cells::Whole).collect(), outside: 0 }
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// Marks the cell around a point as seen by a sensor. Points outside the grid are counted, not marked.
    #[inline]
    pub fn add(&mut self, sensor: usize, point_m: DVec3) {
        match self.grid.index(point_m) {
            Some(cell) => self.sensors[sensor].mark(&self.grid, cell),
            None => self.outside += 1,
        }
    }

    /// Points that fell outside the grid.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Forgets the cells that fail a test, whoever hit them.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let mut left = Self::new(self.grid.clone(), self.sensors.len());
        for (own, left) in self.sensors.iter().zip(&mut left.sensors) {
            own.for_each(&self.grid, |cell| {
                if keep(cell) {
                    left.mark(&self.grid, cell);
                }
            });
        }
        self.sensors = left.sensors;
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let of = |cells: &Cells| match cells {
            Cells::Whole(bitmap) => std::mem::size_of_val(&bitmap[..]),
            Cells::Bricks { index, words } => index.bytes() + std::mem::size_of_val(&words[..]),
        };
        self.sensors.iter().map(of).sum()
    }

    /// Number of sensors.
    pub fn sensors(&self) -> usize {
        self.sensors.len()
    }

    /// Whether a sensor hit a cell.
    pub fn contains(&self, sensor: usize, cell: usize) -> bool {
        match &self.sensors[sensor] {
            Cells::Whole(bitmap) => bitmap[cell / 64] >> (cell % 64) & 1 == 1,
            Cells::Bricks { index, words } => {
                let (brick, inside) = self.grid.brick(cell);
                let found = index.find(brick).map(|slot| words[slot as usize][inside / 64]);
                found.is_some_and(|word| word >> (inside % 64) & 1 == 1)
            }
        }
    }

    /// Bitmap of one sensor over the whole grid; made for the purpose where the grid is large.
    pub(crate) fn sensor_bitmap(&self, sensor: usize) -> Cow<'_, [u64]> {
        match &self.sensors[sensor] {
            Cells::Whole(bitmap) => Cow::Borrowed(bitmap),
            cells => {
                let mut bitmap = vec![0; self.grid.len().div_ceil(64)];
                cells.mark_on(&self.grid, &mut bitmap);
                Cow::Owned(bitmap)
            }
        }
    }

    /// Cells hit by any sensor, a bitmap over the whole grid.
    pub fn union(&self) -> Vec<u64> {
        let mut union = vec![0; self.grid.len().div_ceil(64)];
        for cells in &self.sensors {
            cells.mark_on(&self.grid, &mut union);
        }
        union
    }

    /// Cells hit by any sensor, ascending.
    pub(crate) fn union_cells(&self) -> Vec<usize> {
        let mut all = Vec::new();
        for cells in &self.sensors {
            cells.for_each(&self.grid, |cell| all.push(cell));
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Number of cells hit by any sensor.
    pub fn union_count(&self) -> u64 {
        self.counts().union
    }

    /// Adds what another coverage of the same grid and sensors has seen.
    pub(crate) fn join(&mut self, other: &Self) {
        assert!(
            self.grid == other.grid && self.sensors.len() == other.sensors.len(),
            "the same grid and sensors"
        );
        for (cells, more) in self.sensors.iter_mut().zip(&other.sensors) {
            cells.join(more);
        }
        self.outside += other.outside;
    }

    /// How many cells are hit by any, by several, by each and by each alone.
    pub fn counts(&self) -> Counts {
        let mut bricks = BrickIndex::default();
        for cells in &self.sensors {
            if let Cells::Bricks { index, .. } = cells {
                for brick in index.bricks() {
                    bricks.find_or_add(*brick);
                }
            }
        }
        let bitmaps: Vec<_> = self.sensors.iter().map(|cells| cells.aligned(&bricks)).collect();
        let bitmaps: Vec<_> = bitmaps.iter().map(|bitmap| &**bitmap).collect();
        Counts::of_bitmaps(&bitmaps)
    }

    /// SHA-256 of the union bitmap, hexadecimal: bit `index` is bit `index % 8` of byte `index / 8`, the last byte
    /// padded with zeros.
    pub fn union_sha256(&self) -> String {
        let mut hash = Sha256::new();
        let mut left = self.grid.len().div_ceil(8);
        for word in self.union() {
            hash.update(&word.to_le_bytes()[..left.min(8)]);
            left = left.saturating_sub(8);
        }
        hexadecimal(&hash.finalize())
    }
}

impl PartialEq for Coverage {
    /// The same grid, the same cells for every sensor, as many points outside; however they are stored.
    fn eq(&self, other: &Self) -> bool {
        self.grid == other.grid
            && self.outside == other.outside
            && self.sensors.len() == other.sensors.len()
            && (0..self.sensors.len()).all(|sensor| self.sensor_bitmap(sensor) == other.sensor_bitmap(sensor))
    }
}

impl Cells {
    fn mark(&mut self, grid: &VoxelGrid, cell: usize) {
        match self {
            Self::Whole(bitmap) => bitmap[cell / 64] |= 1 << (cell % 64),
            Self::Bricks { index, words } => {
                let (brick, inside) = grid.brick(cell);
                words_of(index, words, brick)[inside / 64] |= 1 << (inside % 64);
            }
        }
    }

    fn join(&mut self, other: &Self) {
        match (self, other) {
            (Self::Whole(bitmap), Self::Whole(more)) => {
                bitmap.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
            }
            (Self::Bricks { index, words }, Self::Bricks { index: more_index, words: more }) => {
                for (brick, more) in more_index.bricks().iter().zip(more) {
                    let words = words_of(index, words, *brick);
                    words.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
                }
            }
            _ => unreachable!("a grid's size decides how its cells are stored"),
        }
    }

    /// A bitmap to count with: the whole one, or that of the given bricks in their order.
    fn aligned(&self, bricks: &BrickIndex) -> Cow<'_, [u64]> {
        match self {
            Self::Whole(bitmap) => Cow::Borrowed(bitmap),
            Self::Bricks { index, words } => {
                let of_brick =
                    |brick: &[i32; 3]| index.find(*brick).map_or([0; 8], |slot| words[slot as usize]);
                Cow::Owned(bricks.bricks().iter().flat_map(of_brick).collect())
            }
        }
    }

    /// Marks every cell on a bitmap over the whole grid.
    fn mark_on(&self, grid: &VoxelGrid, bitmap: &mut [u64]) {
        match self {
            Self::Whole(own) => bitmap.iter_mut().zip(own).for_each(|(word, own)| *word |= own),
            Self::Bricks { .. } => self.for_each(grid, |cell| bitmap[cell / 64] |= 1 << (cell % 64)),
        }
    }

    fn for_each(&self, grid: &VoxelGrid, mut take: impl FnMut(usize)) {
        match self {
            Self::Whole(bitmap) => {
                for (at, word) in bitmap.iter().enumerate().filter(|(_, word)| **word != 0) {
                    (0..64).filter(|bit| word >> bit & 1 == 1).for_each(|bit| take(at * 64 + bit));
                }
            }
            Self::Bricks { index, words } => {
                for (brick, words) in index.bricks().iter().zip(words) {
                    let [i, j, k] = brick.map(|at| at as usize * 8);
                    for inside in (0..512).filter(|inside| words[inside / 64] >> (inside % 64) & 1 == 1) {
                        let (i, j, k) = (i + inside % 8, j + inside / 8 % 8, k + inside / 64);
                        take(i + grid.cells[0] * (j + grid.cells[1] * k));
                    }
                }
            }
        }
    }
}

fn words_of<'a>(index: &mut BrickIndex, words: &'a mut Vec<[u64; 8]>, brick: [i32; 3]) -> &'a mut [u64; 8] {
    let slot = index.find_or_add(brick).expect("a grid with a cell number has few enough bricks") as usize;
    if slot == words.len() {
        words.push([0; 8]);
    }
    &mut words[slot]
}

/// How many cells were hit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counts {
    /// By at least one sensor.
    pub union: u64,
    /// By at least two sensors.
    pub overlap: u64,
    /// By each sensor.
    pub per_sensor: Vec<u64>,
    /// By each sensor and no other.
    pub unique_per_sensor: Vec<u64>,
}

impl Counts {
    /// From one bitmap per sensor, all of one length; a bit is a cell.
    #[inline(always)] // so that callers with better instructions count with them
    pub(crate) fn of_bitmaps(sensors: &[&[u64]]) -> Self {
        let mut counts = Self {
            union: 0,
            overlap: 0,
            per_sensor: vec![0; sensors.len()],
            unique_per_sensor: vec![0; sensors.len()],
        };
        let ones = |word: u64| u64::from(word.count_ones());
        for word in 0..sensors.first().map_or(0, |bitmap| bitmap.len()) {
            let (mut any, mut several) = (0, 0);
            for bitmap in sensors {
                several |= any & bitmap[word];
                any |= bitmap[word];
            }
            if any == 0 {
                continue;
            }
            counts.union += ones(any);
            counts.overlap += ones(several);
            for (sensor, bitmap) in sensors.iter().enumerate() {
                counts.per_sensor[sensor] += ones(bitmap[word]);
                counts.unique_per_sensor[sensor] += ones(bitmap[word] & !several);
            }
        }
        counts
    }

    /// Share of the cells hit that at least two sensors hit; 0 where nothing is hit.
    pub fn overlap_ratio(&self) -> f64 {
        self.overlap as f64 / self.union.max(1) as f64
    }
}

#[cfg(test)]
mod tests;
