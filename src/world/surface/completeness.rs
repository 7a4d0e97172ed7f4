//! Which sample points have a hit within each threshold.

use std::sync::atomic::{AtomicU8, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::SurfaceSamples;
use super::level::{Done, DoneCells, Level, for_cubes_near};
use crate::world::scene::bricks::{EDGE, LastRegion, cell_of};

/// The usual thresholds, m.
pub const THRESHOLDS_M: [f64; 3] = [0.02, 0.05, 0.10];

/// Points found so far. Hits may come from any number of threads in any order: the outcome is the same.
#[derive(Debug)]
pub struct Completeness {
    thresholds_m: Vec<f64>,
    /// Number of each point as given, in the order in which they are stored here.
    order: Vec<u32>,
    points_m: Vec<DVec3>,
    /// Smallest threshold with a hit, by point; the number of thresholds when there is none.
    reached: Vec<AtomicU8>,
    /// Cells of the gate per metre.
    per_m: f64,
    /// Fine cells from which no threshold has anything left to find: most hits end here.
    gate: DoneCells,
    levels: Vec<Level>,
    /// A cell of the gate's coordinates shifted right by this are those of the level's cell around it.
    shifts: Vec<u32>,
}

/// What one thread remembers between hits.
#[derive(Clone, Debug, Default)]
pub struct Adder {
    at_gate: LastRegion,
    at_levels: Vec<LastRegion>,
}

impl Completeness {
    /// Nothing found yet. Thresholds (m, above 0) ascend.
    pub fn new(samples: &SurfaceSamples, thresholds_m: &[f64]) -> Self {
        assert!(!thresholds_m.is_empty() && thresholds_m.len() < 255, "ranks of thresholds fit a byte");
        assert!(thresholds_m[0] > 0.0 && thresholds_m.is_sorted(), "thresholds ascend from above 0");
        let none = thresholds_m.len() as u8;
        let order = samples.order();
        let points_m: Vec<DVec3> = order.iter().map(|index| samples.points_m[*index as usize]).collect();
        // cells of half a threshold keep most hits that can find nothing out; powers of two nest
        let fine_m = 0.5 * thresholds_m[0];
        let shift =
            |threshold_m: &f64| (threshold_m / thresholds_m[0]).log2().floor().clamp(0.0, 24.0) as u32;
        let shifts: Vec<u32> = thresholds_m.iter().map(shift).collect();
        let wanted: Vec<(f64, u32)> = thresholds_m.iter().copied().zip(shifts.iter().copied()).collect();
        let level = |(threshold_m, shift): &(f64, u32)| {
            Level::new(*threshold_m, fine_m * f64::from(1_u32 << shift), &points_m)
        };
        let (levels, gate) = rayon::join(
            || wanted.par_iter().map(level).collect(),
            || gate(&points_m, thresholds_m[0], fine_m),
        );
        Self {
            thresholds_m: thresholds_m.to_vec(),
            reached: (0..order.len()).map(|_| AtomicU8::new(none)).collect(),
            per_m: 1.0 / fine_m,
            gate,
            levels,
            shifts,
            order,
            points_m,
        }
    }

    /// A memory for one thread's hits.
    pub(crate) fn adder(&self) -> Adder {
        Adder { at_gate: LastRegion::default(), at_levels: vec![LastRegion::default(); self.levels.len()] }
    }

    /// Counts a hit.
    #[inline]
    pub(crate) fn add(&self, adder: &mut Adder, hit_m: DVec3) {
        let cell = cell_of(hit_m, self.per_m);
        let gate = self.gate.find(cell, &mut adder.at_gate);
        if gate.is_some_and(|place| self.gate.done(place) != Done::Nothing) {
            return;
        }
        let mut done = Done::Brick;
        for rank in 0..self.levels.len() {
            done = done.min(self.search(rank, cell, hit_m, &mut adder.at_levels[rank]));
        }
        if let Some(place) = gate {
            // the gate's cell lies in one cell of every level, its brick in one brick
            self.gate.close(place, done);
        }
    }

    /// Looks for points of one threshold; what is left to find around the hit.
    fn search(&self, rank: usize, fine_cell: [i32; 3], hit_m: DVec3, last: &mut LastRegion) -> Done {
        let level = &self.levels[rank];
        let cell = fine_cell.map(|value| value >> self.shifts[rank]);
        let Some(place) = level.cells().find(cell, last) else { return Done::Brick };
        let before = level.cells().done(place);
        if before != Done::Nothing {
            return before;
        }
        let limit = self.thresholds_m[rank] * self.thresholds_m[rank];
        let mut done = Done::Brick;
        for &point in level.near(place) {
            let reached = &self.reached[point as usize];
            if (reached.load(Ordering::Relaxed) as usize) <= rank {
                continue;
            }
            let point_m = self.points_m[point as usize];
            if point_m.distance_squared(hit_m) <= limit {
                reached.fetch_min(rank as u8, Ordering::Relaxed);
            } else if done != Done::Nothing {
                done = if level.reaches(cell, point_m) { Done::Nothing } else { Done::Cell };
            }
        }
        level.cells().close(place, done);
        done
    }

    /// Drops what was found from the search: later hits are faster. Changes no outcome.
    pub(crate) fn settle(&mut self) {
        let (reached, points_m) = (&self.reached, &self.points_m);
        self.levels.par_iter_mut().enumerate().for_each(|(rank, level)| {
            let open = |point: &u32| reached[*point as usize].load(Ordering::Relaxed) as usize > rank;
            let missing: Vec<u32> = (0..points_m.len() as u32).filter(open).collect();
            level.list(points_m, &missing);
        });
    }

    /// Whether each point has a hit within a threshold, by rank.
    pub fn covered(&self, rank: usize) -> Vec<bool> {
        let mut covered = vec![false; self.order.len()];
        for (index, reached) in self.order.iter().zip(&self.reached) {
            covered[*index as usize] = reached.load(Ordering::Relaxed) as usize <= rank;
        }
        covered
    }

    /// Share of all points with a hit within each threshold.
    pub fn shares(&self) -> Vec<f64> {
        let count = |rank| self.covered(rank).iter().filter(|covered| **covered).count();
        (0..self.thresholds_m.len()).map(|rank| count(rank) as f64 / self.order.len() as f64).collect()
    }

    /// Share of the observable points with a hit within a threshold, by rank; none when nothing is observable.
    pub(crate) fn share_of(&self, observable: &[bool], rank: usize) -> Option<f64> {
        let covered = self.covered(rank);
        let both = covered.iter().zip(observable).filter(|(covered, seen)| **covered && **seen).count();
        let all = observable.iter().filter(|seen| **seen).count();
        (all > 0).then(|| both as f64 / all as f64)
    }
}

/// Room for the cells around the points, where hits are likely.
fn gate(points_m: &[DVec3], reach_m: f64, fine_m: f64) -> DoneCells {
    let mut cells = DoneCells::default();
    let mut last = LastRegion::default();
    for point_m in points_m {
        for_cubes_near(*point_m, reach_m, f64::from(EDGE) * fine_m, |brick| {
            cells.add(brick, &mut last);
        });
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    fn cloud(count: usize, seed: u64) -> Vec<DVec3> {
        let mut rng = Rng::new(seed, 0);
        // two crossing sheets with a little thickness, below and above zero
        let mut point = |n: usize| {
            let (u, v) = (rng.between(-0.6, 0.6), rng.between(-0.6, 0.6));
            let w = rng.between(-0.01, 0.01);
            if n.is_multiple_of(2) { DVec3::new(u, v, w) } else { DVec3::new(w, u, v) }
        };
        (0..count).map(&mut point).collect()
    }

    #[test]
    fn agrees_with_comparing_every_pair() {
        let samples = SurfaceSamples::new(cloud(3000, 1)).unwrap();
        let hits = cloud(100, 2);
        let mut completeness = Completeness::new(&samples, &THRESHOLDS_M);
        for part in hits.chunks(25) {
            part.par_iter()
                .for_each_init(|| completeness.adder(), |adder, hit| completeness.add(adder, *hit));
            completeness.settle();
        }
        for (rank, threshold_m) in THRESHOLDS_M.into_iter().enumerate() {
            let near = |point: &DVec3| {
                hits.iter().any(|hit| hit.distance_squared(*point) <= threshold_m * threshold_m)
            };
            let expected: Vec<bool> = samples.points_m().iter().map(near).collect();
            assert_eq!(completeness.covered(rank), expected);
            let share = expected.iter().filter(|c| **c).count() as f64 / 3000.0;
            assert_eq!(completeness.shares()[rank], share);
            assert!(share > 0.01 && share < 0.99, "the case tells nothing: {share}");
        }
    }

    #[test]
    fn a_hit_exactly_at_the_threshold_counts() {
        let samples = SurfaceSamples::new(vec![DVec3::ZERO, DVec3::new(0.5, 0.0, 0.0)]).unwrap();
        let completeness = Completeness::new(&samples, &[0.25]);
        completeness.add(&mut completeness.adder(), DVec3::new(0.25, 0.0, 0.0));
        assert_eq!(completeness.covered(0), [true, true]);
        assert_eq!(completeness.share_of(&[false, false], 0), None);
    }
}
