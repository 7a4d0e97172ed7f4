//! A map of points in a hash of cells, each with the plane through its surroundings.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::SweepPoint;
use crate::base::geometry::Pose;

/// Points of a cell; later ones are not added.
const POINTS_PER_CELL: usize = 20;
/// Points that a plane needs.
const LEAST_OF_PLANE: f64 = 6.0;
/// Variance across a plane over that along its narrower side, at most.
const FLATNESS: f64 = 0.04;
/// Least spread along the narrower side, in cells: points of one scan line lie on a line, not on a plane.
const LEAST_WIDTH: f64 = 0.3;

/// A cell's place as one number, 21 bits per axis.
type Key = u64;

/// A plane through points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFit {
    /// Mean of the points, m.
    pub centre_m: DVec3,
    /// Unit, of either sign.
    pub normal: DVec3,
    /// Mean square distance of the points from the plane, m^2.
    pub across_m2: f64,
    /// Variance along the narrower side, m^2.
    pub narrow_m2: f64,
    /// Points.
    pub count: f64,
}

/// Anything in cells of one edge, by place.
#[derive(Clone, Debug)]
pub struct Cells<T> {
    edge_m: f64,
    held: HashMap<Key, T, BuildHasherDefault<Mixed>>,
}

/// Points in cells.
#[derive(Clone, Debug)]
pub struct PointMap {
    least_apart_m2: f64,
    cells: Cells<Cell>,
}

/// The point of a map that is nearest to a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// World, m; none where none was near enough.
    pub point_m: Option<DVec3>,
    from_m: DVec3,
    cell: Key,
    /// How far the place may move within its cell before another may be nearest, m.
    free_m: f64,
}

/// What a search for the nearest point met, as squares of distances, m^2.
struct Seen {
    first: Option<DVec3>,
    first_m2: f64,
    second_m2: f64,
    /// The least of those that are too far, or that of a cell that was not looked into.
    beyond_m2: f64,
}

#[derive(Clone, Debug, Default)]
struct Cell {
    points_m: Vec<DVec3>,
    sums: Moments,
}

/// Sums of points and of their products.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    count: f64,
    sum: DVec3,
    /// xx, yy, zz.
    squares: DVec3,
    /// yz, zx, xy.
    products: DVec3,
}

impl<T: Default> Cells<T> {
    /// Empty, of cells of this edge, m.
    pub(crate) fn new(edge_m: f64) -> Self {
        Self { edge_m, held: HashMap::default() }
    }

    /// The cell around a point, made where there is none yet.
    pub(crate) fn at_mut(&mut self, point_m: DVec3) -> &mut T {
        self.held.entry(key(place(point_m, self.edge_m))).or_default()
    }

    /// Square of the distance from a point to a cell, never more than that, m^2.
    fn gap_m2(&self, point_m: DVec3, at: [i32; 3]) -> f64 {
        let low_m = DVec3::from(at.map(f64::from)) * self.edge_m;
        // where a cell begins is known to a rounding
        let outside_m = (low_m - point_m).max(point_m - low_m - self.edge_m) - 1e-9;
        outside_m.max(DVec3::ZERO).length_squared()
    }

    /// Hands over every cell within so many to each side of that around a point.
    pub(crate) fn around(&self, point_m: DVec3, reach: i32, mut take: impl FnMut(&T)) {
        around(place(point_m, self.edge_m), reach, |at| {
            if let Some(cell) = self.held.get(&key(at)) {
                take(cell);
            }
        });
    }
}

impl PointMap {
    /// Empty, of cells of this edge, m.
    pub(crate) fn new(voxel_m: f64) -> Self {
        Self { least_apart_m2: voxel_m * voxel_m / POINTS_PER_CELL as f64, cells: Cells::new(voxel_m) }
    }

    /// Edge of a cell, m.
    pub(crate) fn voxel_m(&self) -> f64 {
        self.cells.edge_m
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.cells.held.clear();
    }

    /// Adds points of the body.
    pub(crate) fn add(&mut self, body_m: &[DVec3], world_from_body: &Pose) {
        for point in body_m {
            let point_m = world_from_body.transform_point(*point);
            let cell = self.cells.at_mut(point_m);
            let near = |other: &DVec3| other.distance_squared(point_m) < self.least_apart_m2;
            if cell.points_m.len() < POINTS_PER_CELL && !cell.points_m.iter().any(near) {
                cell.points_m.push(point_m);
                cell.sums.add(point_m);
            }
        }
    }

    /// Forgets what is farther than this from a place.
    pub(crate) fn forget(&mut self, place_m: DVec3, beyond_m: f64) {
        let far = beyond_m * beyond_m;
        self.cells.held.retain(|_, cell| cell.points_m[0].distance_squared(place_m) < far);
    }

    /// The nearest point within so many cells to each side, and no farther than so many metres.
    pub(crate) fn nearest(&self, point_m: DVec3, reach_cells: i32, within_m: f64) -> Nearest {
        let middle = place(point_m, self.cells.edge_m);
        let mut seen = Seen::within(within_m);
        // the own cell mostly has some so near that few others need be looked into
        self.look(middle, point_m, &mut seen);
        around(middle, reach_cells, |at| {
            let gap_m2 = self.cells.gap_m2(point_m, at);
            if gap_m2 >= seen.second_m2 {
                seen.beyond_m2 = seen.beyond_m2.min(gap_m2);
            } else if at != middle {
                self.look(at, point_m, &mut seen);
            }
        });
        Nearest { point_m: seen.first, from_m: point_m, cell: key(middle), free_m: seen.free_m(within_m) }
    }

    fn look(&self, at: [i32; 3], point_m: DVec3, seen: &mut Seen) {
        let points_m = self.cells.held.get(&key(at)).map_or(&[][..], |cell| &cell.points_m);
        for other in points_m {
            seen.take(*other, other.distance_squared(point_m));
        }
    }

    /// Whether that is the nearest of this place, too, as it is sure not to have changed.
    pub(crate) fn is_nearest(&self, nearest: &Nearest, point_m: DVec3) -> bool {
        point_m.distance_squared(nearest.from_m) < nearest.free_m * nearest.free_m
            && self.cell_of(point_m) == nearest.cell
    }

    /// The cell around a point, by number.
    pub(crate) fn cell_of(&self, point_m: DVec3) -> u64 {
        key(place(point_m, self.cells.edge_m))
    }

    /// The plane through the points of the cell around a point and its neighbours, where they lie on one.
    pub(crate) fn plane(&self, point_m: DVec3) -> Option<PlaneFit> {
        let mut all = Moments::default();
        self.cells.around(point_m, 1, |cell| all.join(&cell.sums));
        all.plane(self.cells.edge_m)
    }
}

impl Seen {
    fn within(within_m: f64) -> Self {
        let within_m2 = within_m * within_m;
        Self { first: None, first_m2: within_m2, second_m2: within_m2, beyond_m2: f64::INFINITY }
    }

    fn take(&mut self, point_m: DVec3, distance_m2: f64) {
        if distance_m2 < self.first_m2 {
            self.second_m2 = self.first_m2;
            (self.first, self.first_m2) = (Some(point_m), distance_m2);
        } else if distance_m2 < self.second_m2 {
            self.second_m2 = distance_m2;
        } else {
            self.beyond_m2 = self.beyond_m2.min(distance_m2);
        }
    }

    /// Moving by this brings no other nearer than the first, nor any within reach where there is none.
    fn free_m(&self, within_m: f64) -> f64 {
        let free_m = match self.first {
            Some(_) => 0.5 * (self.second_m2.sqrt() - self.first_m2.sqrt()),
            None => self.beyond_m2.sqrt() - within_m,
        };
        // both were rounded
        (free_m - 1e-9).max(0.0)
    }
}

impl Moments {
    /// One more point, m.
    pub(crate) fn add(&mut self, p: DVec3) {
        self.count += 1.0;
        self.sum += p;
        self.squares += p * p;
        self.products += DVec3::new(p.y * p.z, p.z * p.x, p.x * p.y);
    }

    /// All points of another.
    pub(crate) fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.products += other.products;
    }

    /// The plane through points gathered from cells of this edge, m, where they lie on one.
    pub(crate) fn plane(&self, edge_m: f64) -> Option<PlaneFit> {
        let least_width_m = LEAST_WIDTH * edge_m;
        if self.count < LEAST_OF_PLANE {
            return None;
        }
        let m = self.sum / self.count;
        let own = self.squares / self.count - m * m;
        let mixed = self.products / self.count - DVec3::new(m.y * m.z, m.z * m.x, m.x * m.y);
        #[rustfmt::skip]
        let spread = Matrix3::new(
            own.x, mixed.z, mixed.y,
            mixed.z, own.y, mixed.x,
            mixed.y, mixed.x, own.z,
        );
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let [across_m2, narrow_m2] = [0, 1].map(|at| eigen.eigenvalues[order[at]].max(0.0));
        if narrow_m2 < least_width_m * least_width_m || across_m2 > FLATNESS * narrow_m2 {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]);
        Some(PlaneFit {
            centre_m: m,
            normal: DVec3::new(normal[0], normal[1], normal[2]),
            across_m2,
            narrow_m2,
            count: self.count,
        })
    }
}

/// The first of the points in every cell of this edge.
pub(crate) fn thin(points: &[SweepPoint], edge_m: f64) -> Vec<SweepPoint> {
    let mut used: HashMap<Key, (), BuildHasherDefault<Mixed>> = HashMap::default();
    let fresh = |point: &&SweepPoint| used.insert(key(place(point.body_m, edge_m)), ()).is_none();
    points.iter().filter(fresh).copied().collect()
}

fn place(point_m: DVec3, edge_m: f64) -> [i32; 3] {
    (point_m / edge_m).floor().to_array().map(|value| value as i32)
}

fn key(place: [i32; 3]) -> Key {
    place.iter().fold(0, |key, at| key << 21 | (i64::from(*at) as u64 & 0x1f_ffff))
}

fn around(middle: [i32; 3], reach: i32, mut take: impl FnMut([i32; 3])) {
    for x in middle[0] - reach..=middle[0] + reach {
        for y in middle[1] - reach..=middle[1] + reach {
            for z in middle[2] - reach..=middle[2] + reach {
                take([x, y, z]);
            }
        }
    }
}

/// Hash of one number by two multiplications; the same on every machine and in every run.
#[derive(Default)]
struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(self.0 ^ u64::from(*byte)));
    }

    fn write_u64(&mut self, value: u64) {
        let mixed = value.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = (mixed ^ mixed >> 32).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    /// A map of points anywhere in a cube of 4 m, and what gives more places in a cube of any half edge, m.
    fn scattered(seed: u64, count: usize) -> (PointMap, impl FnMut(f64) -> DVec3) {
        let mut rng = Rng::new(seed, 0);
        let mut any = move |half: f64| {
            DVec3::new(rng.between(-half, half), rng.between(-half, half), rng.between(-half, half))
        };
        let points: Vec<DVec3> = (0..count).map(|_| any(2.0)).collect();
        let mut map = PointMap::new(0.5);
        map.add(&points, &Pose::IDENTITY);
        (map, any)
    }

    #[test]
    fn the_nearest_point_is_that_of_a_search_through_all() {
        let (map, mut any) = scattered(3, 400);
        // what lies too near another was not added
        let held: Vec<DVec3> = map.cells.held.values().flat_map(|cell| cell.points_m.clone()).collect();
        assert!(held.len() > 300);
        for _ in 0..200 {
            let at = any(2.2);
            let near =
                held.iter().copied().min_by(|a, b| a.distance_squared(at).total_cmp(&b.distance_squared(at)));
            let expected = near.filter(|point| point.distance(at) < 0.5);
            assert_eq!(map.nearest(at, 1, 0.5).point_m, expected);
        }
    }

    #[test]
    fn what_is_remembered_as_nearest_is_what_a_search_finds() {
        let (map, mut any) = scattered(5, 150);
        let (mut with_point, mut without) = (0, 0);
        for round in 0..20_000 {
            let within_m = [0.2, 0.5, 1.5][round % 3];
            let at = any(2.5);
            let nearest = map.nearest(at, 1, within_m);
            let moved = at + any([0.002, 0.02, 0.2][round / 3 % 3]);
            if map.is_nearest(&nearest, moved) {
                assert_eq!(map.nearest(moved, 1, within_m).point_m, nearest.point_m, "{at} to {moved}");
                with_point += usize::from(nearest.point_m.is_some());
                without += usize::from(nearest.point_m.is_none());
            }
        }
        assert!(with_point > 3000 && without > 3000, "{with_point} and {without}");
    }

    #[test]
    fn planes_are_found_and_lines_and_clouds_are_not() {
        let normal = DVec3::new(0.3, -0.2, 1.0).normalize();
        let (along, across) = normal.any_orthonormal_pair();
        let mut rng = Rng::new(4, 0);
        let mut fill = |sizes: [f64; 3]| {
            let mut map = PointMap::new(0.4);
            let points: Vec<DVec3> = (0..300)
                .map(|_| {
                    let [a, b, c] = sizes.map(|size| rng.between(-size, size));
                    a * along + b * across + c * normal
                })
                .collect();
            map.add(&points, &Pose::IDENTITY);
            map.plane(DVec3::splat(1e-3))
        };
        let plane = fill([0.6, 0.6, 0.01]).unwrap();
        assert!(plane.normal.dot(normal).abs() > 0.9995, "{plane:?}");
        assert!(plane.across_m2 < 1e-4 && plane.centre_m.dot(normal).abs() < 0.005);
        assert_eq!(fill([0.6, 0.01, 0.01]), None, "a scan line");
        assert_eq!(fill([0.6, 0.6, 0.6]), None, "a bush");
    }
}
