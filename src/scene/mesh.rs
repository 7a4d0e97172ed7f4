//! A triangle mesh: any soup of triangles, two-sided, in metres with z up.

use glam::DVec3;

use super::Hit;
use super::tree::{OccluderMemory, PACKET, TriangleTree};
use crate::rng::Rng;

/// A mesh ready for ray casting. Triangles may intersect, overlap and leave holes.
#[derive(Clone, Debug)]
pub struct Mesh {
    vertices_m: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    degenerate: usize,
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
        triangles.retain(|corners| has_area(corners.map(|index| vertices_m[index as usize])));
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
        Ok(Self { vertices_m, triangles, degenerate, bounds_m, tree })
    }

    /// Number of triangles that rays can meet.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Triangles without area that were dropped.
    pub fn degenerate(&self) -> usize {
        self.degenerate
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

    /// First triangle along a ray (unit direction).
    pub fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        let met = self.tree.cast(origin_m, direction, f64::INFINITY)?;
        Some(turned(met.distance_m, met.normal, direction))
    }

    /// First triangles along many rays (unit directions), in the order given. Fastest when neighbours in the slices
    /// are neighbours in space: blocks of 16 rays walk the tree together. `report` gets the index of each ray.
    pub fn cast_many(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<Hit>),
    ) {
        let blocks = origins_m.chunks(PACKET).zip(directions.chunks(PACKET));
        for (block, (origins, directions)) in blocks.enumerate() {
            self.tree.cast_packet(origins, directions, |lane, met| {
                let hit = met.map(|met| turned(met.distance_m, met.normal, directions[lane]));
                report(block * PACKET + lane, hit);
            });
        }
    }

    /// Whether a surface lies on the straight way from an origin to each point, more than `tolerance_m` before the
    /// point. `report` gets the index of each point and whether it is hidden.
    pub fn occluded_many(
        &self,
        origin_m: DVec3,
        points_m: &[DVec3],
        tolerance_m: f64,
        mut report: impl FnMut(usize, bool),
    ) {
        let mut memory = OccluderMemory::default();
        for (block, points) in points_m.chunks(PACKET).enumerate() {
            self.tree.occluded_packet(origin_m, points, tolerance_m, &mut memory, |lane, hidden| {
                report(block * PACKET + lane, hidden);
            });
        }
    }

    /// Points spread evenly over the area, the same for the same seed.
    pub fn sample(&self, count: usize, seed: u64) -> Vec<DVec3> {
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
            points.push((1.0 - share) * a + share * ((1.0 - along) * b + along * c));
        }
        points
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|index| self.vertices_m[index as usize])
    }

    fn triangle_area_m2(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.corners(triangle);
        0.5 * (b - a).cross(c - a).length()
    }
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
