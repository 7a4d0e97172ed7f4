//! A binary tree of boxes over triangles, walked by packets of rays.
//!
//! Rays of a spinning sensor come in bundles that see the same few triangles, so a packet of neighbours walks the tree
//! together and each box or triangle is loaded once for all of them. Positions are f32 about the mesh's centre; the
//! distance of the triangle that won is computed again in f64. A single ray is a packet of one: one kernel, one answer.
//!
//! `unsafe` appears once, to call the same kernel compiled for AVX2 after the processor said that it has it.
#![allow(unsafe_code)]

use std::collections::HashSet;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::{leaf_collapser::collapse, reinsertion::ReinsertionOptimizer};
use obvhs::ploc::PlocBuilder;
use obvhs::triangle::Triangle;

/// Rays that walk the tree together.
pub(super) const PACKET: usize = 16;
const NONE: u32 = u32::MAX;
/// Deepest path that the walk can hold; deeper trees are built again, balanced.
const STACK: usize = 96;
/// Growth of a box's far side that makes the slab test conservative: 1 + 2 gamma(3) (Ize 2013, "Robust BVH Ray
/// Traversal", Journal of Computer Graphics Techniques 2(2)), rounded up.
const FAR_SLACK: f32 = 1.000_000_6;
/// Edge slack against leaks between neighbours, as a share of edge length times distance: a few f32 roundings.
const EDGE_SLACK: f32 = 4e-7;

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
    nodes: Vec<Node>,
    corners: Vec<Corner>,
}

/// An inner node: the boxes of both children, so that one load decides about two subtrees.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    low: [[f32; 3]; 2],
    high: [[f32; 3]; 2],
    /// First triangle of a leaf, or the number of an inner node.
    first: [u32; 2],
    /// Triangles of a leaf; 0 for an inner node.
    count: [u16; 2],
    /// Axis along which child 0 lies below child 1.
    axis: u32,
}

/// A triangle as the test wants it.
#[derive(Clone, Copy, Debug)]
struct Corner {
    at: [f32; 3],
    edge1: [f32; 3],
    edge2: [f32; 3],
    /// Longest of the two edges, m.
    reach: f32,
}

impl TriangleTree {
    /// Builds the tree. `triangles` must not be empty and hold finite corners only.
    pub fn new(corners_m: impl ExactSizeIterator<Item = [DVec3; 3]>, centre_m: DVec3) -> Self {
        // copies of a triangle, drawn from either side, add nothing, and many of them stall the builder
        let mut known = HashSet::with_capacity(corners_m.len());
        let triangles: Vec<Triangle> = corners_m
            .map(|corner| corner.map(|point| (point - centre_m).as_vec3()))
            .filter(|corner| {
                let mut key = corner.map(|point| point.to_array().map(f32::to_bits));
                key.sort_unstable();
                known.insert(key)
            })
            .map(|corner| {
                let [v0, v1, v2] = corner.map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let built = build(&triangles).map(|built| Self::from_bvh2(&built, &triangles, centre_m));
        built.filter(|tree| tree.depth() <= STACK).unwrap_or_else(|| Self::balanced(&triangles, centre_m))
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.nodes[..]) + std::mem::size_of_val(&self.corners[..])
    }

    /// First triangle along one ray.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3, limit_m: f64) -> Option<TreeHit> {
        let mut packet = Packet::<1>::new();
        packet.set(0, origin_m - self.centre_m, direction, limit_m);
        packet.prepare();
        walk::<1, false>(&self.nodes, &self.corners, &mut packet);
        self.exact(packet.won[0], origin_m, direction)
    }

    /// First triangle along up to [`PACKET`] rays; `report` gets the index of each ray and what it met.
    pub fn cast_packet(
        &self,
        origins_m: &[DVec3],
        directions: &[DVec3],
        mut report: impl FnMut(usize, Option<TreeHit>),
    ) {
        let count = origins_m.len().min(directions.len()).min(PACKET);
        let mut packet = Packet::<PACKET>::new();
        for lane in 0..count {
            packet.set(lane, origins_m[lane] - self.centre_m, directions[lane], f64::INFINITY);
        }
        packet.repeat_first(count);
        packet.prepare();
        walk_packet::<false>(&self.nodes, &self.corners, &mut packet);
        for lane in 0..count {
            report(lane, self.exact(packet.won[lane], origins_m[lane], directions[lane]));
        }
    }

    /// Whether anything lies between an origin and each of up to [`PACKET`] points, nearer than `tolerance_m` before
    /// the point; `report` gets the index of each point and the answer.
    pub fn occluded_packet(
        &self,
        origin_m: DVec3,
        points_m: &[DVec3],
        tolerance_m: f64,
        memory: &mut OccluderMemory,
        mut report: impl FnMut(usize, bool),
    ) {
        let count = points_m.len().min(PACKET);
        let mut packet = Packet::<PACKET>::new();
        for (lane, point) in points_m[..count].iter().enumerate() {
            let way = *point - origin_m;
            let length_m = way.length();
            let direction = if length_m > 0.0 { way / length_m } else { DVec3::X };
            packet.set(lane, origin_m - self.centre_m, direction, length_m - tolerance_m);
        }
        packet.repeat_first(count);
        packet.prepare();
        for &place in &memory.places {
            meet_triangle(&self.corners[place as usize], place, &mut packet);
        }
        if !packet.all_won() {
            walk_packet::<true>(&self.nodes, &self.corners, &mut packet);
        }
        for lane in 0..count {
            let won = packet.won[lane];
            if won != NONE && !memory.places.contains(&won) {
                memory.places[memory.next] = won;
                memory.next = (memory.next + 1) % memory.places.len();
            }
            report(lane, won != NONE);
        }
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

    fn from_bvh2(built: &Bvh2, triangles: &[Triangle], centre_m: DVec3) -> Self {
        let mut tree = Self { centre_m, nodes: Vec::new(), corners: Vec::with_capacity(triangles.len()) };
        for &index in &built.primitive_indices {
            tree.corners.push(Corner::new(&triangles[index as usize]));
        }
        let root = &built.nodes[0];
        if root.is_leaf() {
            let (low, high) = (root.aabb().min.to_array(), root.aabb().max.to_array());
            tree.nodes.push(Node::one_leaf(low, high, root.first_index, root.prim_count));
            return tree;
        }
        // (node of the builder, its place here)
        tree.nodes.push(Node::EMPTY);
        let mut open = vec![(root.first_index as usize, 0_usize)];
        while let Some((first, place)) = open.pop() {
            let mut children = [&built.nodes[first], &built.nodes[first + 1]];
            let away = children[1].aabb().center() - children[0].aabb().center();
            let axis = (0..3).max_by(|a, b| away[*a].abs().total_cmp(&away[*b].abs())).unwrap_or(0);
            if away[axis] < 0.0 {
                children.swap(0, 1);
            }
            let mut node = Node { axis: axis as u32, ..Node::EMPTY };
            for (side, child) in children.into_iter().enumerate() {
                node.low[side] = child.aabb().min.to_array();
                node.high[side] = child.aabb().max.to_array();
                node.count[side] = child.prim_count as u16;
                node.first[side] = if child.is_leaf() {
                    child.first_index
                } else {
                    tree.nodes.push(Node::EMPTY);
                    open.push((child.first_index as usize, tree.nodes.len() - 1));
                    tree.nodes.len() as u32 - 1
                };
            }
            tree.nodes[place] = node;
        }
        tree
    }

    /// Halves by count along the longest side: never deeper than the logarithm of the count.
    fn balanced(triangles: &[Triangle], centre_m: DVec3) -> Self {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut tree = Self { centre_m, nodes: vec![Node::EMPTY], corners: Vec::new() };
        let mut open = vec![(0_usize, triangles.len(), 0_usize)];
        while let Some((start, end, place)) = open.pop() {
            let around = bounds(&order[start..end], triangles);
            let size = around.diagonal();
            let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
            let middle = start + (end - start) / 2;
            order[start..end].select_nth_unstable_by(middle - start, |a, b| {
                let key = |index: u32| triangles[index as usize].aabb().center()[axis];
                key(*a).total_cmp(&key(*b))
            });
            let mut node = Node { axis: axis as u32, ..Node::EMPTY };
            for (side, (from, to)) in [(start, middle), (middle, end)].into_iter().enumerate() {
                if from == to {
                    continue;
                }
                let part = bounds(&order[from..to], triangles);
                node.low[side] = part.min.to_array();
                node.high[side] = part.max.to_array();
                if to - from <= 4 {
                    node.count[side] = (to - from) as u16;
                    node.first[side] = from as u32;
                } else {
                    tree.nodes.push(Node::EMPTY);
                    open.push((from, to, tree.nodes.len() - 1));
                    node.first[side] = tree.nodes.len() as u32 - 1;
                }
            }
            tree.nodes[place] = node;
        }
        tree.corners = order.iter().map(|index| Corner::new(&triangles[*index as usize])).collect();
        tree
    }

    fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut open = vec![(0_usize, 1_usize)];
        while let Some((place, depth)) = open.pop() {
            deepest = deepest.max(depth);
            let node = &self.nodes[place];
            for side in 0..2 {
                if node.is_inner(side) {
                    open.push((node.first[side] as usize, depth + 1));
                }
            }
        }
        deepest
    }
}

/// As the builder's own preset for a medium build time, step by step: many equal triangles make a chain of nodes, which
/// the later steps take very long over. None for such a chain.
fn build(triangles: &[Triangle]) -> Option<Bvh2> {
    let preset = BvhBuildParams::medium_build();
    let all = (0..triangles.len() as u32).collect();
    let mut builder = PlocBuilder::with_capacity(triangles.len());
    let mut tree = builder.build(
        preset.ploc_search_distance,
        triangles,
        all,
        preset.sort_precision,
        preset.search_depth_threshold,
    );
    if tree.max_depth > STACK {
        return None;
    }
    let mut optimizer = ReinsertionOptimizer::default();
    let ratio = preset.reinsertion_batch_ratio;
    optimizer.run(&mut tree, ratio, None);
    collapse(&mut tree, preset.max_prims_per_leaf, preset.collapse_traversal_cost);
    optimizer.run(&mut tree, ratio * preset.post_collapse_reinsertion_batch_ratio_multiplier, None);
    Some(tree)
}

fn bounds(order: &[u32], triangles: &[Triangle]) -> obvhs::aabb::Aabb {
    order.iter().fold(obvhs::aabb::Aabb::empty(), |all, index| all.union(&triangles[*index as usize].aabb()))
}

impl Node {
    /// A node whose boxes no ray meets: comparisons with NaN are false.
    const EMPTY: Self =
        Self { low: [[f32::NAN; 3]; 2], high: [[f32::NAN; 3]; 2], first: [0; 2], count: [0; 2], axis: 0 };

    fn one_leaf(low: [f32; 3], high: [f32; 3], first: u32, count: u32) -> Self {
        let mut node = Self::EMPTY;
        node.low[0] = low;
        node.high[0] = high;
        node.first[0] = first;
        node.count[0] = count as u16;
        node
    }

    fn is_inner(&self, side: usize) -> bool {
        self.count[side] == 0 && self.low[side][0] <= self.high[side][0]
    }
}

impl Corner {
    fn new(triangle: &Triangle) -> Self {
        let edge1 = triangle.v1 - triangle.v0;
        let edge2 = triangle.v2 - triangle.v0;
        Self {
            at: triangle.v0.to_array(),
            edge1: edge1.to_array(),
            edge2: edge2.to_array(),
            reach: edge1.length().max(edge2.length()),
        }
    }
}

/// Rays side by side.
#[repr(C, align(64))]
struct Packet<const N: usize> {
    origin: [[f32; N]; 3],
    direction: [[f32; N]; 3],
    inverse: [[f32; N]; 3],
    /// Distance of the best hit so far.
    nearest: [f32; N],
    /// Triangle of the best hit so far, in tree order.
    won: [u32; N],
}

impl<const N: usize> Packet<N> {
    fn new() -> Self {
        Self {
            origin: [[0.0; N]; 3],
            direction: [[0.0; N]; 3],
            inverse: [[0.0; N]; 3],
            nearest: [0.0; N],
            won: [NONE; N],
        }
    }

    fn set(&mut self, lane: usize, origin: DVec3, direction: DVec3, limit_m: f64) {
        for axis in 0..3 {
            self.origin[axis][lane] = origin[axis] as f32;
            self.direction[axis][lane] = direction[axis] as f32;
        }
        self.nearest[lane] = limit_m as f32;
    }

    /// Fills the lanes from `count` on with the first ray, limited to nothing.
    fn repeat_first(&mut self, count: usize) {
        for lane in count..N {
            for axis in 0..3 {
                self.origin[axis][lane] = self.origin[axis][0];
                self.direction[axis][lane] = self.direction[axis][0];
            }
            self.nearest[lane] = -1.0;
        }
    }

    fn prepare(&mut self) {
        for axis in 0..3 {
            for lane in 0..N {
                let slope = self.direction[axis][lane];
                // a zero slope would make 0 * infinity on a slab's own plane
                let slope = if slope.abs() < 1e-18 { 1e-18_f32.copysign(slope) } else { slope };
                self.inverse[axis][lane] = 1.0 / slope;
            }
        }
    }
}

fn walk_packet<const ANY: bool>(nodes: &[Node], corners: &[Corner], packet: &mut Packet<PACKET>) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2, the only feature that the function asks for.
        return unsafe { walk_avx2::<ANY>(nodes, corners, packet) };
    }
    walk::<PACKET, ANY>(nodes, corners, packet);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2<const ANY: bool>(nodes: &[Node], corners: &[Corner], packet: &mut Packet<PACKET>) {
    walk::<PACKET, ANY>(nodes, corners, packet);
}

/// Finds the nearest triangle of every lane, or with `ANY` some triangle nearer than the lane's limit.
#[inline(always)]
fn walk<const N: usize, const ANY: bool>(nodes: &[Node], corners: &[Corner], packet: &mut Packet<N>) {
    let mut stack = [0_u32; STACK + 2];
    let mut height = 1;
    while height > 0 {
        height -= 1;
        let node = &nodes[stack[height] as usize];
        let forward = packet.direction[node.axis as usize][0] >= 0.0;
        let order = if forward { [0, 1] } else { [1, 0] };
        // the near child's triangles may shorten the rays before the far child is asked
        for side in order {
            if node.count[side] == 0 || !meets_box(&node.low[side], &node.high[side], packet) {
                continue;
            }
            let first = node.first[side] as usize;
            let leaf = &corners[first..first + node.count[side] as usize];
            for (place, corner) in (first as u32..).zip(leaf) {
                meet_triangle(corner, place, packet);
            }
            if ANY && packet.all_won() {
                return;
            }
        }
        for side in [order[1], order[0]] {
            if node.count[side] == 0 && meets_box(&node.low[side], &node.high[side], packet) {
                stack[height] = node.first[side];
                height += 1;
            }
        }
    }
}

impl<const N: usize> Packet<N> {
    /// Every lane found a triangle or looks for none; found lanes are limited to nothing.
    #[inline(always)]
    fn all_won(&mut self) -> bool {
        let mut open = 0_u32;
        for lane in 0..N {
            let found = self.won[lane] != NONE;
            self.nearest[lane] = if found { -1.0 } else { self.nearest[lane] };
            open |= u32::from(self.nearest[lane] >= 0.0);
        }
        open == 0
    }
}

#[inline(always)]
fn meets_box<const N: usize>(low: &[f32; 3], high: &[f32; 3], packet: &Packet<N>) -> bool {
    let mut any = 0_u32;
    for lane in 0..N {
        let mut near = 0.0_f32;
        let mut far = packet.nearest[lane];
        for axis in 0..3 {
            let inverse = packet.inverse[axis][lane];
            let a = (low[axis] - packet.origin[axis][lane]) * inverse;
            let b = (high[axis] - packet.origin[axis][lane]) * inverse;
            let (enter, leave) = (least(a, b), greatest(a, b) * FAR_SLACK);
            near = greatest(near, enter);
            far = least(far, leave);
        }
        any |= u32::from(near <= far);
    }
    any != 0
}

/// Möller and Trumbore, doi:10.1080/10867651.1997.10487468, two-sided, with edges a few roundings wider.
#[inline(always)]
fn meet_triangle<const N: usize>(corner: &Corner, place: u32, packet: &mut Packet<N>) {
    let (e1, e2) = (corner.edge1, corner.edge2);
    let normal = cross(e1, e2);
    for lane in 0..N {
        let d = [packet.direction[0][lane], packet.direction[1][lane], packet.direction[2][lane]];
        let c = [
            corner.at[0] - packet.origin[0][lane],
            corner.at[1] - packet.origin[1][lane],
            corner.at[2] - packet.origin[2][lane],
        ];
        let r = cross(c, d);
        let slope = dot(normal, d);
        let sign = 1.0_f32.copysign(slope);
        let u = dot(r, e2) * sign;
        let v = -dot(r, e1) * sign;
        let size = slope * sign;
        let slack = -EDGE_SLACK * corner.reach * (c[0].abs() + c[1].abs() + c[2].abs());
        let t = dot(normal, c) / slope;
        let inside = (u >= slack) & (v >= slack) & (size - u - v >= slack) & (size > 0.0);
        let better = inside & (t >= 0.0) & (t < packet.nearest[lane]);
        packet.nearest[lane] = if better { t } else { packet.nearest[lane] };
        packet.won[lane] = if better { place } else { packet.won[lane] };
    }
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// One machine instruction, unlike `f32::min`, which also orders NaN.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

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
        let balanced = TriangleTree::balanced(&triangles, DVec3::ZERO);
        assert!(balanced.depth() <= 10, "{} deep", balanced.depth());
        let mut hits = 0;
        for _ in 0..2000 {
            let (origin, direction) = (point(3.0), point(1.0).normalize());
            let distance = |tree: &TriangleTree| tree.cast(origin, direction, 1e9).map(|hit| hit.distance_m);
            // every triangle asked, without a tree
            let brute = (0..built.corners.len())
                .filter_map(|place| {
                    let mut packet = Packet::<1>::new();
                    packet.set(0, origin, direction, 1e9);
                    meet_triangle(&built.corners[place], place as u32, &mut packet);
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
