//! Rays side by side, and their tests against boxes and triangles.
//!
//! Every operation is one IEEE operation in a fixed order, nothing fused: the same bits with any instruction set.

use glam::DVec3;

use super::build::{Corner, Node, WIDTH};
use super::{NONE, PACKET, RayTile};

/// What rounding may add to the distance of a plane: a few roundings of the largest number in it.
const SLACK: f32 = 4e-7;
/// Edge slack against leaks between neighbours, as a share of edge length times distance: a few f32 roundings.
const EDGE_SLACK: f32 = 4e-7;

/// Rays side by side.
#[repr(C, align(64))]
pub(super) struct Packet<const N: usize> {
    origin: [[f32; N]; 3],
    direction: [[f32; N]; 3],
    inverse: [[f32; N]; 3],
    /// What is subtracted from `plane * inverse` to get the distance of a near plane, and of a far one: the origin's own
    /// product, moved by what rounding may add.
    near_offset: [[f32; N]; 3],
    far_offset: [[f32; N]; 3],
    /// Distance of the best hit so far.
    nearest: [f32; N],
    /// Triangle of the best hit so far, in tree order.
    pub won: [u32; N],
    /// Maximum of `nearest`.
    pub farthest: f32,
    hull: Hull,
}

/// What holds for all rays of a packet.
#[derive(Clone, Copy)]
struct Hull {
    /// Whether a box's near planes are its minimum ones, by axis.
    is_forward: [bool; 3],
    /// Some axis has rays to both sides.
    is_mixed: bool,
    /// Origin of one of the rays.
    origin: [f32; 3],
    /// Minimum and maximum inverse; both zero for an axis that says nothing about the packet.
    inverse: [[f32; 2]; 3],
    /// Least that is added to a near distance from that origin, and most that is added to a far one.
    near_add: [f32; 3],
    far_add: [f32; 3],
}

impl Hull {
    /// The near and the far planes of a node's children, by axis.
    #[inline(always)]
    fn planes<'a>(&self, node: &'a Node) -> [[&'a [f32; WIDTH]; 2]; 3] {
        [self.along(0, node), self.along(1, node), self.along(2, node)]
    }

    #[inline(always)]
    fn along<'a>(&self, axis: usize, node: &'a Node) -> [&'a [f32; WIDTH]; 2] {
        let is_forward = usize::from(self.is_forward[axis]);
        [&node.planes[axis][1 - is_forward], &node.planes[axis][is_forward]]
    }
}

impl<const N: usize> Packet<N> {
    pub(crate) fn new() -> Self {
        Self {
            origin: [[0.0; N]; 3],
            direction: [[0.0; N]; 3],
            inverse: [[0.0; N]; 3],
            near_offset: [[0.0; N]; 3],
            far_offset: [[0.0; N]; 3],
            nearest: [0.0; N],
            won: [NONE; N],
            farthest: f32::INFINITY,
            hull: Hull {
                is_forward: [true; 3],
                is_mixed: false,
                origin: [0.0; 3],
                inverse: [[0.0; 2]; 3],
                near_add: [0.0; 3],
                far_add: [0.0; 3],
            },
        }
    }

    pub(crate) fn set(&mut self, element: usize, origin: DVec3, direction: DVec3, limit_m: f64) {
        for axis in 0..3 {
            self.origin[axis][element] = origin[axis] as f32;
            self.direction[axis][element] = direction[axis] as f32;
        }
        self.nearest[element] = limit_m as f32;
    }

    /// A element met something at most so far away: a bound in single precision.
    #[inline(always)]
    pub(crate) fn limit(&mut self, element: usize, limit_m: f32) {
        self.nearest[element] = limit_m;
    }

    /// Fills the elements from `count` on with the first ray, limited to nothing.
    pub(crate) fn repeat_first(&mut self, count: usize) {
        for element in count..N {
            for axis in 0..3 {
                self.origin[axis][element] = self.origin[axis][0];
                self.direction[axis][element] = self.direction[axis][0];
            }
            self.nearest[element] = -1.0;
        }
    }

    /// Makes ready for boxes. `reach_m` is the maximum coordinate of any box.
    #[inline(always)]
    pub(crate) fn prepare(&mut self, reach_m: f32) {
        for axis in 0..3 {
            let mut negative = 0;
            for element in 0..N {
                let slope = self.direction[axis][element];
                // a zero slope would make 0 * infinity on a slab's own plane
                let slope = if slope.abs() < 1e-18 { 1e-18_f32.copysign(slope) } else { slope };
                let inverse = 1.0 / slope;
                let offset = self.origin[axis][element] * inverse;
                let slack = SLACK * (self.origin[axis][element].abs() + reach_m) * inverse.abs();
                negative += u32::from(slope < 0.0);
                self.inverse[axis][element] = inverse;
                self.near_offset[axis][element] = offset + slack;
                self.far_offset[axis][element] = offset - slack;
            }
            self.prepare_hull(axis, negative);
        }
        self.shorten();
    }

    #[inline(always)]
    fn prepare_hull(&mut self, axis: usize, negative: u32) {
        let hull = &mut self.hull;
        let start = self.origin[axis][0];
        hull.origin[axis] = start;
        let is_forward = negative == 0;
        hull.is_forward[axis] = is_forward;
        if !is_forward && negative != N as u32 {
            hull.is_mixed = true;
            hull.inverse[axis] = [0.0; 2];
            hull.near_add[axis] = f32::NEG_INFINITY;
            hull.far_add[axis] = f32::INFINITY;
            return;
        }
        let inverse = &self.inverse[axis];
        let mut near_adds = [0.0; N];
        let mut far_adds = [0.0; N];
        for element in 0..N {
            near_adds[element] = start * inverse[element] - self.near_offset[axis][element];
            far_adds[element] = start * inverse[element] - self.far_offset[axis][element];
        }
        hull.inverse[axis] = [reduced(*inverse, min), reduced(*inverse, max)];
        // ray 0 stands at the hull's origin, so that its slack is in both; the hull's own products round once more
        hull.near_add[axis] = 2.0 * reduced(near_adds, min);
        hull.far_add[axis] = 2.0 * reduced(far_adds, max);
    }

    /// Distances at which the packet may enter the boxes of a node's children; infinite where it cannot.
    #[inline(always)]
    pub(crate) fn enters<const WIDE: bool>(&self, node: &Node) -> ([f32; WIDTH], u32) {
        let hull = &self.hull;
        let [low_x, high_x] = &node.planes[0];
        let planes = hull.planes(node);
        let mut near = [0.0_f32; WIDTH];
        let mut far = [self.farthest; WIDTH];
        for side in 0..WIDTH {
            for (axis, [nears, fars]) in planes.into_iter().enumerate() {
                let [low, high] = hull.inverse[axis];
                let near_inverse = nears[side] - hull.origin[axis];
                let far_inverse = fars[side] - hull.origin[axis];
                let enter = min(near_inverse * low, near_inverse * high) + hull.near_add[axis];
                let leave = max(far_inverse * low, far_inverse * high) + hull.far_add[axis];
                near[side] = max(enter, near[side]);
                far[side] = min(leave, far[side]);
            }
        }
        // a missing child's planes are NaN
        (near, not_beyond::<WIDTH, WIDE>(&near, &far) & not_beyond::<WIDTH, WIDE>(low_x, high_x))
    }

    /// The rays that meet the box of a child before their nearest triangle, a bit each.
    #[inline(always)]
    pub(crate) fn meets_box<const WIDE: bool>(&self, node: &Node, side: usize) -> u32 {
        if self.hull.is_mixed {
            self.meets_mixed::<true, WIDE>(node, side)
        } else {
            self.meets_mixed::<false, WIDE>(node, side)
        }
    }

    #[inline(always)]
    fn meets_mixed<const MIXED: bool, const WIDE: bool>(&self, node: &Node, side: usize) -> u32 {
        let [x, y, z] = self.hull.planes(node);
        let planes = [[x[0][side], x[1][side]], [y[0][side], y[1][side]], [z[0][side], z[1][side]]];
        let mut near = [0.0_f32; N];
        let mut far = self.nearest;
        for element in 0..N {
            for (axis, [near_plane, far_plane]) in planes.into_iter().enumerate() {
                let inverse = self.inverse[axis][element];
                let (mut enter, mut leave) = (near_plane * inverse, far_plane * inverse);
                if MIXED {
                    (enter, leave) = (min(enter, leave), max(enter, leave));
                }
                near[element] = max(near[element], enter - self.near_offset[axis][element]);
                far[element] = min(far[element], leave - self.far_offset[axis][element]);
            }
        }
        not_beyond::<N, WIDE>(&near, &far)
    }

    /// Möller and Trumbore, doi:10.1080/10867651.1997.10487468, two-sided, with edges a few roundings wider. Only for
    /// the `rays` that met the triangle's box: on its own a ray would not have come here otherwise, and what a ray hits
    /// may not depend on its company.
    #[inline(always)]
    pub(crate) fn meet_triangle<const WIDE: bool>(&mut self, corner: &Corner, place: u32, rays: u32) {
        let (e1, e2) = (corner.edge1, corner.edge2);
        let normal = cross(e1, e2);
        let (mut slack, mut least) = ([0.0_f32; N], [0.0_f32; N]);
        let (mut slopes, mut heights) = ([0.0_f32; N], [0.0_f32; N]);
        for element in 0..N {
            let d = [self.direction[0][element], self.direction[1][element], self.direction[2][element]];
            let c = [
                corner.at[0] - self.origin[0][element],
                corner.at[1] - self.origin[1][element],
                corner.at[2] - self.origin[2][element],
            ];
            let r = cross(c, d);
            let slope = dot(normal, d);
            let sign = 1.0_f32.copysign(slope);
            let u = dot(r, e2) * sign;
            let v = -dot(r, e1) * sign;
            let size = slope * sign;
            slack[element] = -EDGE_SLACK * corner.reach_m * (c[0].abs() + c[1].abs() + c[2].abs());
            least[element] = if size > 0.0 { min(min(u, v), size - u - v) } else { f32::NEG_INFINITY };
            (slopes[element], heights[element]) = (slope, dot(normal, c));
        }
        let inside = not_beyond::<N, WIDE>(&slack, &least) & rays;
        for element in 0..N {
            let t = heights[element] / slopes[element];
            let better = (inside >> element & 1 != 0) & (t >= 0.0) & (t < self.nearest[element]);
            self.nearest[element] = if better { t } else { self.nearest[element] };
            self.won[element] = if better { place } else { self.won[element] };
        }
    }

    /// After triangles were met.
    #[inline(always)]
    pub(crate) fn shorten(&mut self) {
        self.farthest = reduced(self.nearest, max);
    }

    /// Every element found a triangle or looks for none; found elements are limited to nothing.
    #[inline(always)]
    pub(crate) fn all_won(&mut self) -> bool {
        let mut open = 0_u32;
        for element in 0..N {
            let found = self.won[element] != NONE;
            self.nearest[element] = if found { -1.0 } else { self.nearest[element] };
            open |= u32::from(self.nearest[element] >= 0.0);
        }
        open == 0
    }
}

impl Packet<PACKET> {
    /// The rays of a tile, none of which looks beyond `limit_m`.
    pub(crate) fn of_tile(tile: &RayTile, limit_m: f32) -> Self {
        let RayTile { origin_m: origin, direction } = *tile;
        Self { origin, direction, nearest: [limit_m; PACKET], ..Self::new() }
    }

    /// Distance of every element's triangle, m; infinite where it met none.
    #[inline(always)]
    pub(crate) fn distances(&self) -> [f32; PACKET] {
        let mut distances_m = [f32::INFINITY; PACKET];
        for (element, distance_m) in distances_m.iter_mut().enumerate() {
            let is_met = self.won[element] != NONE;
            *distance_m = if is_met { self.nearest[element] } else { f32::INFINITY };
        }
        distances_m
    }
}

/// The elements whose `near` is no larger than their `far`, a bit each. `WIDE`: compiled for AVX-512, where that is one
/// instruction, which the compiler does not find.
#[allow(unsafe_code)] // AVX-512
#[inline(always)]
fn not_beyond<const N: usize, const WIDE: bool>(near: &[f32; N], far: &[f32; N]) -> u32 {
    #[cfg(target_arch = "x86_64")]
    if WIDE && N == 16 {
        use std::arch::x86_64::{_CMP_LE_OQ, _mm512_cmp_ps_mask, _mm512_loadu_ps};
        // SAFETY: only what is compiled for these instructions is wide; both hold 16 numbers
        return unsafe {
            let (near, far) = (_mm512_loadu_ps(near.as_ptr()), _mm512_loadu_ps(far.as_ptr()));
            u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far))
        };
    }
    #[cfg(target_arch = "x86_64")]
    if WIDE && N == 8 {
        use std::arch::x86_64::{_CMP_LE_OQ, _mm256_cmp_ps_mask, _mm256_loadu_ps};
        // SAFETY: only what is compiled for these instructions is wide; both hold 8 numbers
        return unsafe {
            let (near, far) = (_mm256_loadu_ps(near.as_ptr()), _mm256_loadu_ps(far.as_ptr()));
            u32::from(_mm256_cmp_ps_mask::<_CMP_LE_OQ>(near, far))
        };
    }
    let mut is_met = [false; N];
    for element in 0..N {
        is_met[element] = near[element] <= far[element];
    }
    bits(is_met)
}

/// A bit for each element, the first lowest.
#[inline(always)]
fn bits<const N: usize>(is_set: [bool; N]) -> u32 {
    let (eights, rest) = is_set.as_chunks::<8>();
    let mut all = 0;
    for (place, pair) in eights.chunks(2).enumerate() {
        let low = eight_bytes(&pair[0]);
        let high = if pair.len() > 1 { eight_bytes(&pair[1]) } else { 0 };
        all |= sixteen_bits(low, high) << (16 * place);
    }
    for (place, is_set) in rest.iter().enumerate() {
        all |= u32::from(*is_set) << (N - rest.len() + place);
    }
    all
}

#[inline(always)]
fn eight_bytes(is_set: &[bool; 8]) -> u64 {
    let mut bytes = [0; 8];
    for element in 0..8 {
        bytes[element] = u8::from(is_set[element]);
    }
    u64::from_le_bytes(bytes)
}

/// The lowest bits of sixteen bytes: the compiler does not find the instruction.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)] // SSE2
#[inline(always)]
fn sixteen_bits(low: u64, high: u64) -> u32 {
    use std::arch::x86_64::{_mm_movemask_epi8, _mm_set_epi64x, _mm_slli_epi64};
    // SAFETY: every x86-64 has SSE2
    unsafe { _mm_movemask_epi8(_mm_slli_epi64::<7>(_mm_set_epi64x(high as i64, low as i64))) as u32 }
}

/// The lowest bits of sixteen bytes: of eight by one product.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn sixteen_bits(low: u64, high: u64) -> u32 {
    let eight = |bytes: u64| (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32;
    eight(low) | eight(high) << 8
}

/// One value for all elements, by halves: few steps that wait for one another.
#[inline(always)]
fn reduced<const N: usize>(mut values: [f32; N], choose: impl Fn(f32, f32) -> f32) -> f32 {
    let mut width = N / 2;
    while width > 0 {
        for element in 0..width {
            values[element] = choose(values[element], values[element + width]);
        }
        width /= 2;
    }
    values[0]
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
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
