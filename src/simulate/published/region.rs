//! What all mounts of a region could see between them, and what each of them sees: the two bitmaps that bound every
//! score in the region.
//!
//! Interval arithmetic (Moore, Kearfott, Cloud 2009, doi:10.1137/1.9780898717716) along each ray: an interval for each
//! component of direction and origin, one for the distance to each wall that may be reached first, one for each
//! coordinate of the hit. The intervals are widened by more than rounding can move a hit.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{PublishedBox, brute};
use crate::rig::MountRegion;

/// Of a hit, m: above what rounding in the simulator can do, far below a voxel.
const ROUNDING_M: f64 = 1e-9;
/// Of a component of a direction.
const ROUNDING: f64 = 1e-14;

/// Minimum and maximum.
type Interval = [f64; 2];

/// Bitmaps over the simulator's grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Every voxel that some mount of the region sees, and perhaps more.
    pub possible: Vec<u64>,
    /// Voxels that every mount of the region sees, perhaps not all of them.
    pub certain: Vec<u64>,
}

/// What the rays of one beam may hit from one pose.
#[derive(Clone, Copy, Default)]
struct Hits {
    walls: u8,
    /// The only cell, where there is one.
    cell: Option<usize>,
}

/// The mounts of a region in a simulator's box.
struct Caster<'a> {
    simulator: &'a PublishedBox,
    /// In the box, but for the walk.
    mount_m: [Interval; 3],
    /// No ray through the box is longer, and directions have length 1.
    longest_m: f64,
}

impl PublishedBox {
    /// What the mounts of a region see. Each must be a mount that [`PublishedBox::cover`] takes.
    pub(crate) fn reach(&self, region: &MountRegion) -> Reach {
        let words = self.cells.iter().product::<usize>().div_ceil(64);
        let mut reach = Reach { possible: vec![0; words], certain: vec![0; words] };
        let [x_m, y_m, z_m, pitch_deg, roll_deg] = region.intervals();
        let preset = &self.experiment.preset;
        let edges_m = (0..3).map(|axis| preset.box_max_m[axis] - preset.box_min_m[axis]);
        let caster = Caster {
            simulator: self,
            mount_m: [x_m, y_m, shifted(z_m, preset.platform_height_m)],
            longest_m: edges_m.map(|edge_m| edge_m * edge_m).sum::<f64>().sqrt() + ROUNDING_M,
        };
        let tilt = Tilt::new(pitch_deg, roll_deg);
        let poses: Vec<usize> = (0..self.stations_m.len()).collect();
        // poses that share a pattern share its directions
        for alike in poses.chunk_by(|a, b| self.turn(*a) == self.turn(*b)) {
            let stations_m = &self.stations_m[alike[0]..alike[0] + alike.len()];
            for azimuth in 0..self.experiment.azimuths {
                let (sin, cos) = brute::azimuth_rad(self, self.turn(alike[0]), azimuth).sin_cos();
                for &[sin_elevation, cos_elevation] in &self.elevations {
                    let local = [cos_elevation * cos, cos_elevation * sin, sin_elevation];
                    caster.cast(tilt.of(local), stations_m, &mut reach);
                }
            }
        }
        reach
    }
}

impl Caster<'_> {
    fn cast(&self, direction: [Interval; 3], stations_m: &[f64], reach: &mut Reach) {
        let loses = self.simulator.loses();
        if loses && direction.contains(&[0.0, 0.0]) {
            return;
        }
        let may_be_lost = loses && direction.iter().any(|d| d[0] <= 0.0 && d[1] >= 0.0);
        let direction = direction.map(|d| widened(d, ROUNDING));
        let mut hits = vec![Hits::default(); stations_m.len()];
        for axis in 0..3 {
            for is_high in [true, false] {
                self.meet(&direction, (axis, is_high), stations_m, &mut hits, reach);
            }
        }
        for hit in hits {
            if let (1, Some(cell), false) = (hit.walls, hit.cell, may_be_lost) {
                reach.certain[cell / 64] |= 1 << (cell % 64);
            }
        }
    }

    /// The part of a beam that leaves the box through one wall.
    fn meet(
        &self,
        direction: &[Interval; 3],
        wall: (usize, bool),
        stations_m: &[f64],
        hits: &mut [Hits],
        reach: &mut Reach,
    ) {
        let (axis, is_high) = wall;
        let along = self.simulator.experiment.path.axis();
        let others = [(axis + 1) % 3, (axis + 2) % 3];
        let mut cells = [[if is_high { self.simulator.cells[axis] - 1 } else { 0 }; 2]; 3];
        let mut origin_m = self.mount_m;
        // a wall along the walk is as far from every pose
        let steady = if axis == along {
            None
        } else {
            let Some(distance_m) = self.distance_m(direction, wall, &origin_m) else { return };
            let third = 3 - axis - along;
            let Some(found) = self.cells(third, direction, distance_m, &origin_m) else { return };
            cells[third] = found;
            Some(distance_m)
        };
        for (station_m, hit) in stations_m.iter().zip(hits) {
            origin_m[along] = shifted(self.mount_m[along], *station_m);
            let Some(distance_m) = steady.or_else(|| self.distance_m(direction, wall, &origin_m)) else {
                continue;
            };
            let mut is_met = true;
            for other in others.into_iter().filter(|other| steady.is_none() || *other == along) {
                match self.cells(other, direction, distance_m, &origin_m) {
                    Some(found) => cells[other] = found,
                    None => is_met = false,
                }
            }
            if is_met {
                hit.walls += 1;
                hit.cell = self.mark(&cells, reach);
            }
        }
    }

    /// How far a wall is along the directions that lead to it; none where none does.
    fn distance_m(
        &self,
        direction: &[Interval; 3],
        (axis, is_high): (usize, bool),
        origin_m: &[Interval; 3],
    ) -> Option<Interval> {
        let preset = &self.simulator.experiment.preset;
        let ([low, high], [first_m, last_m]) = (direction[axis], origin_m[axis]);
        let (speed, gap_m) = if is_high {
            ([low.max(0.0), high], [preset.box_max_m[axis] - last_m, preset.box_max_m[axis] - first_m])
        } else {
            ([(-high).max(0.0), -low], [first_m - preset.box_min_m[axis], last_m - preset.box_min_m[axis]])
        };
        let nearest_m = gap_m[0] / speed[1];
        let farthest_m = (gap_m[1] / speed[0]).min(self.longest_m);
        (speed[1] > 0.0 && nearest_m <= self.longest_m).then_some([nearest_m, farthest_m])
    }

    /// First and last cell along an axis that lies in the wall; none where the hits miss the wall.
    fn cells(
        &self,
        axis: usize,
        direction: &[Interval; 3],
        distance_m: Interval,
        origin_m: &[Interval; 3],
    ) -> Option<[usize; 2]> {
        let preset = &self.simulator.experiment.preset;
        let [low, high] = direction[axis];
        let from_m = if low < 0.0 { low * distance_m[1] } else { low * distance_m[0] };
        let to_m = if high < 0.0 { high * distance_m[0] } else { high * distance_m[1] };
        let [from_m, to_m] = widened(plus(origin_m[axis], [from_m, to_m]), ROUNDING_M);
        (from_m <= preset.box_max_m[axis] && to_m >= preset.box_min_m[axis])
            .then(|| [from_m, to_m].map(|at_m| brute::cell(self.simulator, axis, at_m)))
    }

    /// Marks cells as possible; the cell, where it is one.
    fn mark(&self, cells: &[[usize; 2]; 3], reach: &mut Reach) -> Option<usize> {
        let [nx, ny, _] = self.simulator.cells;
        let [[x0, x1], [y0, y1], [z0, z1]] = *cells;
        for z in z0..=z1 {
            for y in y0..=y1 {
                for x in x0..=x1 {
                    let cell = x + nx * (y + ny * z);
                    reach.possible[cell / 64] |= 1 << (cell % 64);
                }
            }
        }
        cells.iter().all(|[from, to]| from == to).then(|| x0 + nx * (y0 + ny * z0))
    }
}

/// `Rx(roll) Ry(pitch)` over intervals.
struct Tilt {
    pitch_rad: Interval,
    sin_roll: Interval,
    cos_roll: Interval,
}

impl Tilt {
    fn new(pitch_deg: Interval, roll_deg: Interval) -> Self {
        let roll_rad = roll_deg.map(f64::to_radians);
        let (sin_roll, cos_roll) = if roll_deg == [0.0, 0.0] {
            ([0.0, 0.0], [1.0, 1.0])
        } else {
            (cosine(roll_rad.map(|roll| roll - FRAC_PI_2)), cosine(roll_rad))
        };
        Self { pitch_rad: pitch_deg.map(f64::to_radians), sin_roll, cos_roll }
    }

    /// A beam's directions. Pitch turns it in the plane of x and z: both are cosines of one angle.
    fn of(&self, local: [f64; 3]) -> [Interval; 3] {
        let (length, phase) = (local[0].hypot(local[2]), local[2].atan2(local[0]));
        let scaled = |[low, high]: Interval| [length * low, length * high];
        let x = scaled(cosine(self.pitch_rad.map(|pitch| pitch - phase)));
        let z = scaled(cosine(self.pitch_rad.map(|pitch| pitch + FRAC_PI_2 - phase)));
        let y = [local[1]; 2];
        let [down, up] = times(self.sin_roll, z);
        [
            x,
            plus(times(self.cos_roll, y), [-up, -down]),
            plus(times(self.sin_roll, y), times(self.cos_roll, z)),
        ]
    }
}

/// Of an interval of angles, rad.
fn cosine([from, to]: Interval) -> Interval {
    let holds = |angle: f64| ((from - angle) / TAU).ceil() * TAU + angle <= to;
    let (first, last) = (from.cos(), to.cos());
    [if holds(PI) { -1.0 } else { first.min(last) }, if holds(0.0) { 1.0 } else { first.max(last) }]
}

fn times(a: Interval, b: Interval) -> Interval {
    let all = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    [all.into_iter().fold(f64::INFINITY, f64::min), all.into_iter().fold(f64::NEG_INFINITY, f64::max)]
}

fn plus(a: Interval, b: Interval) -> Interval {
    [a[0] + b[0], a[1] + b[1]]
}

fn shifted([low, high]: Interval, by: f64) -> Interval {
    [low + by, high + by]
}

fn widened([low, high]: Interval, by: f64) -> Interval {
    [low - by, high + by]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::rig::{Path, Phase, Roll};
    use crate::simulate::published::{Experiment, PRESETS};

    fn is_within(inner: &[u64], outer: &[u64]) -> bool {
        inner.iter().zip(outer).all(|(a, b)| a & !b == 0)
    }

    fn count(bitmap: &[u64]) -> u32 {
        bitmap.iter().map(|word| word.count_ones()).sum()
    }

    /// Every mount of a region sees what is certain and nothing but what is possible.
    #[test]
    fn regions_hold_what_their_mounts_see() {
        let mut rng = Rng::new(5, 0);
        for (path, phase, roll) in [
            (Path::Lateral, Phase::Locked, Roll::Fixed(0.0)),
            (Path::Forward, Phase::Locked, Roll::Fixed(0.0)),
            (Path::Forward, Phase::Locked, Roll::Free),
            (Path::Lateral, Phase::Free, Roll::Fixed(0.0)),
        ] {
            let experiment =
                Experiment { path, phase, roll, azimuths: 60, ..Experiment::published(&PRESETS[1]) };
            let simulator = PublishedBox::new(&experiment).unwrap();
            for size in [0.0, 0.02] {
                let ranges = [(-0.1, 0.15), (-0.25, 0.25), (-0.15, 0.15), (-90.0, 90.0), (-60.0, 60.0)];
                let low = ranges.map(|(low, high)| rng.between(low, high - size * (high - low)));
                let mut high: [f64; 5] =
                    std::array::from_fn(|at| low[at] + size * (ranges[at].1 - ranges[at].0));
                let mut low = low;
                if roll != Roll::Free {
                    (low[4], high[4]) = (0.0, 0.0);
                }
                let region = MountRegion { low: low.into(), high: high.into() };
                let region = if roll == Roll::Free { region.mirrored() } else { region };
                let reach = simulator.reach(&region);
                assert!(is_within(&reach.certain, &reach.possible));
                let [low, high] = [region.low, region.high].map(<[f64; 5]>::from);
                for _ in 0..3 {
                    let inside: [f64; 5] = std::array::from_fn(|at| rng.between(low[at], high[at]));
                    let seen = simulator.cover(&[inside.into()]).unwrap().coverage.union();
                    assert!(is_within(&seen, &reach.possible), "{path:?} {size}: {inside:?}");
                    assert!(is_within(&reach.certain, &seen), "{path:?} {size}: {inside:?}");
                }
                if size == 0.0 {
                    let doubt = count(&reach.possible) - count(&reach.certain);
                    assert!(doubt < 200, "{path:?}: {doubt} cells in doubt at a point");
                }
            }
        }
    }

    #[test]
    fn the_mirror_image_of_a_region_is_that_of_its_mounts() {
        let region = MountRegion {
            low: [0.0, -0.1, 0.0, -10.0, -5.0].into(),
            high: [0.1, 0.2, 0.1, 30.0, 5.0].into(),
        };
        let image = MountRegion {
            low: [-0.1, -0.1, 0.0, -30.0, -5.0].into(),
            high: [-0.0, 0.2, 0.1, 10.0, 5.0].into(),
        };
        assert_eq!(region.mirrored(), image);
    }
}
