//! Consecutive numbers for those voxels of a grid that are seen at all.

/// The voxels seen, in the order of the grid.
pub(super) struct Numbering {
    seen: Vec<u64>,
    /// Voxels seen before each word.
    before: Vec<u32>,
    count: usize,
}

impl Numbering {
    /// Of these voxels of a grid of so many.
    pub(crate) fn new(cells: usize, seen_cells: impl Iterator<Item = u32>) -> Self {
        let mut seen = vec![0_u64; cells.div_ceil(64)];
        seen_cells.for_each(|cell| seen[cell as usize / 64] |= 1 << (cell % 64));
        let mut count = 0;
        let mut before = Vec::with_capacity(seen.len());
        for word in &seen {
            before.push(count);
            count += word.count_ones();
        }
        Self { seen, before, count: count as usize }
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The voxels that are seen, by number.
    pub(crate) fn cells(&self) -> Vec<u32> {
        let is_seen = |cell: &u32| self.seen[*cell as usize / 64] >> (cell % 64) & 1 != 0;
        (0..64 * self.seen.len() as u32).filter(is_seen).collect()
    }

    /// The number of a voxel that is seen.
    pub(crate) fn of(&self, cell: u32) -> u32 {
        let word = cell as usize / 64;
        self.before[word] + (self.seen[word] & ((1 << (cell % 64)) - 1)).count_ones()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_are_numbered_in_the_order_of_the_grid() {
        let cells = [130, 3, 64, 63, 3, 130, 199];
        let numbering = Numbering::new(200, cells.into_iter());
        assert_eq!(numbering.count(), 5);
        assert_eq!(numbering.cells(), [3, 63, 64, 130, 199]);
        assert_eq!([3, 63, 64, 130, 199].map(|cell| numbering.of(cell)), [0, 1, 2, 3, 4]);
    }
}
