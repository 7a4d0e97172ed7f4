//! Which cells of space were hit, by which sensor. [`Coverage::add`] is the only way in, for predicted and recorded
//! points alike.

use glam::DVec3;
use sha2::{Digest as _, Sha256};

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

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.iter().product()
    }

    /// No cells at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Linear index of the cell around a point, x fastest; none outside.
    pub fn index(&self, point_m: DVec3) -> Option<usize> {
        let cell = ((point_m - self.origin_m) / self.voxel_m).floor();
        let inside =
            |value: f64, count: usize| (value >= 0.0 && value < count as f64).then_some(value as usize);
        let i = inside(cell.x, self.cells[0])?;
        let j = inside(cell.y, self.cells[1])?;
        let k = inside(cell.z, self.cells[2])?;
        Some(i + self.cells[0] * (j + self.cells[1] * k))
    }

    /// Centre of a cell, m.
    pub fn centre_m(&self, index: usize) -> DVec3 {
        let i = index % self.cells[0];
        let j = index / self.cells[0] % self.cells[1];
        let k = index / (self.cells[0] * self.cells[1]);
        self.origin_m + self.voxel_m * (DVec3::new(i as f64, j as f64, k as f64) + 0.5)
    }
}

/// Cells hit, one bitmap per sensor, bit `index` of a bitmap is bit `index % 64` of word `index / 64`.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    grid: VoxelGrid,
    sensors: Vec<Vec<u64>>,
    outside: u64,
}

impl Coverage {
    /// Nothing covered yet.
    pub fn new(grid: VoxelGrid, sensors: usize) -> Self {
        let words = grid.len().div_ceil(64);
        Self { grid, sensors: vec![vec![0; words]; sensors], outside: 0 }
    }

    /// Coverage from whole bitmaps, one per sensor, for kernels that mark many cells at once. Bits beyond the grid must
    /// be zero.
    pub fn from_bitmaps(grid: VoxelGrid, sensors: Vec<Vec<u64>>) -> Self {
        let words = grid.len().div_ceil(64);
        let last = grid.len() % 64;
        for bitmap in &sensors {
            assert_eq!(bitmap.len(), words, "a bitmap covers the whole grid");
            assert!(last == 0 || bitmap[words - 1] >> last == 0, "no bit lies beyond the grid");
        }
        Self { grid, sensors, outside: 0 }
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// Marks the cell around a point as seen by a sensor. Points outside the grid are counted, not marked.
    pub fn add(&mut self, sensor: usize, point_m: DVec3) {
        match self.grid.index(point_m) {
            Some(index) => self.sensors[sensor][index / 64] |= 1 << (index % 64),
            None => self.outside += 1,
        }
    }

    /// Points that fell outside the grid.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Bitmap of one sensor.
    pub fn sensor_bitmap(&self, sensor: usize) -> &[u64] {
        &self.sensors[sensor]
    }

    /// Number of sensors.
    pub fn sensors(&self) -> usize {
        self.sensors.len()
    }

    /// Cells hit by any sensor.
    pub fn union(&self) -> Vec<u64> {
        let words = self.grid.len().div_ceil(64);
        (0..words).map(|word| self.sensors.iter().fold(0, |all, bits| all | bits[word])).collect()
    }

    /// Number of cells hit by any sensor.
    pub fn union_count(&self) -> u64 {
        self.union().iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// How many cells are hit by any, by several, by each and by each alone.
    pub fn counts(&self) -> Counts {
        let bitmaps: Vec<_> = self.sensors.iter().map(Vec::as_slice).collect();
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
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
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
    pub fn of_bitmaps(sensors: &[&[u64]]) -> Self {
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
