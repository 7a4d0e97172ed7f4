//! Building the tree: a binary one by an outside builder, its nodes then merged by eight.

use std::collections::HashSet;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::{leaf_collapser::collapse, reinsertion::ReinsertionOptimizer};
use obvhs::ploc::PlocBuilder;
use obvhs::triangle::Triangle;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Most nodes above one another in a walk; deeper trees are built again, balanced.
pub(super) const DEEPEST: usize = 32;
/// Deepest binary tree that is worth merging.
const DEEPEST_BINARY: usize = 96;
/// Triangles of a leaf of the balanced tree.
const BALANCED_LEAF: usize = 4;

/// An inner node: the boxes of its children side by side, so that one load decides about eight subtrees.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// By axis the minimum and the maximum of each child. NaN where there is no child: no comparison with it holds.
    pub planes: [[[f32; WIDTH]; 2]; 3],
    /// First triangle of a leaf, or the number of an inner node.
    pub first: [u32; WIDTH],
    /// Triangles of a leaf; 0 for an inner node.
    pub count: [u16; WIDTH],
}

/// A triangle as the test wants it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub at: [f32; 3],
    pub edge1: [f32; 3],
    pub edge2: [f32; 3],
    /// Longest of the two edges, m.
    pub reach_m: f32,
}

/// What a walk needs.
pub(super) struct Built {
    pub nodes: Vec<Node>,
    pub corners: Vec<Corner>,
    /// Number of the triangle behind each corner, as they were given to the builder.
    pub sources: Vec<u32>,
    /// Maximum coordinate of any box, m.
    pub reach_m: f32,
}

/// Triangles about a centre, and the number of each as given. Copies of one, drawn from either side, add nothing, and many
/// of them stall the builder.
pub(super) fn without_copies(
    corners_m: impl ExactSizeIterator<Item = [DVec3; 3]>,
    centre_m: DVec3,
) -> (Vec<Triangle>, Vec<u32>) {
    let mut known = HashSet::with_capacity(corners_m.len());
    (0..)
        .zip(corners_m)
        .map(|(number, corner): (u32, _)| (number, corner.map(|point| (point - centre_m).as_vec3())))
        .filter(|(_, corner)| {
            let mut key = corner.map(|point| point.to_array().map(f32::to_bits));
            key.sort_unstable();
            known.insert(key)
        })
        .map(|(number, corner)| {
            let [v0, v1, v2] = corner.map(Vec3A::from);
            (Triangle { v0, v1, v2 }, number)
        })
        .unzip()
}

pub(super) fn build(triangles: &[Triangle]) -> Built {
    let built = Binary::optimized(triangles).and_then(|binary| merge(&binary, triangles));
    built.or_else(|| build_balanced(triangles)).expect("halves of 2^32 triangles are not deep")
}

pub(super) fn build_balanced(triangles: &[Triangle]) -> Option<Built> {
    merge(&Binary::balanced(triangles), triangles)
}

/// A binary tree: the root first, the two children of an inner node side by side.
struct Binary {
    nodes: Vec<Bvh2Node>,
    order: Vec<u32>,
}

impl Binary {
    /// As the builder's own preset for a medium build time, step by step: many equal triangles make a chain of nodes,
    /// which the later steps take very long over. None for such a chain.
    fn optimized(triangles: &[Triangle]) -> Option<Self> {
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
        if tree.max_depth > DEEPEST_BINARY {
            return None;
        }
        let mut optimizer = ReinsertionOptimizer::default();
        let ratio = preset.reinsertion_batch_ratio;
        optimizer.run(&mut tree, ratio, None);
        collapse(&mut tree, preset.max_prims_per_leaf, preset.collapse_traversal_cost);
        optimizer.run(&mut tree, ratio * preset.post_collapse_reinsertion_batch_ratio_multiplier, None);
        Some(Self { nodes: tree.nodes, order: tree.primitive_indices })
    }

    /// Halves by count along the longest side: never deeper than the logarithm of the count.
    fn balanced(triangles: &[Triangle]) -> Self {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut nodes = vec![Bvh2Node::default()];
        let mut open = vec![(0_usize, triangles.len(), 0_usize)];
        while let Some((start, end, place)) = open.pop() {
            let around = bounds(&order[start..end], triangles);
            if end - start <= BALANCED_LEAF {
                nodes[place] = Bvh2Node::new(around, (end - start) as u32, start as u32);
                continue;
            }
            let size = around.diagonal();
            let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
            let half = (end - start) / 2;
            order[start..end].select_nth_unstable_by(half, |a, b| {
                let key = |index: u32| triangles[index as usize].aabb().center()[axis];
                key(*a).total_cmp(&key(*b))
            });
            let first = nodes.len();
            nodes[place] = Bvh2Node::new(around, 0, first as u32);
            nodes.extend([Bvh2Node::default(); 2]);
            open.extend([(start, start + half, first), (start + half, end, first + 1)]);
        }
        Self { nodes, order }
    }
}

fn bounds(order: &[u32], triangles: &[Triangle]) -> Aabb {
    order.iter().fold(Aabb::empty(), |all, index| all.union(&triangles[*index as usize].aabb()))
}

/// Merges a binary tree's nodes by eight, triangles in the order in which a walk meets them. None if it is too deep.
fn merge(binary: &Binary, triangles: &[Triangle]) -> Option<Built> {
    let mut built = Built {
        nodes: vec![Node::EMPTY],
        corners: Vec::with_capacity(triangles.len()),
        sources: Vec::with_capacity(triangles.len()),
        reach_m: 0.0,
    };
    let root = &binary.nodes[0];
    built.reach_m = root.aabb().min.abs().max(root.aabb().max.abs()).max_element();
    // (nodes of the binary tree that become children, place of their parent, its depth)
    let mut open = vec![(vec![0_u32], 0_usize, 1_usize)];
    while let Some((mut children, place, depth)) = open.pop() {
        if depth > DEEPEST {
            return None;
        }
        widen(&mut children, &binary.nodes);
        let mut node = Node::EMPTY;
        for (side, child) in children.into_iter().enumerate() {
            let child = &binary.nodes[child as usize];
            node.set_box(side, child.aabb());
            node.count[side] = child.prim_count as u16;
            if child.is_leaf() {
                node.first[side] = built.corners.len() as u32;
                let first = child.first_index as usize;
                let own = &binary.order[first..first + child.prim_count as usize];
                built.corners.extend(own.iter().map(|index| Corner::new(&triangles[*index as usize])));
                built.sources.extend_from_slice(own);
            } else {
                node.first[side] = built.nodes.len() as u32;
                open.push((vec![child.first_index, child.first_index + 1], built.nodes.len(), depth + 1));
                built.nodes.push(Node::EMPTY);
            }
        }
        built.nodes[place] = node;
    }
    Some(built)
}

/// Replaces the largest inner node by its children until a wide node is full.
fn widen(children: &mut Vec<u32>, nodes: &[Bvh2Node]) {
    while children.len() < WIDTH {
        let area = |place: &usize| nodes[children[*place] as usize].aabb().half_area();
        let inner = (0..children.len()).filter(|place| !nodes[children[*place] as usize].is_leaf());
        let Some(largest) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else { return };
        let first = nodes[children[largest] as usize].first_index;
        children[largest] = first;
        children.push(first + 1);
    }
}

impl Node {
    const EMPTY: Self = Self { planes: [[[f32::NAN; WIDTH]; 2]; 3], first: [0; WIDTH], count: [0; WIDTH] };

    fn set_box(&mut self, side: usize, around: &Aabb) {
        for axis in 0..3 {
            self.planes[axis][0][side] = around.min[axis];
            self.planes[axis][1][side] = around.max[axis];
        }
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
            reach_m: edge1.length().max(edge2.length()),
        }
    }
}
