//! A triangle mesh: any soup of triangles, two-sided, in metres with z up.

use glam::DVec3;

use super::Hit;
use super::tree::{OccluderMemory, PACKET, RayTile, TriangleTree};
use crate::base::instructions::Instructions;
use crate::base::rng::Rng;

/// A mesh ready for ray casting. Triangles may intersect, overlap and leave holes.
#[derive(Clone, Debug)]
pub struct Mesh {
    vertices_m: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    degenerate: usize,
    degenerate_area_m2: f64,
    bounds_m: [DVec3; 2],
    tree: TriangleTree,
}

impl Mesh {
    /// From vertices (m, z up) and triangles that index them. Triangles without area are dropped and counted.
    ///
    /// # Errors
    /// A coordinate that is not a finite number, an index beyond the vertices, or no triangle with an area.
    pub fn new(vertices_m: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if let Some(vertex) = vertices_m.iter().position(|point| !point.is_finite()) {
            let point = vertices_m[vertex];
            return Err(MeshError::NotFinite { vertex, found: [point.x, point.y, point.z] });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|index| **index as usize >= vertices_m.len()) {
                return Err(MeshError::IndexOutOfRange { triangle, index, vertices: vertices_m.len() });
            }
        }
        let given = triangles.len();
        let mut degenerate_area_m2 = 0.0;
        triangles.retain(|corners| {
            let corners = corners.map(|index| vertices_m[index as usize]);
            let is_retained = has_area(corners);
            if !is_retained {
                degenerate_area_m2 += area_m2(corners);
            }
            is_retained
        });
        let degenerate = given - triangles.len();
        if triangles.is_empty() {
            return Err(MeshError::Empty { vertices: vertices_m.len(), degenerate });
        }
        let corner = |triangle: &[u32; 3]| triangle.map(|index| vertices_m[index as usize]);
        let mut bounds_m = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for point in triangles.iter().flat_map(corner) {
            bounds_m = [bounds_m[0].min(point), bounds_m[1].max(point)];
        }
        let centre_m = 0.5 * (bounds_m[0] + bounds_m[1]);
        let tree = TriangleTree::new(triangles.iter().map(corner), centre_m);
        Ok(Self { vertices_m, triangles, degenerate, degenerate_area_m2, bounds_m, tree })
    }

    /// The surfaces of boxes (low and high corner, m), seen from inside and outside.
    ///
    /// # Errors
    /// Boxes without extent.
    pub fn of_boxes(boxes_m: &[[DVec3; 2]]) -> Result<Self, MeshError> {
        let (mut vertices_m, mut triangles) = (Vec::new(), Vec::new());
        for [low_m, high_m] in boxes_m {
            let first = vertices_m.len() as u32;
            let side =
                |corner: u32, axis: usize| if corner >> axis & 1 == 1 { high_m[axis] } else { low_m[axis] };
            vertices_m.extend((0..8).map(|corner| DVec3::from([0, 1, 2].map(|axis| side(corner, axis)))));
            let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
            let halves = faces.into_iter().flat_map(|[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]]);
            triangles.extend(halves.map(|corners| corners.map(|corner| first + corner)));
        }
        Self::new(vertices_m, triangles)
    }

    /// Number of triangles that rays can meet.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Triangles without area that were dropped.
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Area of those, m²: slivers have some.
    pub(crate) fn degenerate_area_m2(&self) -> f64 {
        self.degenerate_area_m2
    }

    /// Least axis-aligned box around the triangles, m.
    pub fn bounds_m(&self) -> [DVec3; 2] {
        self.bounds_m
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.vertices_m[..])
            + std::mem::size_of_val(&self.triangles[..])
            + self.tree.bytes()
    }

    /// Area of one side of all triangles, m².
    pub fn area_m2(&self) -> f64 {
        (0..self.triangles.len()).map(|triangle| self.triangle_area_m2(triangle)).sum()
    }

    /// First triangle along a ray (unit direction). A ray that starts on a triangle meets it at distance 0.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        let met = self.tree.cast(origin_m, direction, f64::INFINITY)?;
        Some(turned(met.distance_m, met.normal, direction))
    }

    /// How far the floor is below a point, and the ceiling above it, m.
    pub(crate) fn clear_height_m(&self, at_m: DVec3) -> Option<[f64; 2]> {
        let distance_m = |direction: DVec3| self.cast(at_m, direction).map(|hit| hit.distance_m);
        Some([distance_m(DVec3::NEG_Z)?, distance_m(DVec3::Z)?])
    }

    /// First triangles along many rays (unit directions), in the order given. Fastest when neighbours in the slices
    /// are neighbours in space: blocks of 16 rays walk the tree together. `report` gets the index of each ray.
    pub fn cast_many(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        report: impl FnMut(usize, Option<Hit>),
    ) {
        self.cast_many_with(Instructions::best(), origins_m, directions, report);
    }

    /// As [`Mesh::cast_many`], with given instructions; the hits are the same to the bit.
    pub fn cast_many_with(
        &self,
        instructions: Instructions,
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<Hit>),
    ) {
        let blocks = origins_m.chunks(PACKET).zip(directions.chunks(PACKET));
        for (block, (origins, directions)) in blocks.enumerate() {
            self.tree.cast_packet(origins, directions, instructions, |element, met| {
                let hit = met.map(|met| turned(met.distance_m, met.normal, directions[element]));
                report(block * PACKET + element, hit);
            });
        }
    }

    /// What the rays of a tile are about, m.
    pub(crate) fn centre_m(&self) -> DVec3 {
        self.tree.centre_m()
    }

    /// Distance to the first triangle along each ray of a tile, m, in single precision; infinite where none is nearer than
    /// `limit_m`. The same bits with any instructions.
    pub(crate) fn cast_tile(
        &self,
        tile: &RayTile,
        limit_m: f32,
        instructions: Instructions,
    ) -> [f32; PACKET] {
        self.tree.cast_tile(tile, limit_m, instructions)
    }

    /// The same with the cosine of the angle between each ray and the normal against it; 0 where no triangle was met.
    pub(crate) fn cast_tile_with_cosines(
        &self,
        tile: &RayTile,
        limit_m: f32,
        instructions: Instructions,
    ) -> ([f32; PACKET], [f64; PACKET]) {
        let (distances_m, triangles) = self.tree.cast_tile_numbered(tile, limit_m, instructions);
        let cosine = |element: usize| {
            let along = tile.direction.map(|axis| f64::from(axis[element]));
            let is_met = distances_m[element] < f32::INFINITY;
            if is_met { self.cosine(triangles[element], along.into()) } else { 0.0 }
        };
        (distances_m, std::array::from_fn(cosine))
    }

    /// Cosine of the angle between a ray and the normal of a triangle, turned against it.
    pub(crate) fn cosine(&self, triangle: u32, direction: DVec3) -> f64 {
        let [a, b, c] = self.corners(triangle as usize);
        (b - a).cross(c - a).normalize().dot(direction).abs()
    }

    /// Distance to the first triangle along each of many rays (unit directions), m, and its number, in double precision
    /// throughout.
    pub(crate) fn cast_precise(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<(f64, u32)>),
    ) {
        let corners_m = |triangle: u32| self.corners(triangle as usize);
        let blocks = origins_m.chunks(PACKET).zip(directions.chunks(PACKET));
        for (block, (origins, directions)) in blocks.enumerate() {
            self.tree.cast_precise(corners_m, origins, directions, |element, met| {
                report(block * PACKET + element, met);
            });
        }
    }

    /// Whether a surface lies between an origin and each point, more than `tolerance_m` before the
    /// point. `report` gets the index of each point and whether it is hidden.
    pub(crate) fn occluded_many(
        &self,
        origin_m: DVec3,
        points_m: &[DVec3],
        tolerance_m: f64,
        mut report: impl FnMut(usize, bool),
    ) {
        let mut memory = OccluderMemory::default();
        for (block, points) in points_m.chunks(PACKET).enumerate() {
            self.tree.occluded_packet(origin_m, points, tolerance_m, &mut memory, |element, hidden| {
                report(block * PACKET + element, hidden);
            });
        }
    }

    /// Points spread evenly over the area, the same for the same seed.
    pub(crate) fn sample(&self, count: usize, seed: u64) -> Vec<DVec3> {
        self.sample_with_normals(count, seed).into_iter().map(|(point_m, _)| point_m).collect()
    }

    /// The same points, each with the unit normal of its triangle.
    pub(crate) fn sample_with_normals(&self, count: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
        let mut below = Vec::with_capacity(self.triangles.len());
        let mut sum = 0.0;
        for triangle in 0..self.triangles.len() {
            sum += self.triangle_area_m2(triangle);
            below.push(sum);
        }
        let mut rng = Rng::new(seed, 0);
        let mut points = Vec::with_capacity(count);
        for _ in 0..count {
            let at = rng.uniform() * sum;
            let triangle = below.partition_point(|area| *area <= at).min(self.triangles.len() - 1);
            let [a, b, c] = self.corners(triangle);
            // the square root makes the density even (Osada et al. 2002, doi:10.1145/571647.571648)
            let (share, along) = (rng.uniform().sqrt(), rng.uniform());
            let point_m = (1.0 - share) * a + share * ((1.0 - along) * b + along * c);
            points.push((point_m, (b - a).cross(c - a).normalize()));
        }
        points
    }

    /// Corners of the largest triangles, m, in the order of the mesh.
    pub(crate) fn largest_triangles(&self, most: usize) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        let mut numbers: Vec<usize> = (0..self.triangles.len()).collect();
        if numbers.len() > most {
            let area_m2 = |triangle: &usize| self.triangle_area_m2(*triangle);
            numbers.sort_by(|a, b| area_m2(b).total_cmp(&area_m2(a)).then(a.cmp(b)));
            numbers.truncate(most);
            numbers.sort_unstable();
        }
        numbers.into_iter().map(|triangle| self.corners(triangle))
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[triangle];
        [self.vertices_m[a as usize], self.vertices_m[b as usize], self.vertices_m[c as usize]]
    }

    fn triangle_area_m2(&self, triangle: usize) -> f64 {
        area_m2(self.corners(triangle))
    }
}

fn area_m2([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

fn turned(distance_m: f64, normal: DVec3, direction: DVec3) -> Hit {
    let unit = normal.normalize();
    Hit { distance_m, normal: if unit.dot(direction) > 0.0 { -unit } else { unit } }
}

/// Thinner than a millionth of its length is no surface in the single precision of the tree.
fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    (b - a).cross(c - a).length() > 1e-6 * longest
}

/// What makes triangles no mesh.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum MeshError {
    /// NaN or infinite.
    #[error("vertex {vertex} (counted from 0) is not finite: {found:?}")]
    NotFinite {
        /// Position in the list of vertices.
        vertex: usize,
        /// Its coordinates.
        found: [f64; 3],
    },
    /// An index points at no vertex.
    #[error(
        "triangle {triangle} (counted from 0) names vertex {index}, there are {vertices} (counted from 0)"
    )]
    IndexOutOfRange {
        /// Position in the list of triangles.
        triangle: usize,
        /// What it names.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// Nothing that a ray could meet.
    #[error("no triangle with an area ({vertices} vertices, {degenerate} triangles without area)")]
    Empty {
        /// Number of vertices.
        vertices: usize,
        /// Triangles dropped.
        degenerate: usize,
    },
}

#[cfg(test)]
mod tests;
