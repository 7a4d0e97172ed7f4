//! The inner loops: plain arithmetic over blocks of lanes, compiled once for each instruction set.

use std::ops::Range;

use super::{Plan, axes};
use crate::simulate::published::shell::Shell;
use crate::simulate::published::{Placement, Simulator, brute};

/// Beams that are worked on side by side.
pub(super) const LANES: usize = 16;

/// How near to a voxel's face, in voxels, the definition decides.
const GUARD: f64 = 1e-9;

/// Adding this leaves the nearest whole number in the low bits of an f64 (1.5 * 2^52).
const TO_WHOLE: f64 = 6_755_399_441_055_744.0;

/// One sensor seen from the voxel grid: lengths in voxels from the box's least corner, at the first pose of a class.
pub(super) struct View {
    /// Rows of the rotation that give u, w, z.
    rows: [[f64; 3]; 3],
    origin: [f64; 3],
    /// Distance to the end at u = 0 and to the other, from the pose nearest to it.
    to_end: [f64; 2],
    poses: usize,
    /// Direction components up to this are left to the definition.
    tiny: f64,
}

impl View {
    pub fn new(
        simulator: &Simulator,
        plan: &Plan,
        sensor: &Placement,
        class: usize,
        poses: usize,
        is_mirrored: bool,
    ) -> Self {
        let preset = &simulator.experiment.preset;
        let (u, w) = axes(simulator.experiment.path);
        let origin_m = brute::origin_m(simulator, sensor, simulator.stations_m[class]);
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
            tiny: if is_mirrored { 1e-12 } else { 0.0 },
        }
    }
}

/// A ray, or one pose of it, that the definition must decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Undecided {
    pub azimuth: usize,
    pub beam: usize,
    /// Counted within the class; none for the whole walk.
    pub pose: Option<usize>,
}

/// What a sweep has hit.
pub(super) struct Hits {
    /// For each row along the walk the voxels hit from the first pose, where the walk's length lies before the first
    /// voxel; one more row takes what hits none.
    combs: Vec<u64>,
    comb_words: usize,
    /// A byte for each voxel of the end walls: end and z before w, each in `whole_bits` bits.
    ends: Vec<u8>,
    pub undecided: Vec<Undecided>,
}

impl Hits {
    pub fn new(plan: &Plan, poses: usize) -> Self {
        let comb_words = (plan.size.cells_u + plan.comb_step * (poses - 1)).div_ceil(64);
        Self {
            combs: vec![0; (plan.size.rows() + 1) * comb_words],
            comb_words,
            ends: vec![0; 1 << (2 * plan.whole_bits)],
            undecided: Vec::new(),
        }
    }

    /// Marks all of it on a shell.
    pub fn mark(&mut self, plan: &Plan, poses: usize, shell: &mut Shell) {
        let size = &plan.size;
        let walk = plan.comb_step * (poses - 1);
        let (skip, shift) = (walk / 64, walk % 64);
        let mut seen = vec![0; size.cells_u.div_ceil(64)];
        let spare = seen.len() * 64 - size.cells_u;
        for row in 0..size.rows() {
            let comb = &mut self.combs[row * self.comb_words..][..self.comb_words];
            if comb.iter().all(|word| *word == 0) {
                continue;
            }
            spread(comb, plan.comb_step, poses);
            for (word, seen) in seen.iter_mut().enumerate() {
                let low = comb.get(skip + word).copied().unwrap_or(0);
                let high = comb.get(skip + word + 1).copied().unwrap_or(0);
                *seen = if shift == 0 { low } else { low >> shift | high << (64 - shift) };
            }
            if let Some(last) = seen.last_mut() {
                *last = *last << spare >> spare;
            }
            shell.mark_row(row, &seen);
        }
        let mut seen = vec![0; size.cells_w.div_ceil(64)];
        for end in 0..2 {
            for z in 0..size.cells_z {
                let at = (end << (plan.whole_bits - 1) | z) << plan.whole_bits;
                let bytes = &self.ends[at..][..size.cells_w];
                for (word, bytes) in seen.iter_mut().zip(bytes.chunks(64)) {
                    *word = bytes.iter().rev().fold(0, |bits, byte| bits << 1 | u64::from(*byte));
                }
                shell.mark_end_row(end, z, &seen);
            }
        }
    }
}

/// Repeats every bit `times` times, `step` bits apart.
fn spread(bits: &mut [u64], step: usize, times: usize) {
    let mut done = 1;
    while done < times {
        let more = done.min(times - done);
        or_shifted(bits, more * step);
        done += more;
    }
}

/// `bits |= bits << shift`.
fn or_shifted(bits: &mut [u64], shift: usize) {
    let (skip, shift) = (shift / 64, shift % 64);
    for word in (skip..bits.len()).rev() {
        let low = bits[word - skip];
        let carried = if shift != 0 && word > skip { bits[word - skip - 1] >> (64 - shift) } else { 0 };
        bits[word] |= low << shift | carried;
    }
}

/// Sweeps a range of azimuths with the widest instructions that this processor has.
pub(super) fn run(plan: &Plan, view: &View, columns: Range<usize>, hits: &mut Hits) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
        {
            // SAFETY: the processor has these instructions
            return unsafe { run_avx512(plan, view, columns, hits) };
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has these instructions
            return unsafe { run_avx2(plan, view, columns, hits) };
        }
    }
    run_anywhere(plan, view, columns, hits);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
fn run_avx512(plan: &Plan, view: &View, columns: Range<usize>, hits: &mut Hits) {
    run_anywhere(plan, view, columns, hits);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2(plan: &Plan, view: &View, columns: Range<usize>, hits: &mut Hits) {
    run_anywhere(plan, view, columns, hits);
}

#[inline(always)]
fn run_anywhere(plan: &Plan, view: &View, columns: Range<usize>, hits: &mut Hits) {
    for azimuth in columns {
        let (sines, cosines) = (&plan.elevations[0], &plan.elevations[1]);
        let blocks = sines.as_chunks::<LANES>().0.iter().zip(cosines.as_chunks::<LANES>().0);
        for (block, (sines, cosines)) in blocks.enumerate() {
            let mut rays = aim(plan, view, plan.azimuths[azimuth], sines, cosines);
            if rays.left.iter().any(|left| *left != 0) {
                leave(view, &mut rays, azimuth, block, hits);
            }
            let comb_words = hits.comb_words;
            for lane in 0..LANES {
                let bit = rays.bit[lane] as usize;
                let word = rays.row[lane] as usize * comb_words + bit / 64;
                hits.combs[word] |= 1 << (bit % 64);
            }
            walk_ends(plan, view, &mut rays, azimuth, block, hits);
        }
    }
}

/// A block of rays of one column.
struct Rays {
    /// Row along the walk that a ray hits, and where on it from the first pose.
    row: [u32; LANES],
    bit: [u32; LANES],
    /// Poses from which it hits an end wall, and its way over that wall in fixed point.
    ends: [u32; LANES],
    w: [u32; LANES],
    w_step: [u32; LANES],
    z: [u32; LANES],
    z_step: [u32; LANES],
    /// 1: lost; 2: left to the definition.
    left: [u32; LANES],
}

const LOST: u32 = 1;
const UNDECIDED: u32 = 2;

#[inline(always)]
fn aim(plan: &Plan, view: &View, azimuth: [f64; 2], sines: &[f64; LANES], cosines: &[f64; LANES]) -> Rays {
    let zeros = [0; LANES];
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
    let [sin_azimuth, cos_azimuth] = azimuth;
    let [row_u, row_w, row_z] = view.rows;
    let [u0, w0, z0] = view.origin;
    let cells = [plan.size.cells_u as f64, plan.size.cells_w as f64, plan.size.cells_z as f64];
    let step = plan.comb_step as f64;
    let per_step = 1.0 / step;
    let poses = view.poses as f64;
    let walk = step * (poses - 1.0);
    let dump_row = plan.size.rows() as f64;
    let fraction_bits = 32 - plan.whole_bits;
    let one = (1u64 << fraction_bits) as f64;
    let other_end = (1u64 << (plan.whole_bits - 1)) as f64;
    let guard = fixed_guard(view.poses) as f64 / one;
    for lane in 0..LANES {
        let local = [cosines[lane] * cos_azimuth, cosines[lane] * sin_azimuth, sines[lane]];
        let du = row_u[0] * local[0] + row_u[1] * local[1] + row_u[2] * local[2];
        let dw = row_w[0] * local[0] + row_w[1] * local[1] + row_w[2] * local[2];
        let dz = row_z[0] * local[0] + row_z[1] * local[1] + row_z[2] * local[2];
        let least = du.abs().min(dw.abs()).min(dz.abs());
        let to_w = (if dw > 0.0 { cells[1] - w0 } else { w0 }) / dw.abs();
        let to_z = (if dz > 0.0 { cells[2] - z0 } else { z0 }) / dz.abs();
        let hits_side = to_w < to_z;
        let distance = if hits_side { to_w } else { to_z };
        let far = walk + cells[0] + 8.0;
        let along = (u0 + du * distance).max(-far).min(far);
        let across = if hits_side { z0 + dz * distance } else { w0 + dw * distance };
        let across = across.max(-far).min(far);
        let cell_along = along.floor();
        let off_along = (along - (along + 0.5).floor()).abs();
        let off_across = (across - (across + 0.5).floor()).abs();
        let near_face = off_along.min(off_across) < GUARD;
        let is_lost = least == 0.0;
        let is_left = is_lost | (least <= view.tiny) | near_face;
        rays.left[lane] = if is_lost & (view.tiny == 0.0) {
            LOST
        } else if is_left {
            UNDECIDED
        } else {
            0
        };
        let side_row = 2.0 * cells[1] + if dw > 0.0 { cells[2] } else { 0.0 } + across.floor();
        let level_row = (if dz > 0.0 { cells[1] } else { 0.0 }) + across.floor();
        let on_row = (cell_along >= -walk) & (cell_along < cells[0]) & !is_left;
        let row = if hits_side { side_row } else { level_row };
        rays.row[lane] = low_bits(if on_row { row } else { dump_row });
        rays.bit[lane] = low_bits(if on_row { cell_along + walk } else { 0.0 });
        // poses before the row begins, or after it ends: half a voxel keeps the quotient off whole numbers
        let forward = du > 0.0;
        let short = ((cells[0] - cell_along - 0.5) * per_step).ceil().max(0.0).min(poses);
        let before = ((-cell_along - 0.5) * per_step).ceil().max(0.0).min(poses);
        let ends = if forward { poses - short } else { before };
        rays.ends[lane] = low_bits(if is_left { 0.0 } else { ends });
        let per_u = 1.0 / du.abs();
        let (w_slope, z_slope) = (dw * per_u, dz * per_u);
        let start = if forward { view.to_end[1] } else { view.to_end[0] };
        let end = if forward { other_end } else { 0.0 };
        rays.w[lane] = low_bits((w0 + w_slope * start + guard) * one);
        rays.z[lane] = low_bits((z0 + z_slope * start + guard + end) * one);
        rays.w_step[lane] = low_bits(w_slope * step * one);
        rays.z_step[lane] = low_bits(z_slope * step * one);
    }
    rays
}

/// The nearest whole number, modulo 2^32.
#[inline(always)]
fn low_bits(value: f64) -> u32 {
    (value + TO_WHOLE).to_bits() as u32
}

/// How far a fixed-point place may be off, in its last bits: half a bit at the start and at each step, and the start's
/// own f64 rounding.
#[inline(always)]
fn fixed_guard(poses: usize) -> u32 {
    poses as u32 / 2 + 3
}

#[cold]
fn leave(view: &View, rays: &mut Rays, azimuth: usize, block: usize, hits: &mut Hits) {
    for lane in 0..LANES {
        // the last block may repeat the last beam: deciding it twice changes nothing
        if rays.left[lane] == UNDECIDED {
            let beam = block * LANES + lane;
            hits.undecided.push(Undecided { azimuth, beam, pose: None });
        }
    }
    debug_assert!(view.poses > 0);
}

#[inline(always)]
fn walk_ends(plan: &Plan, view: &View, rays: &mut Rays, azimuth: usize, block: usize, hits: &mut Hits) {
    let longest = rays.ends.iter().copied().fold(0, u32::max);
    let fraction_bits = 32 - plan.whole_bits;
    let near = (2 * fixed_guard(view.poses)) << plan.whole_bits;
    let nowhere = (plan.size.cells_z as u32) << plan.whole_bits;
    for step in 0..longest {
        let mut place = [0u32; LANES];
        let mut is_near = [0u32; LANES];
        for lane in 0..LANES {
            let (w, z) = (rays.w[lane], rays.z[lane]);
            let live = step < rays.ends[lane];
            let fraction = (w << plan.whole_bits).min(z << plan.whole_bits);
            is_near[lane] = u32::from(live & (fraction < near));
            let at = (z >> fraction_bits) << plan.whole_bits | w >> fraction_bits;
            place[lane] = if live { at } else { nowhere };
            rays.w[lane] = w.wrapping_add(rays.w_step[lane]);
            rays.z[lane] = z.wrapping_add(rays.z_step[lane]);
        }
        if is_near.iter().fold(0, |any, near| any | near) != 0 {
            leave_step(plan, view, rays, step, (azimuth, block), (&is_near, &mut place), hits);
        }
        for at in place {
            hits.ends[at as usize] = 1;
        }
    }
}

#[cold]
#[inline(never)]
fn leave_step(
    plan: &Plan,
    view: &View,
    rays: &Rays,
    step: u32,
    (azimuth, block): (usize, usize),
    (is_near, place): (&[u32; LANES], &mut [u32; LANES]),
    hits: &mut Hits,
) {
    for lane in (0..LANES).filter(|lane| is_near[*lane] != 0) {
        let is_other_end = place[lane] >> (2 * plan.whole_bits - 1) != 0;
        let pose = if is_other_end { view.poses - 1 - step as usize } else { step as usize };
        place[lane] = (plan.size.cells_z as u32) << plan.whole_bits;
        hits.undecided.push(Undecided { azimuth, beam: block * LANES + lane, pose: Some(pose) });
    }
    debug_assert!(rays.ends.iter().any(|ends| step < *ends));
}
