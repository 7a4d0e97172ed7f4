//! The inner loop of projection, in single or double precision.

#![allow(unsafe_code)] // calls the AVX-512 and AVX2 builds of the inner loop once the CPU was asked for them

use super::elements::{BLOCK, Elements, Portable, Real};
use super::tables::{Column, Lines, NEAR_LIMIT_MM, Near, Tables};

/// A number that the kernel is built for.
pub(super) trait Kernel: Real {
    /// One point per range, column by column; zeros where the range is 0 or the column is not valid.
    fn points(tables: &Tables<Self>, valid: &[bool], range_mm: &[u32], out: &mut Vec<[Self; 3]>);
}

macro_rules! kernel {
    ($real:ty, $wide:ident) => {
        impl Kernel for $real {
            fn points(tables: &Tables<Self>, valid: &[bool], range_mm: &[u32], out: &mut Vec<[Self; 3]>) {
                out.resize(range_mm.len(), [0.0; 3]);
                #[cfg(target_arch = "x86_64")]
                {
                    use std::arch::x86_64::$wide;
                    #[target_feature(enable = "avx512f")]
                    fn with_avx512(
                        tables: &Tables<$real>,
                        valid: &[bool],
                        range_mm: &[u32],
                        out: &mut [[$real; 3]],
                    ) {
                        points_in::<$wide>(tables, valid, range_mm, out);
                    }
                    #[target_feature(enable = "avx2")]
                    fn with_avx2(
                        tables: &Tables<$real>,
                        valid: &[bool],
                        range_mm: &[u32],
                        out: &mut [[$real; 3]],
                    ) {
                        points_in::<Portable<$real>>(tables, valid, range_mm, out);
                    }
                    if std::arch::is_x86_feature_detected!("avx512f") {
                        // SAFETY: the CPU has the feature the function is compiled for.
                        unsafe { with_avx512(tables, valid, range_mm, out) };
                        return;
                    }
                    if std::arch::is_x86_feature_detected!("avx2") {
                        // SAFETY: the CPU has the feature the function is compiled for.
                        unsafe { with_avx2(tables, valid, range_mm, out) };
                        return;
                    }
                }
                points_in::<Portable<$real>>(tables, valid, range_mm, out);
            }
        }
    };
}

kernel!(f32, __m512);
kernel!(f64, __m512d);

/// The kernel in elements of any kind.
#[inline(always)]
pub(super) fn points_in<V: Elements>(
    tables: &Tables<V::Real>,
    valid: &[bool],
    range_mm: &[u32],
    out: &mut [[V::Real; 3]],
) {
    match (&tables.near, tables.is_flat()) {
        (Some(_), _) => columns::<V, false, true>(tables, valid, range_mm, out),
        (None, true) => columns::<V, true, false>(tables, valid, range_mm, out),
        (None, false) => columns::<V, false, false>(tables, valid, range_mm, out),
    }
}

/// `FLAT`: columns turn about the vertical, as in every housing that stands upright. `NEAR`: with the near-distance
/// correction.
#[inline(always)]
fn columns<V: Elements, const FLAT: bool, const NEAR: bool>(
    tables: &Tables<V::Real>,
    valid: &[bool],
    range_mm: &[u32],
    out: &mut [[V::Real; 3]],
) {
    let (channels, lines) = (tables.channels, &tables.lines[..]);
    // what a block writes past its column's end is written over by the next column; the last one has none
    let alone = usize::from(!channels.is_multiple_of(BLOCK));
    let together = tables.columns.len().saturating_sub(alone);
    let mut number = 0;
    for alike in valid.chunk_by(|a, b| a == b) {
        let numbers = number..number + alike.len();
        number = numbers.end;
        if !alike[0] {
            out[numbers.start * channels..numbers.end * channels].as_flattened_mut().fill(V::Real::default());
            continue;
        }
        for number in numbers.start..numbers.end.min(together) {
            let (range_mm, out) = (&range_mm[number * channels..], &mut out[number * channels..]);
            let column = &tables.columns[number];
            for (block, lines) in lines.iter().enumerate() {
                let at = block * BLOCK;
                if let (Some(range_mm), Some(out)) =
                    (range_mm[at..].first_chunk(), out[at..].first_chunk_mut())
                {
                    one_block::<V, FLAT, NEAR>(&tables.near, column, lines, channels - at, range_mm, out);
                }
            }
        }
    }
    for (number, column) in tables.columns.iter().enumerate().skip(together) {
        if !valid[number] {
            continue;
        }
        let (range_mm, out) = (&range_mm[number * channels..], &mut out[number * channels..]);
        let chunks = range_mm.chunks(BLOCK).zip(out.chunks_mut(BLOCK));
        for (lines, (range_mm, out)) in lines.iter().zip(chunks) {
            let (mut whole_mm, mut whole) = ([0; BLOCK], [[V::Real::default(); 3]; BLOCK]);
            whole_mm[..range_mm.len()].copy_from_slice(range_mm);
            one_block::<V, FLAT, NEAR>(&tables.near, column, lines, BLOCK, &whole_mm, &mut whole);
            out.copy_from_slice(&whole[..out.len()]);
        }
    }
}

#[inline(always)]
fn one_block<V: Elements, const FLAT: bool, const NEAR: bool>(
    near: &Option<Near<V::Real>>,
    column: &Column<V::Real>,
    lines: &Lines<V::Real>,
    left: usize,
    range_mm: &[u32; BLOCK],
    out: &mut [[V::Real; 3]; BLOCK],
) {
    for part in 0..BLOCK / V::WIDTH {
        let at = part * V::WIDTH;
        if at >= left {
            break;
        }
        if !V::any(range_mm, at) {
            // second returns, which few firings have
            out[at..at + V::WIDTH].as_flattened_mut().fill(V::Real::default());
            continue;
        }
        let range = V::metres(range_mm, at);
        let direction = lines.direction.each_ref().map(|axis| V::load(axis, at));
        let local =
            std::array::from_fn(|axis| range.mul(direction[axis]).add(V::load(&lines.origin[axis], at)));
        let turned = turn::<V, FLAT>(column, local);
        let point = match near {
            Some(near) if NEAR => {
                let direction = turn_about_axis(column, direction);
                let share = |axis: usize| {
                    let left = V::splat(near.limit_m).sub(turned[axis].abs());
                    let more = V::load(&lines.near[axis], at).mul(left);
                    more.where_below(range_mm, at, NEAR_LIMIT_MM)
                };
                let (forward, lateral) = (share(0), share(1));
                let upward = V::splat(near.half).mul(forward.add(lateral));
                let more = [forward, lateral, upward];
                let corrected = std::array::from_fn(|axis| turned[axis].add(direction[axis].mul(more[axis])));
                turn::<V, false>(&near.sensor_from_lidar, corrected)
            }
            _ => turned,
        };
        V::store(point, range_mm, at, out);
    }
}

#[inline(always)]
fn turn<V: Elements, const FLAT: bool>(column: &Column<V::Real>, [x, y, z]: [V; 3]) -> [V; 3] {
    let [rx, ry, rz] = column.rows.map(|row| row.map(V::splat));
    let [tx, ty, tz] = column.translation.map(V::splat);
    if FLAT {
        return [
            rx[0].mul(x).add(rx[1].mul(y)).add(tx),
            ry[0].mul(x).add(ry[1].mul(y)).add(ty),
            rz[2].mul(z).add(tz),
        ];
    }
    let row = |row: [V; 3], t: V| row[0].mul(x).add(row[1].mul(y)).add(row[2].mul(z)).add(t);
    [row(rx, tx), row(ry, ty), row(rz, tz)]
}

/// A direction in a column that turns about the vertical and nothing else.
#[inline(always)]
fn turn_about_axis<V: Elements>(column: &Column<V::Real>, [x, y, z]: [V; 3]) -> [V; 3] {
    let [rx, ry, _] = column.rows.map(|row| row.map(V::splat));
    [rx[0].mul(x).add(rx[1].mul(y)), ry[0].mul(x).add(ry[1].mul(y)), z]
}
