//! The inner loop of projection, in single or double precision.

#![allow(unsafe_code)] // calls the AVX2 build of the inner loop once the CPU was asked for it

use std::ops::{Add, Mul};

/// Channels' lines, `origin + range * direction`, component by component.
#[derive(Default)]
pub(super) struct Channels<T> {
    direction: [Vec<T>; 3],
    origin: [Vec<T>; 3],
}

/// A column's rotation, row by row, and translation.
pub(super) struct Column<T> {
    pub(super) rows: [[T; 3]; 3],
    pub(super) translation: [T; 3],
}

/// What the kernel needs of a number.
pub(super) trait Real: Copy + Default + PartialEq + Add<Output = Self> + Mul<Output = Self> {
    fn from_mm(range_mm: u32) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn from_mm(range_mm: u32) -> Self {
        f64::from(range_mm) * 1e-3
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_mm(range_mm: u32) -> Self {
        // through i32: ranges are far below 2^31, and only that conversion is one instruction everywhere
        range_mm as i32 as f32 * 1e-3
    }
}

impl<T: Real> Channels<T> {
    pub(super) fn clear(&mut self) {
        self.direction.iter_mut().chain(&mut self.origin).for_each(Vec::clear);
    }

    pub(super) fn push(&mut self, direction: [T; 3], origin: [T; 3]) {
        for axis in 0..3 {
            self.direction[axis].push(direction[axis]);
            self.origin[axis].push(origin[axis]);
        }
    }

    fn len(&self) -> usize {
        self.origin[0].len()
    }
}

/// One point per range, column by column; zeros where the range is 0.
pub(super) fn points<T: Real>(
    channels: &Channels<T>,
    columns: &[Column<T>],
    range_mm: &[u32],
    out: &mut Vec<[T; 3]>,
) {
    out.resize(range_mm.len(), [T::default(); 3]);
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2<T: Real>(
            channels: &Channels<T>,
            columns: &[Column<T>],
            range_mm: &[u32],
            out: &mut [[T; 3]],
        ) {
            points_here(channels, columns, range_mm, out);
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the CPU has the feature the function is compiled for.
            unsafe { with_avx2(channels, columns, range_mm, out) };
            return;
        }
    }
    points_here(channels, columns, range_mm, out);
}

#[inline(always)]
fn points_here<T: Real>(channels: &Channels<T>, columns: &[Column<T>], range_mm: &[u32], out: &mut [[T; 3]]) {
    let count = channels.len().max(1);
    for ((column, range_mm), out) in
        columns.iter().zip(range_mm.chunks_exact(count)).zip(out.chunks_exact_mut(count))
    {
        let zero = T::default();
        let [x, y, z] = column.rows;
        let flat = x[2] == zero && y[2] == zero && z[0] == zero && z[1] == zero;
        if flat {
            one_column::<T, true>(channels, column, range_mm, out);
        } else {
            one_column::<T, false>(channels, column, range_mm, out);
        }
    }
}

/// `FLAT`: the rotation is about the vertical, as in every housing that stands upright.
#[inline(always)]
fn one_column<T: Real, const FLAT: bool>(
    channels: &Channels<T>,
    column: &Column<T>,
    range_mm: &[u32],
    out: &mut [[T; 3]],
) {
    let count = range_mm.len();
    let [dx, dy, dz] = channels.direction.each_ref().map(|part| &part[..count]);
    let [ox, oy, oz] = channels.origin.each_ref().map(|part| &part[..count]);
    let out = &mut out[..count];
    for at in 0..count {
        let direction = [dx[at], dy[at], dz[at]];
        let origin = [ox[at], oy[at], oz[at]];
        out[at] = point::<T, FLAT>(column, range_mm[at], direction, origin);
    }
}

#[inline(always)]
fn point<T: Real, const FLAT: bool>(
    column: &Column<T>,
    range_mm: u32,
    direction: [T; 3],
    origin: [T; 3],
) -> [T; 3] {
    let range = T::from_mm(range_mm);
    let local = [0, 1, 2].map(|axis| range * direction[axis] + origin[axis]);
    let [rx, ry, rz] = column.rows;
    let [tx, ty, tz] = column.translation;
    let [x, y, z] = local;
    let point = if FLAT {
        [rx[0] * x + rx[1] * y + tx, ry[0] * x + ry[1] * y + ty, rz[2] * z + tz]
    } else {
        [
            rx[0] * x + rx[1] * y + rx[2] * z + tx,
            ry[0] * x + ry[1] * y + ry[2] * z + ty,
            rz[0] * x + rz[1] * y + rz[2] * z + tz,
        ]
    };
    point.map(|coordinate| if range_mm == 0 { T::default() } else { coordinate })
}
