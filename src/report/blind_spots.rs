//! Groups of neighbouring unseen cells.

use std::collections::BTreeSet;

use glam::DVec3;

use crate::base::numbers::counted;
use crate::report::chart::number;
use crate::world::coverage::VoxelGrid;
use crate::world::local_origin::LocalOrigin;

/// Neighbouring cells that could be seen and are not.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct BlindSpot {
    /// Number of cells.
    pub cells: usize,
    /// Their mean centre, m, in the axes of the grid.
    pub centre_m: [f64; 3],
    /// Extent along the axes, m.
    pub extent_m: [f64; 3],
}

impl BlindSpot {
    /// Its size and place.
    pub(crate) fn words(&self) -> String {
        let metres = |values: [f64; 3], digits| values.map(|value| number(value, digits)).join(", ");
        format!(
            "{} around ({}) m, {} m",
            counted(self.cells as u64, "voxel"),
            metres(self.centre_m, 1),
            metres(self.extent_m, 1).replace(", ", " × ")
        )
    }

    /// The same group in the frame of the files.
    pub(crate) fn in_world(mut self, origin: LocalOrigin) -> Self {
        self.centre_m = origin.world(self.centre_m.into()).to_array();
        self
    }
}

/// The largest groups of cells that share a face, an edge or a corner; at most `most` of them, the largest first.
pub(crate) fn blind_spots(
    grid: &VoxelGrid,
    unseen: impl Iterator<Item = usize>,
    most: usize,
) -> Vec<BlindSpot> {
    let mut left: BTreeSet<usize> = unseen.collect();
    let mut spots = Vec::new();
    while let Some(first) = left.pop_first() {
        let mut open = vec![first];
        let (mut cells, mut sum_m) = (0, DVec3::ZERO);
        let (mut low_m, mut high_m) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        while let Some(cell) = open.pop() {
            let centre_m = grid.centre_m(cell);
            cells += 1;
            sum_m += centre_m;
            (low_m, high_m) = (low_m.min(centre_m), high_m.max(centre_m));
            open.extend(neighbours(grid, cell).filter(|near| left.remove(near)));
        }
        let extent_m = (high_m - low_m + grid.voxel_m).to_array();
        spots.push(BlindSpot { cells, centre_m: (sum_m / cells as f64).to_array(), extent_m });
    }
    // a stable sort: groups of one size stay in the order of their first cells
    spots.sort_by_key(|spot| std::cmp::Reverse(spot.cells));
    spots.truncate(most);
    spots
}

fn neighbours(grid: &VoxelGrid, cell: usize) -> impl Iterator<Item = usize> {
    let place = grid.place(cell);
    let [nx, ny, nz] = grid.cells;
    let around = move |axis: usize, count: usize| place[axis].saturating_sub(1)..(place[axis] + 2).min(count);
    let (xs, ys, zs) = (around(0, nx), around(1, ny), around(2, nz));
    zs.flat_map(move |k| {
        let xs = xs.clone();
        ys.clone().flat_map(move |j| xs.clone().map(move |i| i + nx * (j + ny * k)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_join_and_gaps_part() {
        let grid = VoxelGrid { origin_m: DVec3::new(-1.0, 0.0, 0.0), voxel_m: 0.5, cells: [10, 5, 4] };
        let at = |i: usize, j: usize, k: usize| i + 10 * (j + 5 * k);
        let unseen = [at(0, 0, 0), at(1, 1, 1), at(2, 1, 1), at(5, 0, 0), at(9, 4, 3), at(9, 4, 2)];
        let spots = blind_spots(&grid, unseen.into_iter(), 2);
        assert_eq!(spots.iter().map(|spot| spot.cells).collect::<Vec<_>>(), [3, 2]);
        assert_eq!(spots[0].extent_m, [1.5, 1.0, 1.0]);
        assert_eq!(spots[1].centre_m, [3.75, 2.25, 1.5]);
        assert!(blind_spots(&grid, std::iter::empty(), 3).is_empty());
    }
}
