//! A tree of boxes over triangles, eight children to a node, walked by packets of rays.
//!
//! Rays of a spinning sensor come in bundles that see the same few triangles, so a packet of neighbours walks the tree
//! together: one test of eight boxes against the bundle's hull, and each box or triangle that is left is loaded once
//! for all of them. Positions are f32 about the mesh's centre; the distance of the triangle that won is computed again
//! in f64. A single ray is a packet of one: one kernel, one answer.

mod build;
mod packet;
mod precise;
mod walk;

use glam::DVec3;

use build::{Corner, Node};
use packet::Packet;
use precise::Precise;
use walk::Rounded;

use crate::base::instructions::Instructions;

/// Rays that walk the tree together.
pub(crate) const PACKET: usize = 16;
const NONE: u32 = u32::MAX;

/// What one ray met.
#[derive(Clone, Copy, Debug)]
pub(super) struct TreeHit {
    /// Distance, m.
    pub distance_m: f64,
    /// Normal of the triangle, not of unit length, not turned to the ray.
    pub normal: DVec3,
}

/// The last triangles that hid something: what hides a point likely hides its neighbour.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OccluderMemory {
    places: [u32; 4],
    next: usize,
}

/// Triangles in tree order and the boxes above them.
#[derive(Clone, Debug)]
pub(super) struct TriangleTree {
    centre_m: DVec3,
    /// Maximum coordinate of any box, about the centre, m.
    reach_m: f32,
    nodes: Vec<Node>,
    corners: Vec<Corner>,
    /// Number of the triangle behind each corner.
    sources: Vec<u32>,
}

/// Rays that walk a mesh together in single precision, without a word about what they met but how far away it is. Origins
/// are about the mesh's centre.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct RayTile {
    /// x, y, z of every element, m.
    pub origin_m: [[f32; PACKET]; 3],
    /// Unit vectors.
    pub direction: [[f32; PACKET]; 3],
}

impl RayTile {
    /// Nothing set yet.
    pub const EMPTY: Self = Self { origin_m: [[0.0; PACKET]; 3], direction: [[0.0; PACKET]; 3] };
}

impl TriangleTree {
    /// Builds the tree. `triangles` must not be empty and hold finite corners only.
    pub(crate) fn new(corners_m: impl ExactSizeIterator<Item = [DVec3; 3]>, centre_m: DVec3) -> Self {
        let (triangles, numbers) = build::without_copies(corners_m, centre_m);
        let built = build::build(&triangles);
        let sources = built.sources.iter().map(|triangle| numbers[*triangle as usize]).collect();
        Self { centre_m, reach_m: built.reach_m, nodes: built.nodes, corners: built.corners, sources }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.nodes[..])
            + std::mem::size_of_val(&self.corners[..])
            + std::mem::size_of_val(&self.sources[..])
    }

    /// First triangle along one ray.
    pub(crate) fn cast(&self, origin_m: DVec3, direction: DVec3, limit_m: f64) -> Option<TreeHit> {
        let mut packet = Packet::<1>::new();
        packet.set(0, origin_m - self.centre_m, direction, limit_m);
        self.walk::<1, false>(&mut packet, Instructions::best());
        self.exact(packet.won[0], origin_m, direction)
    }

    /// First triangle along up to [`PACKET`] rays; `report` gets the index of each ray and what it met.
    pub(crate) fn cast_packet(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        instructions: Instructions,
        mut report: impl FnMut(usize, Option<TreeHit>),
    ) {
        let count = origins_m.len().min(directions.len()).min(PACKET);
        let mut packet = Packet::<PACKET>::new();
        for element in 0..count {
            packet.set(element, origins_m[element] - self.centre_m, directions[element], f64::INFINITY);
        }
        packet.repeat_first(count);
        self.walk::<PACKET, false>(&mut packet, instructions);
        for element in 0..count {
            report(element, self.exact(packet.won[element], origins_m[element], directions[element]));
        }
    }

    /// Whether anything lies between an origin and each of up to [`PACKET`] points, nearer than `tolerance_m` before
    /// the point; `report` gets the index of each point and the answer.
    pub(crate) fn occluded_packet(
        &self,
        origin_m: DVec3,
        points_m: &[DVec3],
        tolerance_m: f64,
        memory: &mut OccluderMemory,
        mut report: impl FnMut(usize, bool),
    ) {
        let count = points_m.len().min(PACKET);
        let mut packet = Packet::<PACKET>::new();
        for (element, point) in points_m[..count].iter().enumerate() {
            let step_m = *point - origin_m;
            let length_m = step_m.length();
            let direction = if length_m > 0.0 { step_m / length_m } else { DVec3::X };
            packet.set(element, origin_m - self.centre_m, direction, length_m - tolerance_m);
        }
        packet.repeat_first(count);
        for &place in &memory.places {
            packet.meet_triangle::<false>(&self.corners[place as usize], place, u32::MAX);
        }
        if !packet.all_won() {
            self.walk::<PACKET, true>(&mut packet, Instructions::best());
        }
        for element in 0..count {
            let won = packet.won[element];
            if won != NONE && !memory.places.contains(&won) {
                memory.places[memory.next] = won;
                memory.next = (memory.next + 1) % memory.places.len();
            }
            report(element, won != NONE);
        }
    }

    /// What rays are about, m.
    pub(crate) fn centre_m(&self) -> DVec3 {
        self.centre_m
    }

    /// Distance to the first triangle along each ray of a tile, m, in single precision; infinite where none is nearer than
    /// `limit_m`.
    pub(crate) fn cast_tile(
        &self,
        tile: &RayTile,
        limit_m: f32,
        instructions: Instructions,
    ) -> [f32; PACKET] {
        let mut packet = Packet::<PACKET>::of_tile(tile, limit_m);
        self.walk::<PACKET, false>(&mut packet, instructions);
        packet.distances()
    }

    /// The same with the number of each triangle, which is arbitrary where none was met.
    pub(crate) fn cast_tile_numbered(
        &self,
        tile: &RayTile,
        limit_m: f32,
        instructions: Instructions,
    ) -> ([f32; PACKET], [u32; PACKET]) {
        let mut packet = Packet::<PACKET>::of_tile(tile, limit_m);
        self.walk::<PACKET, false>(&mut packet, instructions);
        (packet.distances(), packet.won.map(|place| self.sources.get(place as usize).copied().unwrap_or(0)))
    }

    /// Distance to the first triangle along each of up to [`PACKET`] rays, m, and its number, by the corners as they were
    /// given, in double precision throughout.
    pub(crate) fn cast_precise(
        &self,
        corners_m: impl Fn(u32) -> [DVec3; 3],
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<(f64, u32)>),
    ) {
        let count = origins_m.len().min(directions.len()).min(PACKET);
        let mut packet = Packet::<PACKET>::new();
        let mut precise = Precise::<_, PACKET>::new(|place| corners_m(self.sources[place as usize]));
        for element in 0..count {
            packet.set(element, origins_m[element] - self.centre_m, directions[element], f64::INFINITY);
            precise.set(element, origins_m[element], directions[element]);
        }
        packet.repeat_first(count);
        let (nodes, corners) = (&self.nodes, &self.corners);
        let best = Instructions::best();
        walk::walk::<PACKET, false, _>(nodes, corners, self.reach_m, &mut packet, &mut precise, best);
        for element in 0..count {
            let won = packet.won[element];
            let met = (won != NONE).then(|| (precise.nearest_m[element], self.sources[won as usize]));
            report(element, met);
        }
    }

    fn walk<const N: usize, const ANY: bool>(&self, packet: &mut Packet<N>, instructions: Instructions) {
        let (nodes, corners) = (&self.nodes, &self.corners);
        walk::walk::<N, ANY, _>(nodes, corners, self.reach_m, packet, &mut Rounded, instructions);
    }

    fn exact(&self, won: u32, origin_m: DVec3, direction: DVec3) -> Option<TreeHit> {
        if won == NONE {
            return None;
        }
        let corner = &self.corners[won as usize];
        let [at, edge1, edge2] =
            [corner.at, corner.edge1, corner.edge2].map(|v| DVec3::from(v.map(f64::from)));
        let normal = edge1.cross(edge2);
        let distance_m = normal.dot(at - (origin_m - self.centre_m)) / normal.dot(direction);
        // a ray along the triangle's plane has no better answer than the nearest point of its corner
        let distance_m = if distance_m.is_finite() { distance_m.max(0.0) } else { 0.0 };
        Some(TreeHit { distance_m, normal })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;
    use obvhs::triangle::Triangle;

    use super::*;
    use crate::base::rng::Rng;

    fn of(built: build::Built) -> TriangleTree {
        TriangleTree {
            centre_m: DVec3::ZERO,
            reach_m: built.reach_m,
            nodes: built.nodes,
            corners: built.corners,
            sources: built.sources,
        }
    }

    #[test]
    fn the_balanced_tree_answers_as_the_built_one() {
        let mut rng = Rng::new(2, 0);
        let mut point = |spread: f64| spread * DVec3::new(rng.normal(), rng.normal(), rng.normal());
        let corners: Vec<[DVec3; 3]> = (0..700)
            .map(|_| {
                let at = point(2.0);
                [at, at + point(0.4), at + point(0.4)]
            })
            .collect();
        let built = TriangleTree::new(corners.iter().copied(), DVec3::ZERO);
        let triangles: Vec<Triangle> = corners
            .iter()
            .map(|corner| {
                let [v0, v1, v2] = corner.map(|p| Vec3A::from(p.as_vec3()));
                Triangle { v0, v1, v2 }
            })
            .collect();
        let balanced = of(build::build_balanced(&triangles).unwrap());
        let mut hits = 0;
        for _ in 0..2000 {
            let (origin, direction) = (point(3.0), point(1.0).normalize());
            let distance = |tree: &TriangleTree| tree.cast(origin, direction, 1e9).map(|hit| hit.distance_m);
            // every triangle asked, without a tree
            let brute = (0..built.corners.len())
                .filter_map(|place| {
                    let mut packet = Packet::<1>::new();
                    packet.set(0, origin, direction, 1e9);
                    packet.meet_triangle::<false>(&built.corners[place], place as u32, 1);
                    built.exact(packet.won[0], origin, direction).map(|hit| hit.distance_m)
                })
                .reduce(f64::min);
            let (a, b) = (distance(&built), distance(&balanced));
            assert_eq!(a.is_some(), b.is_some());
            assert_eq!(a.is_some(), brute.is_some());
            if let (Some(a), Some(b), Some(brute)) = (a, b, brute) {
                assert!((a - b).abs() < 1e-5 && (a - brute).abs() < 1e-5, "{a} {b} {brute}");
                hits += 1;
            }
        }
        assert!(hits > 200, "{hits}");
    }
}
