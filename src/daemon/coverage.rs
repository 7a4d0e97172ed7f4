//! Seen cells so far, with the predicted coverage.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use glam::DVec3;

use super::picture;
use super::status::CoverageStatus;
use crate::recording::export::foxglove::Voxels;
use crate::world::coverage::Coverage;

/// Cells sent to a page at most; more are merged by eights.
const MAX_CELLS: usize = 40_000;

/// How a cell is drawn.
const MISSING: u8 = 0;
const CONFIRMED: u8 = 1;
const SEEN: u8 = 2;

/// Cells of a Foxglove grid at most, 5 bytes each; more are merged by eights.
const MAX_VOXELS: usize = 1 << 19;
/// Of each state: 1 more than on the page (0 is empty), then red, green, blue and opacity.
const COLOURS: [[u8; 5]; 3] = [[1, 214, 69, 65, 110], [2, 46, 160, 67, 200], [3, 56, 132, 222, 200]];

/// Coverage that live threads add to.
#[derive(Debug)]
pub(super) struct LiveCoverage {
    inner: Mutex<Inner>,
    pose: &'static str,
}

#[derive(Debug)]
struct Inner {
    seen: Coverage,
    /// Cells of the prediction, ascending.
    predicted: Option<Vec<usize>>,
    predicting: bool,
    without_pose: u64,
    last_point: Option<Instant>,
    /// Grows with every addition.
    version: u64,
    /// Of the last counting.
    counted: (u64, CoverageStatus),
}

impl LiveCoverage {
    /// Nothing seen yet.
    pub(crate) fn new(seen: Coverage, pose: &'static str, predicting: bool) -> Self {
        let counted = (u64::MAX, CoverageStatus::default());
        let inner = Inner {
            seen,
            predicted: None,
            predicting,
            without_pose: 0,
            last_point: None,
            version: 0,
            counted,
        };
        Self { inner: Mutex::new(inner), pose }
    }

    /// The prediction is ready.
    pub(crate) fn set_predicted(&self, predicted: Option<&Coverage>) {
        let cells = predicted.map(Coverage::union_cells);
        let mut inner = self.lock();
        inner.predicted = cells;
        inner.predicting = false;
        inner.version += 1;
    }

    /// A sensor saw these points, world, m; so many more had no pose.
    pub(crate) fn add(&self, sensor: usize, points_m: &[DVec3], without_pose: u64) {
        let mut inner = self.lock();
        points_m.iter().for_each(|point_m| inner.seen.add(sensor, *point_m));
        inner.without_pose += without_pose;
        if !points_m.is_empty() || without_pose > 0 {
            inner.last_point = Some(Instant::now());
        }
        inner.version += 1;
    }

    /// Starts again.
    pub(crate) fn clear(&self) {
        let mut inner = self.lock();
        inner.seen = Coverage::new(inner.seen.grid().clone(), inner.seen.sensors());
        (inner.without_pose, inner.last_point) = (0, None);
        inner.version += 1;
    }

    /// Memory of the cells, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let inner = self.lock();
        inner.seen.bytes() + inner.predicted.as_ref().map_or(0, |cells| std::mem::size_of_val(&cells[..]))
    }

    /// Assumed pose of the platform.
    pub(crate) fn pose(&self) -> &'static str {
        self.pose
    }

    /// Grows when there is something new to draw.
    pub(crate) fn version(&self) -> u64 {
        self.lock().version
    }

    /// In numbers.
    pub(crate) fn status(&self) -> CoverageStatus {
        let mut inner = self.lock();
        if inner.counted.0 != inner.version {
            let union = inner.seen.union();
            let is_seen = |cell: &&usize| union[**cell / 64] >> (**cell % 64) & 1 == 1;
            let confirmed = inner.predicted.as_ref().map(|cells| cells.iter().filter(is_seen).count() as u64);
            let status = CoverageStatus {
                voxel_m: inner.seen.grid().voxel_m,
                seen: union.iter().map(|word| u64::from(word.count_ones())).sum(),
                predicted: inner.predicted.as_ref().map(|cells| cells.len() as u64),
                seen_of_predicted: confirmed,
                last_point_age_s: None,
                outside: inner.seen.outside(),
                pose: self.pose,
                without_pose: inner.without_pose,
                about: about_pose(self.pose, inner.without_pose),
                predicting: inner.predicting,
            };
            inner.counted = (inner.version, status);
        }
        let last_point_age_s = inner.last_point.map(|last| last.elapsed().as_secs_f64());
        CoverageStatus { last_point_age_s, ..inner.counted.1.clone() }
    }

    /// As the page draws it.
    pub(crate) fn message(&self, time_ns: u64) -> Vec<u8> {
        let (origin_m, edge_m, cells) = self.merged(|cells| cells.len() <= MAX_CELLS);
        let mut cells: Vec<_> = cells.into_iter().take(MAX_CELLS).collect();
        cells.sort_unstable();
        picture::cells(time_ns, origin_m, edge_m, &cells)
    }

    /// As Foxglove draws it: the block of cells around all that was seen or predicted.
    pub(crate) fn voxels(&self) -> Voxels {
        let (origin_m, edge_m, cells) = self.merged(|cells| {
            let [low, high] = bounds(cells);
            (0..3).map(|axis| usize::from(high[axis] - low[axis]) + 1).product::<usize>() <= MAX_VOXELS
        });
        if cells.is_empty() {
            return Voxels { origin_m, edge_m, ..Voxels::default() };
        }
        let [low, high] = bounds(&cells);
        let counts = [0, 1, 2].map(|axis| usize::from(high[axis] - low[axis]) + 1);
        let mut values = vec![[0; 5]; counts.iter().product()];
        for (place, state) in cells {
            let [x, y, z] = [0, 1, 2].map(|axis| usize::from(place[axis] - low[axis]));
            // a block of 2^16 cells along an axis is cut where it ends
            if let Some(value) = values.get_mut((z * counts[1] + y) * counts[0] + x) {
                *value = COLOURS[usize::from(state)];
            }
        }
        let origin_m = origin_m + edge_m * DVec3::from_array(low.map(f64::from));
        Voxels { origin_m, edge_m, cells: counts, values }
    }

    /// Cells with how they are drawn, merged by eights until they fit: least corner of the grid, edge, places.
    fn merged(&self, fits: impl Fn(&HashMap<[u16; 3], u8>) -> bool) -> (DVec3, f64, HashMap<[u16; 3], u8>) {
        let (grid, seen, predicted) = {
            let inner = self.lock();
            (inner.seen.grid().clone(), inner.seen.union_cells(), inner.predicted.clone())
        };
        let mut merge = 1;
        loop {
            let place = |cell: usize| grid.place(cell).map(|at| (at / merge) as u16);
            let mut cells: HashMap<[u16; 3], u8> = HashMap::new();
            let missing = predicted.iter().flatten().map(|cell| (place(*cell), MISSING));
            cells.extend(missing);
            for cell in &seen {
                let state = cells.entry(place(*cell)).or_insert(SEEN);
                *state = if *state == MISSING { CONFIRMED } else { *state };
            }
            if fits(&cells) || merge >= 64 {
                return (grid.origin_m, grid.voxel_m * merge as f64, cells);
            }
            merge *= 2;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What is known of where the platform is, and what that means for coverage.
fn about_pose(pose: &str, without_pose: u64) -> String {
    let known = if pose == "standing" {
        "No trajectory is given, so the platform's place is not known: it is assumed at the origin, and coverage is \
         right only while it does."
    } else {
        "The platform follows the given trajectory."
    };
    match without_pose {
        0 => known.into(),
        count => format!(
            "{known} {count} points came at times that the trajectory does not cover: they are not counted here."
        ),
    }
}

/// Min and max corner; the first cell where there is none.
fn bounds(cells: &HashMap<[u16; 3], u8>) -> [[u16; 3]; 2] {
    let mut bounds = cells.keys().next().map_or([[0; 3]; 2], |first| [*first; 2]);
    for place in cells.keys() {
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(place[axis]);
            bounds[1][axis] = bounds[1][axis].max(place[axis]);
        }
    }
    bounds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::coverage::VoxelGrid;

    #[test]
    fn cells_are_missing_confirmed_or_merely_seen() {
        let grid = VoxelGrid { origin_m: DVec3::ZERO, voxel_m: 0.5, cells: [8, 4, 2] };
        let live = LiveCoverage::new(Coverage::new(grid.clone(), 2), "standing", true);
        assert!(live.status().predicting && live.status().predicted.is_none());
        let mut predicted = Coverage::new(grid, 1);
        for at in [[0.1, 0.1, 0.1], [1.1, 0.1, 0.1]] {
            predicted.add(0, DVec3::from(at));
        }
        live.set_predicted(Some(&predicted));
        live.add(1, &[DVec3::splat(0.2), DVec3::new(2.1, 1.1, 0.6), DVec3::splat(99.0)], 3);
        assert!(live.status().about.contains("3 points"), "{}", live.status().about);
        assert!(live.status().about.contains("not known"));
        let CoverageStatus { seen, predicted, seen_of_predicted, outside, without_pose, .. } = live.status();
        assert_eq!((seen, predicted, seen_of_predicted, outside, without_pose), (2, Some(2), Some(1), 1, 3));
        let message = live.message(7);
        let cells: Vec<_> =
            message[picture::HEADER_BYTES..].chunks(8).map(|cell| (cell[0], cell[6])).collect();
        assert_eq!(cells, [(0, CONFIRMED), (2, MISSING), (4, SEEN)]);
        let before = live.version();
        live.clear();
        assert!(live.version() > before);
        assert_eq!((live.status().seen, live.status().predicted), (0, Some(2)));
    }

    #[test]
    fn a_block_of_voxels_holds_every_cell() {
        let grid = VoxelGrid { origin_m: DVec3::new(-1.0, 0.0, 2.0), voxel_m: 0.5, cells: [8, 4, 2] };
        let live = LiveCoverage::new(Coverage::new(grid.clone(), 1), "standing", false);
        assert_eq!(live.voxels().cells, [0; 3]);
        let mut predicted = Coverage::new(grid, 1);
        predicted.add(0, DVec3::new(0.1, 0.6, 2.1));
        live.set_predicted(Some(&predicted));
        live.add(0, &[DVec3::new(1.1, 1.1, 2.6)], 0);
        let voxels = live.voxels();
        assert_eq!(
            (voxels.origin_m, voxels.edge_m, voxels.cells),
            (DVec3::new(0.0, 0.5, 2.0), 0.5, [3, 2, 2])
        );
        let states: Vec<u8> = voxels.values.iter().map(|value| value[0]).collect();
        assert_eq!(states, [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3]);
    }

    #[test]
    fn many_cells_are_merged() {
        let grid = VoxelGrid { origin_m: DVec3::ZERO, voxel_m: 1.0, cells: [100, 100, 10] };
        let live = LiveCoverage::new(Coverage::new(grid.clone(), 1), "standing", false);
        let all: Vec<DVec3> = (0..grid.len()).map(|cell| grid.centre_m(cell)).collect();
        live.add(0, &all, 0);
        let message = live.message(0);
        assert_eq!((message.len() - picture::HEADER_BYTES) / 8, 50 * 50 * 5);
        assert_eq!(f32::from_le_bytes(message[28..32].try_into().unwrap()), 2.0);
    }
}
