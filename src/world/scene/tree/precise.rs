//! Rays against triangles in double precision, by the corners as they were given: what a stored hash is compared with. The
//! walk through the boxes stays in single precision, with slack that covers the rounding.

use glam::DVec3;

use super::build::Corner;
use super::packet::Packet;
use super::walk::Meet;

/// What rounding to single precision may take off a distance: a bound must not fall below it.
const BOUND_SLACK: f64 = 1e-6;

/// Rays side by side in double precision, and where the corners of a triangle are found by its place in the tree.
pub(super) struct Precise<F, const N: usize> {
    corners_m: F,
    origin_m: [[f64; N]; 3],
    direction: [[f64; N]; 3],
    pub nearest_m: [f64; N],
}

impl<F, const N: usize> Precise<F, N> {
    pub(crate) fn new(corners_m: F) -> Self {
        Self { corners_m, origin_m: [[0.0; N]; 3], direction: [[0.0; N]; 3], nearest_m: [f64::INFINITY; N] }
    }

    pub(crate) fn set(&mut self, element: usize, origin_m: DVec3, direction: DVec3) {
        for axis in 0..3 {
            self.origin_m[axis][element] = origin_m[axis];
            self.direction[axis][element] = direction[axis];
        }
    }
}

impl<F: Fn(u32) -> [DVec3; 3], const N: usize> Meet<N> for Precise<F, N> {
    #[inline(always)]
    fn meet<const WIDE: bool>(&mut self, packet: &mut Packet<N>, _: &Corner, place: u32, rays: u32) {
        let [at, second, third] = (self.corners_m)(place);
        let (e1, e2) = (second - at, third - at);
        let normal = cross(e1.to_array(), e2.to_array());
        let (at, e1, e2) = (at.to_array(), e1.to_array(), e2.to_array());
        for element in 0..N {
            let d = [self.direction[0][element], self.direction[1][element], self.direction[2][element]];
            let c = [
                at[0] - self.origin_m[0][element],
                at[1] - self.origin_m[1][element],
                at[2] - self.origin_m[2][element],
            ];
            let r = cross(c, d);
            let slope = dot(normal, d);
            let sign = 1.0_f64.copysign(slope);
            let u = dot(r, e2) * sign;
            let v = -dot(r, e1) * sign;
            let size = slope * sign;
            let t = dot(normal, c) / slope;
            let inside = (u >= 0.0) & (v >= 0.0) & (u + v <= size) & (size > 0.0);
            let came = rays >> element & 1 != 0;
            if came & inside & (t >= 0.0) & (t < self.nearest_m[element]) {
                self.nearest_m[element] = t;
                packet.won[element] = place;
                packet.limit(element, (t * (1.0 + BOUND_SLACK) + BOUND_SLACK) as f32);
            }
        }
    }
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
