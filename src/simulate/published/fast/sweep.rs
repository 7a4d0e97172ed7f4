//! The inner loops: plain arithmetic over blocks of elements, compiled once for each instruction set.

#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them
#![allow(clippy::needless_range_loop)] // elements of several arrays side by side become vector instructions

use std::ops::Range;

use super::hits::{Hits, Undecided};
use super::{Plan, axes};
use crate::base::instructions::{Instructions, Level};
use crate::rig::MountDeg;
use crate::simulate::published::PublishedBox;
use crate::simulate::published::elements::{
    Directions, TINY, TO_WHOLE, WIDTH, exact_directions, fused, greater, smaller,
};
use crate::simulate::published::shell::Shell;

/// How near to a voxel's face, in voxels, the definition decides.
const GUARD: f64 = 1e-9;

/// One sensor seen from the voxel grid: lengths in voxels from the box's least corner, at the first pose of a class.
pub(super) struct View {
    /// Rows of the rotation that give u, w, z.
    rows: [[f64; 3]; 3],
    origin: [f64; 3],
    /// Distance to the end at u = 0 and to the other, from the pose nearest to it.
    to_end: [f64; 2],
    pub poses: usize,
    /// Whether a mirror image is derived from what is seen: no ray is then lost here, because the image may keep it.
    is_mirrored: bool,
    /// Class of poses.
    pub class: usize,
    /// Whether rays with a zero component are simply lost.
    loses: bool,
}

impl View {
    pub(crate) fn new(
        simulator: &PublishedBox,
        plan: &Plan,
        sensor: &MountDeg,
        class: usize,
        poses: usize,
        is_mirrored: bool,
    ) -> Self {
        let preset = &simulator.experiment.preset;
        let (u, w) = axes(simulator.experiment.path);
        let origin_m = simulator.pose(sensor, class).origin_m;
        let in_voxels =
            |axis: usize| (origin_m[axis] - preset.box_min_m[axis]) / simulator.experiment.voxel_m;
        let rotation = sensor.rotation_rows();
        let origin = [in_voxels(u), in_voxels(w), in_voxels(2)];
        let walk = (plan.comb_step * (poses - 1)) as f64;
        Self {
            rows: [rotation[u], rotation[w], rotation[2]],
            origin,
            to_end: [origin[0], plan.size.cells_u as f64 - (origin[0] + walk)],
            poses,
            is_mirrored,
            class,
            loses: simulator.loses() && !is_mirrored,
        }
    }
}

/// Sweeps ranges of azimuths and marks what is decided. All
/// views have equally many poses.
pub(super) fn run(
    plan: &Plan,
    views: &[View],
    columns: &[Range<usize>],
    shell: &mut Shell,
    instructions: Instructions,
) -> Vec<Undecided> {
    match instructions.level() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx512 => unsafe { run_avx512(plan, views, columns, shell) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx2 => unsafe { run_avx2(plan, views, columns, shell) },
        _ => run_anywhere::<false>(plan, views, columns, shell),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma,popcnt")]
fn run_avx512(plan: &Plan, views: &[View], columns: &[Range<usize>], shell: &mut Shell) -> Vec<Undecided> {
    run_anywhere::<true>(plan, views, columns, shell)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt")]
fn run_avx2(plan: &Plan, views: &[View], columns: &[Range<usize>], shell: &mut Shell) -> Vec<Undecided> {
    run_anywhere::<true>(plan, views, columns, shell)
}

#[inline(always)]
fn run_anywhere<const FUSED: bool>(
    plan: &Plan,
    views: &[View],
    columns: &[Range<usize>],
    shell: &mut Shell,
) -> Vec<Undecided> {
    let Some(poses) = views.first().map(|view| view.poses) else {
        return Vec::new();
    };
    let mut hits = Hits::new(plan, poses);
    for view in views {
        for azimuth in columns.iter().cloned().flatten() {
            sweep_column::<FUSED>(plan, view, azimuth, &mut hits);
        }
    }
    hits.mark(plan, poses, shell);
    hits.undecided
}

#[inline(always)]
fn sweep_column<const FUSED: bool>(plan: &Plan, view: &View, azimuth: usize, hits: &mut Hits) {
    let stride = hits.stride;
    // at 0 and 180 degrees whole columns have a component that is zero or nearly so
    let is_exact = view.loses && !view.is_mirrored && (azimuth == 0 || 2 * azimuth == plan.azimuths.len());
    let (sines, cosines) = (&plan.elevations[0], &plan.elevations[1]);
    let blocks = sines.as_chunks::<WIDTH>().0.iter().zip(cosines.as_chunks::<WIDTH>().0);
    for (block, (sines, cosines)) in blocks.enumerate() {
        let directions = if is_exact {
            exact_directions(&view.rows, plan.azimuths[azimuth], sines, cosines)
        } else {
            directions::<FUSED>(view, plan.azimuths[azimuth], sines, cosines)
        };
        let tiny = if is_exact { 0.0 } else { TINY };
        let rays = aim::<FUSED>(plan, view, &directions, tiny);
        if rays.left.iter().fold(0, |any, left| any | left) != 0 {
            leave(plan, view, &rays, azimuth, block, hits);
        }
        for element in 0..WIDTH {
            let bit = rays.bit[element] as usize;
            hits.combs[rays.row[element] as usize + bit / 64 * stride] |= 1 << (bit % 64);
        }
        walk_ends(plan, view, &rays, azimuth, block, hits);
    }
}

#[inline(always)]
fn directions<const FUSED: bool>(
    view: &View,
    azimuth: [f64; 2],
    sines: &[f64; WIDTH],
    cosines: &[f64; WIDTH],
) -> Directions {
    let [sin_azimuth, cos_azimuth] = azimuth;
    let mut directions = [[0.0; WIDTH]; 3];
    for (row, values) in view.rows.iter().zip(&mut directions) {
        let level = row[0] * cos_azimuth + row[1] * sin_azimuth;
        for element in 0..WIDTH {
            values[element] = fused::<FUSED>(cosines[element], level, row[2] * sines[element]);
        }
    }
    directions
}

/// A block of rays of one column.
struct Rays {
    /// Row along the walk that a ray hits, and where on it from the first pose.
    row: [u32; WIDTH],
    bit: [u32; WIDTH],
    /// Poses from which it hits an end wall, and its path over that wall in fixed point.
    ends: [u32; WIDTH],
    w: [u32; WIDTH],
    w_step: [u32; WIDTH],
    z: [u32; WIDTH],
    z_step: [u32; WIDTH],
    /// 1: lost; 2: left to the definition.
    left: [u32; WIDTH],
}

const LOST: u32 = 1;
const UNDECIDED: u32 = 2;

#[inline(always)]
fn aim<const FUSED: bool>(plan: &Plan, view: &View, directions: &Directions, tiny: f64) -> Rays {
    let zeros = [0; WIDTH];
    let mut rays = Rays {
        row: zeros,
        bit: zeros,
        ends: zeros,
        w: zeros,
        w_step: zeros,
        z: zeros,
        z_step: zeros,
        left: zeros,
    };
    let [u0, w0, z0] = view.origin;
    let cells = [plan.size.cells_u as f64, plan.size.cells_w as f64, plan.size.cells_z as f64];
    let step = plan.comb_step as f64;
    let per_step = 1.0 / step;
    let poses = view.poses as f64;
    let walk = step * (poses - 1.0);
    let far = walk + cells[0] + 8.5; // off every face
    let dump_row = plan.size.rows() as f64;
    let one = (1u64 << (32 - plan.whole_bits)) as f64;
    let step_one = step * one;
    let other_end = (1u64 << (plan.whole_bits - 1)) as f64;
    let guard = fixed_guard(view.poses) as f64 / one;
    // places in fixed point, as they stand in the low bits of an f64
    let w_start = fused::<FUSED>(w0 + guard, one, TO_WHOLE);
    let z_starts = [z0 + guard, z0 + guard + other_end].map(|z| fused::<FUSED>(z, one, TO_WHOLE));
    let to_end = view.to_end.map(|distance| distance * one);
    for element in 0..WIDTH {
        let [du, dw, dz] = [directions[0][element], directions[1][element], directions[2][element]];
        // one division for three; no product of components above the least non-zero one comes near underflow
        let (size_u, size_w, size_z) = (du.abs(), dw.abs(), dz.abs());
        let (size_uw, size_wz) = (size_u * size_w, size_w * size_z);
        let per_all = 1.0 / (size_uw * size_z);
        let (sideways, upward) = (dw > 0.0, dz > 0.0);
        let to_w = (if sideways { cells[1] - w0 } else { w0 }) * (size_u * size_z * per_all);
        let to_z = (if upward { cells[2] - z0 } else { z0 }) * (size_uw * per_all);
        let least = smaller(smaller(size_u, size_w), size_z);
        let hits_side = to_w < to_z;
        let distance = smaller(to_w, to_z);
        let along = smaller(greater(fused::<FUSED>(du, distance, u0), -far), far);
        let (d_across, across0) = if hits_side { (dz, z0) } else { (dw, w0) };
        let across = fused::<FUSED>(d_across, distance, across0);
        let (cell_along, cell_across) = (along.floor(), across.floor());
        // distances above and below the nearest faces
        let (above, below) = (
            smaller(along - cell_along, across - cell_across),
            smaller(cell_along + 1.0 - along, cell_across + 1.0 - across),
        );
        let is_left = !((smaller(above, below) >= GUARD) & (least > tiny));
        let is_lost = view.loses & (least == 0.0) & (tiny == 0.0);
        rays.left[element] = if is_lost {
            LOST
        } else if is_left {
            UNDECIDED
        } else {
            0
        };
        let face = match (hits_side, if hits_side { sideways } else { upward }) {
            (true, true) => 2.0 * cells[1] + cells[2],
            (true, false) => 2.0 * cells[1],
            (false, true) => cells[1],
            (false, false) => 0.0,
        };
        let on_row = (cell_along >= -walk) & (cell_along < cells[0]) & !is_left;
        rays.row[element] = low_bits(if on_row { face + cell_across } else { dump_row });
        rays.bit[element] = low_bits(if on_row { cell_along + walk } else { 0.0 });
        // poses before the row begins, or after it ends: half a voxel keeps the quotient off whole numbers
        let forward = du > 0.0;
        let beyond = if forward { cell_along + walk + 0.5 - cells[0] } else { -cell_along - 0.5 };
        let ends = smaller(greater((beyond * per_step).ceil(), 0.0), poses);
        rays.ends[element] = low_bits(if is_left { 0.0 } else { ends });
        let per_u = size_wz * per_all;
        let (w_slope, z_slope) = (dw * per_u, dz * per_u);
        let start = if forward { to_end[1] } else { to_end[0] };
        let z_start = if forward { z_starts[1] } else { z_starts[0] };
        rays.w[element] = fused::<FUSED>(w_slope, start, w_start).to_bits() as u32;
        rays.z[element] = fused::<FUSED>(z_slope, start, z_start).to_bits() as u32;
        rays.w_step[element] = fused::<FUSED>(w_slope, step_one, TO_WHOLE).to_bits() as u32;
        rays.z_step[element] = fused::<FUSED>(z_slope, step_one, TO_WHOLE).to_bits() as u32;
    }
    rays
}

/// The nearest whole number, modulo 2^32.
#[inline(always)]
fn low_bits(value: f64) -> u32 {
    (value + TO_WHOLE).to_bits() as u32
}

/// How far a fixed-point place may be off, in its last bits: two half bits at the start, half a bit at each step, and
/// the slope's own f64 rounding.
#[inline(always)]
fn fixed_guard(poses: usize) -> u32 {
    poses as u32 / 2 + 4
}

#[cold]
fn leave(plan: &Plan, view: &View, rays: &Rays, azimuth: usize, block: usize, hits: &mut Hits) {
    for element in (0..WIDTH).filter(|element| rays.left[*element] == UNDECIDED) {
        hits.undecided.push(Undecided {
            class: view.class,
            azimuth,
            beam: plan.beam(block, element),
            pose: None,
        });
    }
}

#[inline(always)]
fn walk_ends(plan: &Plan, view: &View, rays: &Rays, azimuth: usize, block: usize, hits: &mut Hits) {
    // copies that no reference leaves, so that they stay in registers
    let Rays { mut w, mut z, w_step, z_step, ends, .. } = *rays;
    let longest = ends.iter().copied().fold(0, u32::max);
    let whole_bits = plan.whole_bits;
    let fraction_bits = 32 - whole_bits;
    let near = (2 * fixed_guard(view.poses)) << whole_bits;
    let nowhere = (plan.size.cells_z as u32) << whole_bits;
    let marks = hits.ends.as_mut_slice();
    assert!(marks.len() == 1 << (2 * whole_bits), "a byte for every number of that many bits");
    for step in 0..longest {
        let mut place = [0u32; WIDTH];
        let mut any_near = 0;
        for element in 0..WIDTH {
            let live = step < ends[element];
            let fraction = (w[element] << whole_bits).min(z[element] << whole_bits);
            any_near |= u32::from(live & (fraction < near));
            let at = (z[element] >> fraction_bits) << whole_bits | w[element] >> fraction_bits;
            place[element] = if live { at } else { nowhere };
        }
        if any_near != 0 {
            for element in 0..WIDTH {
                let fraction = (w[element] << whole_bits).min(z[element] << whole_bits);
                if step < ends[element] && fraction < near {
                    let is_other_end = place[element] >> (2 * whole_bits - 1) != 0;
                    let pose = if is_other_end { view.poses - 1 - step as usize } else { step as usize };
                    place[element] = nowhere;
                    let beam = plan.beam(block, element);
                    hits.undecided.push(Undecided { class: view.class, azimuth, beam, pose: Some(pose) });
                }
            }
        }
        for at in place {
            // SAFETY: both halves of a place are what is left of 32 bits after a shift by 32 - whole_bits (the elements
            // that mark nothing use a z that has as many bits), and there is a byte for every such number
            unsafe { *marks.get_unchecked_mut(at as usize) = 1 };
        }
        for element in 0..WIDTH {
            w[element] = w[element].wrapping_add(w_step[element]);
            z[element] = z[element].wrapping_add(z_step[element]);
        }
    }
}
