//! The cells of a map along a ray.

use glam::DVec3;

use crate::world::scene::bricks::{EDGE, cell_of};

/// Cells along a ray, one face at a time (Amanatides and Woo 1987, doi:10.2312/egtp.19871000).
pub(super) struct CellWalk {
    pub cell: [i32; 3],
    step: [i32; 3],
    /// Distance to the first face of each axis, m.
    first_m: [f64; 3],
    /// Distance between two faces of each axis, m; 0 along an axis without any.
    between_m: [f64; 3],
    /// Faces of each axis that lie behind.
    passed: [f64; 3],
    /// Distance to the next face of each axis, m.
    pub(super) to_face_m: [f64; 3],
}

impl CellWalk {
    pub(super) fn new(from_m: DVec3, direction: DVec3, voxel_m: f64) -> Self {
        let cell = cell_of(from_m, 1.0 / voxel_m);
        let (mut step, mut first_m, mut between_m) = ([0; 3], [f64::INFINITY; 3], [0.0; 3]);
        for axis in 0..3 {
            let slope = direction[axis];
            if slope == 0.0 {
                continue;
            }
            let face = f64::from(cell[axis]) + f64::from(u8::from(slope > 0.0));
            step[axis] = if slope > 0.0 { 1 } else { -1 };
            first_m[axis] = ((face * voxel_m - from_m[axis]) / slope).max(0.0);
            between_m[axis] = voxel_m / slope.abs();
        }
        Self { cell, step, first_m, between_m, passed: [0.0; 3], to_face_m: first_m }
    }

    /// Distance to where the ray leaves the cell, m.
    pub(super) fn next_m(&self) -> f64 {
        self.to_face_m[0].min(self.to_face_m[1]).min(self.to_face_m[2])
    }

    /// On to the next cell: distance to it, m, and the axis of the face.
    #[inline]
    pub(super) fn step(&mut self) -> (f64, usize) {
        let axis = nearest(self.to_face_m);
        let walked_m = self.to_face_m[axis];
        // which axis is next cannot be foretold: no jumps
        for of in 0..3 {
            self.pass(of, i32::from(of == axis));
        }
        (walked_m, axis)
    }

    /// On to the first cell outside the brick, as by one step after the other.
    pub(super) fn leave_brick(&mut self) -> (f64, usize) {
        let within = |axis: usize| {
            let inside = self.cell[axis] & (EDGE - 1);
            if self.step[axis] > 0 { EDGE - 1 - inside } else { inside }
        };
        let within = [within(0), within(1), within(2)];
        let after_m = |axis: usize, faces: i32| {
            self.first_m[axis] + (self.passed[axis] + f64::from(faces)) * self.between_m[axis]
        };
        let out_m = [after_m(0, within[0]), after_m(1, within[1]), after_m(2, within[2])];
        let axis = nearest(out_m);
        let walked_m = out_m[axis];
        let faces = |of: usize| {
            if of == axis {
                return within[axis] + 1;
            }
            let is_before = |faces| {
                let face_m = after_m(of, faces);
                face_m < walked_m || (face_m == walked_m && of < axis)
            };
            // nearly that many; a rounded quotient is one off at most faces
            let about = ((walked_m - self.to_face_m[of]) / self.between_m[of]) as i32;
            let mut faces = about.clamp(0, within[of]);
            while faces > 0 && !is_before(faces - 1) {
                faces -= 1;
            }
            while faces < within[of] && is_before(faces) {
                faces += 1;
            }
            faces
        };
        for (of, faces) in [faces(0), faces(1), faces(2)].into_iter().enumerate() {
            self.pass(of, faces);
        }
        (walked_m, axis)
    }

    #[inline]
    fn pass(&mut self, axis: usize, faces: i32) {
        self.cell[axis] = self.cell[axis].saturating_add(faces * self.step[axis]);
        self.passed[axis] += f64::from(faces);
        self.to_face_m[axis] = self.first_m[axis] + self.passed[axis] * self.between_m[axis];
    }
}

/// Axis of the nearest of three faces, the first of equals.
#[inline]
fn nearest(face_m: [f64; 3]) -> usize {
    let x = face_m[0] <= face_m[1] && face_m[0] <= face_m[2];
    let y = face_m[1] <= face_m[2];
    if x { 0 } else { 2 - usize::from(y) }
}
