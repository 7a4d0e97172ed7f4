//! Which faces the beams at the ends of blocks hit. A block's beams lie in a plane between its two ends, and a face is
//! convex: what both ends hit, every beam between them hits.

#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them
#![allow(clippy::needless_range_loop)] // elements of several arrays side by side become vector instructions

use super::Faces;
use super::view::View;
use crate::base::instructions::{Instructions, Level};
use crate::simulate::published::elements::{WIDTH, fused_f32};

/// The columns of one pose.
pub(super) struct Ends {
    /// Directions at elevation 0, axis by axis.
    pub levels: [Vec<f32>; 3],
    /// End by end and column by column: the face that the beam hits and, from bit [`SIGNS`], three bits for components
    /// that are surely positive and three for those that are surely negative.
    codes: Vec<u16>,
}

const SIGNS: u32 = 3;

/// What a block of beams does in a column.
#[derive(Clone, Copy, Default, PartialEq)]
pub(super) struct Kind(u16);

impl Kind {
    /// Faces that the lowest and the highest beam hit.
    #[inline(always)]
    pub(crate) fn faces(self) -> [usize; 2] {
        [usize::from(self.0 & 7), usize::from(self.0 >> 3 & 7)]
    }

    /// Whether a component of a direction may be zero.
    #[inline(always)]
    pub(crate) fn may_vanish(self, axis: usize) -> bool {
        self.0 >> 6 >> axis & 1 == 1
    }
}

impl Ends {
    pub(crate) fn new(faces: &Faces) -> Self {
        let columns = faces.azimuths[0].len();
        Self {
            levels: std::array::from_fn(|_| vec![0.0; columns]),
            codes: vec![0; columns * faces.ends.len()],
        }
    }

    /// Looks at all columns of a pose.
    pub(crate) fn look(&mut self, faces: &Faces, view: &View<'_>, instructions: Instructions) {
        match instructions.level() {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx512 => unsafe { look_avx512(faces, view, self) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx2 => unsafe { look_avx2(faces, view, self) },
            _ => look::<false>(faces, view, self),
        }
    }

    /// What a block does in every column.
    pub(crate) fn kinds(&self, block: usize, kinds: &mut [Kind]) {
        let columns = self.levels[0].len();
        let begins = &self.codes[block * columns..];
        for (kind, (begin, end)) in kinds.iter_mut().zip(begins.iter().zip(&begins[columns..])) {
            let signs = (begin & end) >> SIGNS;
            *kind = Kind(begin & 7 | (end & 7) << 3 | (!(signs | signs >> 3) & 7) << 6);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma")]
fn look_avx512(faces: &Faces, view: &View<'_>, ends: &mut Ends) {
    look::<true>(faces, view, ends);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn look_avx2(faces: &Faces, view: &View<'_>, ends: &mut Ends) {
    look::<true>(faces, view, ends);
}

#[inline(always)]
fn look<const FUSED: bool>(faces: &Faces, view: &View<'_>, ends: &mut Ends) {
    let (sin_turn, cos_turn) = view.turn_sin_cos;
    let rows = view.pose.rows;
    let [slope_x, slope_y, slope_z] = view.slopes;
    let [[x_low, x_high], [y_low, y_high], [z_low, z_high]] = view.per_distance;
    let [tiny_x, tiny_y, tiny_z] = view.tiny;
    let columns = ends.levels[0].len();
    let azimuths =
        faces.azimuths[0].as_chunks::<WIDTH>().0.iter().zip(faces.azimuths[1].as_chunks::<WIDTH>().0);
    for (block, (sines, cosines)) in azimuths.enumerate() {
        let mut levels = [[0.0; WIDTH]; 3];
        for element in 0..WIDTH {
            let (sin, cos) = (
                sines[element] * cos_turn + cosines[element] * sin_turn,
                cosines[element] * cos_turn - sines[element] * sin_turn,
            );
            for axis in 0..3 {
                levels[axis][element] = (rows[axis][0] * cos + rows[axis][1] * sin) as f32;
            }
        }
        for axis in 0..3 {
            ends.levels[axis].as_chunks_mut::<WIDTH>().0[block] = levels[axis];
        }
        let [levels_x, levels_y, levels_z] = &levels;
        for (codes, tangent) in ends.codes.chunks_exact_mut(columns).zip(&faces.ends) {
            let codes = &mut codes.as_chunks_mut::<WIDTH>().0[block];
            for element in 0..WIDTH {
                let dx = fused_f32::<FUSED>(*tangent, slope_x, levels_x[element]);
                let dy = fused_f32::<FUSED>(*tangent, slope_y, levels_y[element]);
                let dz = fused_f32::<FUSED>(*tangent, slope_z, levels_z[element]);
                // share of the distance to the face ahead, by axis: the largest is the face that is hit
                let sx = greater(dx * x_low, dx * x_high);
                let sy = greater(dy * y_low, dy * y_high);
                let sz = greater(dz * z_low, dz * z_high);
                let side = if sx > sy {
                    if dx > 0.0 { 1 } else { 0 }
                } else if dy > 0.0 {
                    3
                } else {
                    2
                };
                let level = if dz > 0.0 { 5 } else { 4 };
                let face: u32 = if sz > greater(sx, sy) { level } else { side };
                let mut signs = 0_u32;
                for (axis, (size, tiny)) in [(dx, tiny_x), (dy, tiny_y), (dz, tiny_z)].into_iter().enumerate()
                {
                    signs |= if size > tiny { 1 << axis } else { 0 };
                    signs |= if size < -tiny { 8 << axis } else { 0 };
                }
                codes[element] = (face | signs << SIGNS) as u16;
            }
        }
    }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
