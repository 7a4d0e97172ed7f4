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
        let corners_m =
            |triangle: u32| self.triangles[triangle as usize].map(|index| self.vertices_m[index as usize]);
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
        self.triangles[triangle].map(|index| self.vertices_m[index as usize])
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
mod tests {
    use super::*;

    fn wall() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let corners = [[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]];
        (corners.map(DVec3::from).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn both_sides_are_seen_and_normals_look_back() {
        let (vertices, triangles) = wall();
        let mesh = Mesh::new(vertices, triangles).unwrap();
        for side in [-1.0, 1.0] {
            let hit = mesh.cast(DVec3::new(3.0 * side, 0.2, 0.3), DVec3::new(-side, 0.0, 0.0)).unwrap();
            assert!((hit.distance_m - 3.0).abs() < 1e-12);
            assert_eq!(hit.normal, DVec3::new(side, 0.0, 0.0));
        }
        assert_eq!(mesh.cast(DVec3::new(3.0, 0.0, 0.0), DVec3::X), None);
        assert_eq!(mesh.cast(DVec3::new(3.0, 1.5, 0.0), -DVec3::X), None);
        // along the plane and next to it
        assert_eq!(mesh.cast(DVec3::new(0.1, -3.0, 0.0), DVec3::Y), None);
    }

    #[test]
    fn no_ray_slips_through_a_closed_shape() {
        // a bumpy ball of small and large triangles, far from the origin
        let centre = DVec3::new(4.0e5, -5.0e6, 120.0);
        let (rings, slices) = (60_u32, 120_u32);
        let mut vertices = Vec::new();
        let mut triangles = Vec::new();
        for ring in 0..=rings {
            for slice in 0..slices {
                let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
                let around = std::f64::consts::TAU * f64::from(slice) / f64::from(slices);
                let radius = 5.0 + 0.2 * (7.0 * around).sin() * (5.0 * polar).sin();
                let unit = DVec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
                vertices.push(centre + radius * unit);
                let next = (slice + 1) % slices;
                if ring < rings {
                    let (a, b) = (ring * slices + slice, ring * slices + next);
                    triangles.push([a, b, a + slices]);
                    triangles.push([b, b + slices, a + slices]);
                }
            }
        }
        let mesh = Mesh::new(vertices.clone(), triangles).unwrap();
        assert_eq!(mesh.degenerate() as u32, 2 * slices, "the poles");
        let mut rng = Rng::new(9, 0);
        for n in 0..30_000 {
            // every third ray aims at a vertex, every third at an edge
            let aim = match n % 3 {
                0 => vertices[rng.below(vertices.len() as u64) as usize],
                1 => {
                    let at = rng.below((vertices.len() - 1) as u64) as usize;
                    vertices[at].lerp(vertices[at + 1], rng.uniform())
                }
                _ => centre + DVec3::new(rng.normal(), rng.normal(), rng.normal()),
            };
            let from =
                centre + DVec3::new(rng.between(-2.0, 2.0), rng.between(-2.0, 2.0), rng.between(-2.0, 2.0));
            let direction = (aim - from).normalize();
            let hit = mesh.cast(from, direction);
            assert!(
                hit.is_some_and(|hit| hit.distance_m < 10.6),
                "ray {n} from {from} along {direction}: {hit:?}"
            );
        }
    }

    #[test]
    fn packets_answer_as_single_rays_do() {
        let mut rng = Rng::new(11, 0);
        let vertices: Vec<DVec3> =
            (0..900).map(|_| DVec3::new(rng.normal(), rng.normal(), rng.normal())).collect();
        let near = |n: u32, rng: &mut Rng| [n, rng.below(900) as u32, rng.below(900) as u32];
        let triangles = (0..300).map(|n| near(3 * n, &mut rng)).collect();
        let mesh = Mesh::new(vertices, triangles).unwrap();
        let count = 16 * 20 + 5;
        let point = |rng: &mut Rng| DVec3::new(rng.normal(), rng.normal(), rng.normal());
        let origins: Vec<DVec3> = (0..count).map(|_| 2.0 * point(&mut rng)).collect();
        let directions: Vec<DVec3> = (0..count).map(|_| point(&mut rng).normalize()).collect();
        let (mut reported, mut all) = (Vec::new(), Vec::new());
        let mut hits = 0;
        mesh.cast_many(&origins, &directions, |index, hit| {
            reported.push(index);
            all.push(hit);
            let single = mesh.cast(origins[index], directions[index]);
            hits += usize::from(hit.is_some());
            match (hit, single) {
                (Some(a), Some(b)) => assert!((a.distance_m - b.distance_m).abs() < 1e-5, "ray {index}"),
                (a, b) => assert_eq!(a, b, "ray {index}"),
            }
        });
        for instructions in Instructions::available() {
            let mut again = Vec::new();
            mesh.cast_many_with(instructions, &origins, &directions, |_, hit| again.push(hit));
            assert_eq!(again, all, "{instructions:?}");
        }
        assert_eq!(reported, (0..count).collect::<Vec<_>>());
        assert!(hits > count / 4, "{hits} of {count}");
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let (mut vertices, triangles) = wall();
        assert!(matches!(
            Mesh::new(vertices.clone(), vec![[0, 1, 4]]),
            Err(MeshError::IndexOutOfRange { triangle: 0, index: 4, vertices: 4 })
        ));
        assert!(matches!(Mesh::new(Vec::new(), Vec::new()), Err(MeshError::Empty { .. })));
        let flat = Mesh::new(vertices.clone(), vec![[0, 1, 1], [2, 2, 2]]).unwrap_err();
        assert_eq!(flat, MeshError::Empty { vertices: 4, degenerate: 2 });
        vertices[2].y = f64::NAN;
        let error = Mesh::new(vertices, triangles).unwrap_err().to_string();
        assert!(error.contains("vertex 2") && error.contains("NaN"), "{error}");
    }

    #[test]
    fn degenerate_and_repeated_triangles_do_no_harm() {
        let (vertices, mut triangles) = wall();
        // three triangles on one edge, one of them upside down, one repeated, two without area
        triangles.extend([[0, 2, 1], [0, 1, 2], [0, 0, 1], [1, 1, 1]]);
        let mesh = Mesh::new(vertices, triangles).unwrap();
        assert_eq!((mesh.triangles(), mesh.degenerate()), (4, 2));
        assert!(mesh.cast(DVec3::new(1.0, 0.0, 0.0), -DVec3::X).is_some());
    }

    #[test]
    fn rays_in_a_face_and_along_an_edge_have_an_answer() {
        let (vertices, triangles) = wall();
        let mesh = Mesh::new(vertices, triangles).unwrap();
        // in the wall's plane: no surface is met, whatever the direction
        for direction in [DVec3::Y, DVec3::Z, DVec3::new(0.0, 0.6, 0.8)] {
            let hits = [DVec3::new(0.0, -3.0, -0.5), DVec3::ZERO, DVec3::new(0.0, 1.0, -1.0)]
                .map(|origin| mesh.cast(origin, direction));
            assert_eq!(hits, [None; 3], "{direction}");
        }
        // onto the edges, the diagonal between both triangles and the corners, from both sides
        for (y, z) in [(0.0, 0.0), (0.5, 0.5), (1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0)] {
            for side in [-2.0, 2.0] {
                let hit = mesh.cast(DVec3::new(side, y, z), DVec3::new(-side.signum(), 0.0, 0.0));
                assert_eq!(hit.map(|hit| hit.distance_m), Some(2.0), "{y} {z}");
            }
        }
    }

    #[test]
    fn many_copies_of_one_triangle_still_make_a_tree() {
        let (vertices, _) = wall();
        let mesh = Mesh::new(vertices, vec![[0, 1, 2]; 20_000]).unwrap();
        let hit = mesh.cast(DVec3::new(1.0, 0.5, -0.5), -DVec3::X).unwrap();
        assert!((hit.distance_m - 1.0).abs() < 1e-12);
    }

    #[test]
    fn samples_lie_on_the_surface_evenly_and_follow_the_seed() {
        let (mut vertices, mut triangles) = wall();
        // a second wall of a quarter of the area
        vertices
            .extend([[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.0, 1.0, 1.0], [5.0, 0.0, 1.0]].map(DVec3::from));
        triangles.extend([[4, 5, 6], [4, 6, 7]]);
        let mesh = Mesh::new(vertices, triangles).unwrap();
        assert!((mesh.area_m2() - 5.0).abs() < 1e-12);
        let points = mesh.sample(20_000, 3);
        assert_eq!(points, mesh.sample(20_000, 3));
        assert_ne!(points, mesh.sample(20_000, 4));
        let small = points.iter().filter(|p| p.x > 4.0).count() as f64 / 20_000.0;
        // binomial, 4 standard deviations
        assert!((small - 0.2).abs() < 0.0114, "{small}");
        let quarter = points.iter().filter(|p| p.x < 1.0 && p.y < 0.0 && p.z < 0.0).count() as f64 / 20_000.0;
        assert!((quarter - 0.2).abs() < 0.0114, "{quarter}");
        assert!(
            points
                .iter()
                .all(|p| (p.x - 5.0).abs() < 1e-12
                    || p.x.abs() < 1e-12 && p.y.abs() <= 1.0 && p.z.abs() <= 1.0)
        );
    }
}
