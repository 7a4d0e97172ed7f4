//! A map of cells that are occupied, free or unknown, built from recorded rays: what the recording itself can say about
//! a place without a mesh.
//!
//! A ray makes the cells that it crosses free and the cell in which it ends occupied. A cell that was hit often enough
//! is occupied however many rays grazed it: far floor is crossed at a small angle by every ray that ends behind it.

mod cell_walk;
mod strays;

use cell_walk::CellWalk;
pub use strays::Strays;

use glam::DVec3;

use super::Hit;
use super::bricks::{BrickIndex, CELLS, LastRegion, cell_of, split};

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// No ray reached it.
    Unknown,
    /// Rays crossed it.
    Free,
    /// Rays ended in it.
    Occupied,
}

/// Where a ray ends, before a range is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sight {
    /// An occupied cell.
    Surface([i32; 3]),
    /// A cell next to an occupied one, itself unseen; the ray meets no occupied one.
    Frontier([i32; 3]),
}

/// A map of cubic cells in a hash of 8 x 8 x 8 bricks; memory grows with the surface seen, not with the volume.
#[derive(Clone, Debug)]
pub struct VoxelMap {
    voxel_m: f64,
    least_hits: u8,
    longest_ray_m: f64,
    index: BrickIndex,
    bricks: Vec<Brick>,
    bricks_with_ends: usize,
    /// Minimum and maximum cell that was hit.
    hit_cells: Option<[[i32; 3]; 2]>,
    rejected: u64,
    is_full: bool,
}

/// Memory that a map may take: points far apart take a brick each.
const MOST_BYTES: usize = 4 << 30;

/// 512 cells.
#[derive(Clone, Debug)]
struct Brick {
    crossed: [u64; CELLS / 64],
    /// Made when the first ray ends in the brick: most bricks hold air.
    ends: Option<Box<Ends>>,
}

#[derive(Clone, Debug)]
struct Ends {
    /// Hits by cell, no more than 255.
    hits: [u8; CELLS],
    /// Mean of those hits, as seen from the cell's centre, in voxels.
    mean: [[f32; 3]; CELLS],
}

impl VoxelMap {
    /// An unknown world. Cells of edge `voxel_m` are occupied from `least_hits` hits on; rays longer than
    /// `longest_ray_m` are not believed.
    ///
    /// # Errors
    /// An edge or a length that is not finite and above 0, or no hits.
    pub fn new(voxel_m: f64, least_hits: u8, longest_ray_m: f64) -> Result<Self, VoxelMapError> {
        for (name, value) in [("voxel edge", voxel_m), ("longest ray", longest_ray_m)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(VoxelMapError { reason: format!("{name} of {value} m, expected above 0") });
            }
        }
        if least_hits == 0 {
            return Err(VoxelMapError { reason: "0 hits make no cell occupied, expected at least 1".into() });
        }
        let (index, bricks) = (BrickIndex::default(), Vec::new());
        Ok(Self {
            voxel_m,
            least_hits,
            longest_ray_m,
            index,
            bricks,
            bricks_with_ends: 0,
            hit_cells: None,
            rejected: 0,
            is_full: false,
        })
    }

    /// Edge of a cell, m.
    pub(crate) fn voxel_m(&self) -> f64 {
        self.voxel_m
    }

    /// Rays that were not finite, too long, or out of reach.
    pub(crate) fn rejected(&self) -> u64 {
        self.rejected
    }

    /// A return: free from the sensor to the point, occupied there.
    pub fn add_return(&mut self, origin_m: DVec3, point_m: DVec3) {
        if self.cross(origin_m, point_m) {
            self.occupy(point_m);
        }
    }

    /// A return from an unknown sensor position: occupied at the point, unknown before it.
    pub(crate) fn add_point(&mut self, point_m: DVec3) {
        if self.cross(point_m, point_m) {
            self.occupy(point_m);
        }
    }

    /// Whether something is missing because the map would take more than 4 GiB.
    pub(crate) fn is_full(&self) -> bool {
        self.is_full
    }

    fn occupy(&mut self, point_m: DVec3) {
        let cell = self.cell_at(point_m);
        let (brick, inside) = split(cell);
        let Some(number) = self.brick(brick, &mut LastRegion::default()) else { return };
        if self.is_full && self.bricks[number].ends.is_none() {
            return;
        }
        self.bricks_with_ends += usize::from(self.bricks[number].ends.is_none());
        let ends = self.bricks[number].ends.get_or_insert_with(|| Box::new(Ends::NONE));
        let before = ends.hits[inside];
        ends.hits[inside] = before.saturating_add(1);
        let centre = DVec3::from(cell.map(f64::from)) + 0.5;
        let offset = (point_m / self.voxel_m - centre).as_vec3();
        for axis in 0..3 {
            ends.mean[inside][axis] += (offset[axis] - ends.mean[inside][axis]) / (f32::from(before) + 1.0);
        }
        let [low, high] = self.hit_cells.unwrap_or([cell, cell]);
        let each =
            |pick: fn(i32, i32) -> i32, bound: [i32; 3]| [0, 1, 2].map(|axis| pick(bound[axis], cell[axis]));
        self.hit_cells = Some([each(i32::min, low), each(i32::max, high)]);
    }

    /// A beam that brought nothing back: free as far as the sensor surely would have seen something.
    #[cfg(test)]
    pub(crate) fn add_miss(&mut self, origin_m: DVec3, direction: DVec3, sure_range_m: f64) {
        self.cross(origin_m, origin_m + sure_range_m * direction);
    }

    /// State of the cell around a point.
    pub(crate) fn cell(&self, point_m: DVec3) -> Cell {
        self.state(self.cell_at(point_m), &mut LastRegion::default())
    }

    /// Whether the cell around a point, or one of its 6 neighbours, is occupied.
    pub(crate) fn is_at_surface(&self, point_m: DVec3) -> bool {
        let (cell, mut last) = (self.cell_at(point_m), LastRegion::default());
        self.state(cell, &mut last) == Cell::Occupied || self.touches_surface(cell, &mut last)
    }

    /// Number of cells that are free, and that are occupied.
    pub(crate) fn counts(&self) -> [u64; 2] {
        let mut counts = [0, 0];
        for brick in &self.bricks {
            for inside in 0..CELLS {
                match brick.state(inside, self.least_hits) {
                    Cell::Unknown => {}
                    Cell::Free => counts[0] += 1,
                    Cell::Occupied => counts[1] += 1,
                }
            }
        }
        counts
    }

    fn occupied(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        let least_hits = self.least_hits;
        self.index.bricks().iter().zip(&self.bricks).flat_map(move |(place, brick)| {
            (0..CELLS).filter(move |inside| brick.state(*inside, least_hits) == Cell::Occupied).map(
                move |inside| {
                    let edge = [inside % 8, inside / 8 % 8, inside / 64].map(|at| at as i32);
                    [0, 1, 2].map(|axis| place[axis] * 8 + edge[axis])
                },
            )
        })
    }

    /// Mean of the hits of every occupied cell, m.
    pub(crate) fn occupied_m(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.occupied().filter_map(|cell| self.mean_m(cell))
    }

    /// How many cells some ray could end in.
    pub(crate) fn sights(&self) -> u64 {
        let mut last = LastRegion::default();
        let mut sights = 0;
        for cell in self.occupied() {
            sights += 1;
            for neighbour in neighbours(cell) {
                if self.state(neighbour, &mut last) == Cell::Unknown {
                    // counted with the first occupied one around it
                    let first =
                        neighbours(neighbour).find(|cell| self.state(*cell, &mut last) == Cell::Occupied);
                    sights += u64::from(first == Some(cell));
                }
            }
        }
        sights
    }

    /// Least axis-aligned box around the cells that were hit, m; an empty box at the origin when there is none.
    pub(crate) fn bounds_m(&self) -> [DVec3; 2] {
        let Some([low, high]) = self.hit_cells else { return [DVec3::ZERO; 2] };
        let corner = |cell: [i32; 3]| self.voxel_m * DVec3::from(cell.map(f64::from));
        [corner(low), corner(high) + self.voxel_m]
    }

    /// First occupied cell along a ray (unit direction), no further than twice the longest ray that is believed. The distance is that of the mean of the cell's hits, seen along
    /// the ray, within the cell; the normal is that of the face through which the ray enters. A ray that begins in an
    /// occupied cell hits it.
    pub(crate) fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        self.first_occupied::<true>(origin_m, direction, |_| true)
    }

    /// Whether the map does not know where a ray ends: it crosses an unknown cell before it hits something, or leaves
    /// [`VoxelMap::bounds_m`] without a hit.
    pub(crate) fn is_unknown(&self, origin_m: DVec3, direction: DVec3) -> bool {
        self.first_occupied::<false>(origin_m, direction, |cell| cell == Cell::Free).is_none()
    }

    /// None, too, from where `goes_on` says so: it is asked about every cell before that one, or, where air is skipped, some of them.
    fn first_occupied<const SKIPS_AIR: bool>(
        &self,
        origin_m: DVec3,
        direction: DVec3,
        goes_on: impl Fn(Cell) -> bool,
    ) -> Option<Hit> {
        let (enter_m, leave_m) = clip(origin_m, direction, self.bounds_m())?;
        // a hair inside, so that the first cell lies within the bounds
        let start_m = origin_m + (enter_m + 1e-9 * self.voxel_m) * direction;
        let mut walk = CellWalk::new(start_m, direction, self.voxel_m);
        let mut last = LastRegion::default();
        // no sensor sees further: one hit far off makes no ray cross all that lies between
        let length_m = leave_m.min(2.0 * self.longest_ray_m) - enter_m;
        let mut entered_m = 0.0;
        let mut axis = direction.abs().max_position();
        while entered_m <= length_m {
            let (brick, inside) = split(walk.cell);
            let brick = self.brick_near(brick, &mut last);
            if SKIPS_AIR && brick.is_none_or(|brick| brick.ends.is_none()) {
                (entered_m, axis) = walk.leave_brick();
                continue;
            }
            let state = brick.map_or(Cell::Unknown, |brick| brick.state(inside, self.least_hits));
            if state == Cell::Occupied {
                let left_m = walk.next_m().max(entered_m);
                let along_m = self.mean_m(walk.cell).map_or(entered_m, |mean| direction.dot(mean - start_m));
                let mut normal = DVec3::ZERO;
                normal[axis] = -direction[axis].signum();
                // off the cell's faces, so that the point is surely one of this cell
                let hair_m = (1e-6 * self.voxel_m).min(0.5 * (left_m - entered_m));
                let begins_here = enter_m + entered_m == 0.0;
                let low_m = if begins_here { 0.0 } else { entered_m + hair_m };
                let distance_m = enter_m + along_m.clamp(low_m, left_m - hair_m);
                return Some(Hit { distance_m, normal });
            }
            if !goes_on(state) {
                return None;
            }
            (entered_m, axis) = walk.step();
        }
        None
    }

    /// What a ray (unit direction) meets within a range; unknown cells away from surfaces count as air.
    pub(crate) fn look(&self, origin_m: DVec3, direction: DVec3, range_m: f64) -> Option<Sight> {
        let [low, high] = self.bounds_m();
        let (enter_m, leave_m) = clip(origin_m, direction, [low - self.voxel_m, high + self.voxel_m])?;
        let length_m = leave_m.min(range_m) - enter_m;
        let start_m = origin_m + (enter_m + 1e-9 * self.voxel_m) * direction;
        let mut walk = CellWalk::new(start_m, direction, self.voxel_m);
        let mut last = LastRegion::default();
        let (mut entered_m, mut frontier) = (0.0, None);
        while entered_m <= length_m {
            match self.state(walk.cell, &mut last) {
                Cell::Occupied => return Some(Sight::Surface(walk.cell)),
                Cell::Unknown if frontier.is_none() && self.touches_surface(walk.cell, &mut last) => {
                    frontier = Some(Sight::Frontier(walk.cell));
                }
                Cell::Unknown | Cell::Free => {}
            }
            (entered_m, _) = walk.step();
        }
        frontier
    }

    fn touches_surface(&self, cell: [i32; 3], last: &mut LastRegion) -> bool {
        neighbours(cell).any(|cell| self.state(cell, last) == Cell::Occupied)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.index.bytes()
            + std::mem::size_of_val(&self.bricks[..])
            + self.bricks_with_ends * std::mem::size_of::<Ends>()
    }

    /// Marks the cells from one point to before another as crossed. False when the ray is not believed.
    fn cross(&mut self, from_m: DVec3, to_m: DVec3) -> bool {
        let step_m = to_m - from_m;
        let length_m = step_m.length();
        let reach = 1e8 * self.voxel_m;
        let near = from_m.abs().max_element() < reach && to_m.abs().max_element() < reach;
        // NaN fails every comparison
        if !(length_m <= self.longest_ray_m && near) {
            self.rejected += 1;
            return false;
        }
        let end = self.cell_at(to_m);
        let direction = if length_m > 0.0 { step_m / length_m } else { DVec3::X };
        let mut walk = CellWalk::new(from_m, direction, self.voxel_m);
        let steps: u64 = (0..3).map(|axis| u64::from(walk.cell[axis].abs_diff(end[axis]))).sum();
        let mut last = LastRegion::default();
        for _ in 0..steps {
            let (brick, inside) = split(walk.cell);
            if let Some(number) = self.brick(brick, &mut last) {
                self.bricks[number].crossed[inside / 64] |= 1 << (inside % 64);
            }
            walk.step();
        }
        true
    }

    fn cell_at(&self, point_m: DVec3) -> [i32; 3] {
        cell_of(point_m, 1.0 / self.voxel_m)
    }

    fn brick(&mut self, brick: [i32; 3], last: &mut LastRegion) -> Option<usize> {
        let held =
            std::mem::size_of_val(&self.bricks[..]) + self.bricks_with_ends * std::mem::size_of::<Ends>();
        if held > MOST_BYTES {
            self.is_full = true;
            return self.index.find(brick).map(|number| number as usize);
        }
        let number = self.index.find_or_add_near(brick, last)? as usize;
        if number == self.bricks.len() {
            self.bricks.push(Brick { crossed: [0; CELLS / 64], ends: None });
        }
        Some(number)
    }

    fn state(&self, cell: [i32; 3], last: &mut LastRegion) -> Cell {
        let (brick, inside) = split(cell);
        self.brick_near(brick, last).map_or(Cell::Unknown, |brick| brick.state(inside, self.least_hits))
    }

    fn brick_near(&self, brick: [i32; 3], last: &mut LastRegion) -> Option<&Brick> {
        self.index.find_near(brick, last).map(|number| &self.bricks[number as usize])
    }

    fn mean_m(&self, cell: [i32; 3]) -> Option<DVec3> {
        let (brick, inside) = split(cell);
        let number = self.index.find(brick)?;
        let ends = self.bricks[number as usize].ends.as_ref()?;
        let mean = DVec3::from(ends.mean[inside].map(f64::from));
        Some(self.voxel_m * (DVec3::from(cell.map(f64::from)) + 0.5 + mean))
    }
}

impl Ends {
    const NONE: Self = Self { hits: [0; CELLS], mean: [[0.0; 3]; CELLS] };
}

impl Brick {
    fn state(&self, inside: usize, least_hits: u8) -> Cell {
        let hits = self.ends.as_ref().map_or(0, |ends| ends.hits[inside]);
        match (hits >= least_hits, self.crossed[inside / 64] >> (inside % 64) & 1) {
            (true, _) => Cell::Occupied,
            (false, 1) => Cell::Free,
            // too few hits to believe, but light got there
            (false, _) if hits > 0 => Cell::Free,
            (false, _) => Cell::Unknown,
        }
    }
}

/// The 6 cells around one.
fn neighbours(cell: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..6).map(move |side| {
        let mut neighbour = cell;
        neighbour[side / 2] = neighbour[side / 2].saturating_add(if side % 2 == 0 { 1 } else { -1 });
        neighbour
    })
}

/// Part of a ray inside a box: distances at which it enters and leaves, m.
fn clip(origin_m: DVec3, direction: DVec3, [low, high]: [DVec3; 2]) -> Option<(f64, f64)> {
    let (mut enter_m, mut leave_m) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if origin_m[axis] < low[axis] || origin_m[axis] >= high[axis] {
                return None;
            }
            continue;
        }
        let a = (low[axis] - origin_m[axis]) / direction[axis];
        let b = (high[axis] - origin_m[axis]) / direction[axis];
        enter_m = enter_m.max(a.min(b));
        leave_m = leave_m.min(a.max(b));
    }
    (enter_m < leave_m).then_some((enter_m, leave_m))
}

/// A map that cannot be.
#[derive(Debug, thiserror::Error)]
#[error("voxel map: {reason}")]
pub struct VoxelMapError {
    reason: String,
}

#[cfg(test)]
mod tests;
