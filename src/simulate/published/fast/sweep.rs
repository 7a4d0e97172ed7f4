//! The inner loops: plain arithmetic over blocks of lanes, compiled once for each instruction set.

use std::ops::Range;

use super::{Plan, axes};
use crate::coverage::Counts;
use crate::simulate::published::shell::{Shell, joined};
use crate::simulate::published::{Phase, Placement, Simulator, brute};

/// Beams that are worked on side by side.
pub(super) const LANES: usize = 16;

/// How near to a voxel's face, in voxels, the definition decides.
const GUARD: f64 = 1e-9;

/// How small a component of a direction the definition decides on, where rounding may turn it into zero or back.
const TINY: f64 = 1e-12;

/// Adding this leaves the nearest whole number in the low bits of an f64 (1.5 * 2^52).
const TO_WHOLE: f64 = 6_755_399_441_055_744.0;

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
    /// Sine and cosine of what is added to every azimuth.
    turn: [f64; 2],
    /// Whether rays with a zero component are simply lost.
    loses: bool,
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
            is_mirrored,
            class,
            turn: plan.turns[class],
            loses: preset.loses_axis_parallel_rays
                && simulator.experiment.phase == Phase::Locked
                && !is_mirrored,
        }
    }
}

/// A ray, or one pose of it, that the definition must decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Undecided {
    pub class: usize,
    pub azimuth: usize,
    pub beam: usize,
    /// Counted within the class; none for the whole walk.
    pub pose: Option<usize>,
}

/// What a sweep has hit.
struct Hits {
    /// For each row along the walk the voxels hit from the first pose, where the walk's length lies before the first
    /// voxel; one more row takes what hits none. The first word of every row comes before the second word of any.
    combs: Vec<u64>,
    /// Rows and the one more.
    stride: usize,
    /// A byte for each voxel of the end walls: end and z before w, each in `whole_bits` bits.
    ends: Vec<u8>,
    undecided: Vec<Undecided>,
}

impl Hits {
    fn new(plan: &Plan, poses: usize) -> Self {
        let comb_words = (plan.size.cells_u + plan.comb_step * (poses - 1)).div_ceil(64);
        let stride = plan.size.rows() + 1;
        Self {
            combs: vec![0; stride * comb_words],
            stride,
            ends: vec![0; 1 << (2 * plan.whole_bits)],
            undecided: Vec::new(),
        }
    }

    /// Marks all of it on a shell.
    #[inline(always)]
    fn mark(&mut self, plan: &Plan, poses: usize, shell: &mut Shell) {
        let size = &plan.size;
        spread(&mut self.combs, self.stride, plan.comb_step, poses);
        let walk = plan.comb_step * (poses - 1);
        let (skip, shift) = (walk / 64, (walk % 64) as u32);
        let words = size.cells_u.div_ceil(64);
        let none = vec![0; self.stride];
        for word in 0..words {
            let mask = if word + 1 == words { u64::MAX >> (words * 64 - size.cells_u) } else { u64::MAX };
            let mut rows = self.combs.chunks_exact(self.stride).skip(skip + word);
            let low = rows.next().unwrap_or(&none);
            let high = rows.next().unwrap_or(&none);
            for ((seen, low), high) in shell.row_words_mut(word).iter_mut().zip(low).zip(high) {
                *seen |= joined(*low, *high, shift) & mask;
            }
        }
        for end in 0..2 {
            for z in 0..size.cells_z {
                let at = (end << (plan.whole_bits - 1) | z) << plan.whole_bits;
                let bytes = &self.ends[at..][..size.cells_w.next_multiple_of(8)];
                for (eight, bytes) in bytes.as_chunks::<8>().0.iter().enumerate() {
                    // gathers the lowest bits of eight bytes in the uppermost byte
                    let bits = u64::from_le_bytes(*bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56;
                    shell.end_row_mut(end, z)[eight / 8] |= bits << (eight % 8 * 8);
                }
            }
        }
    }
}

/// Repeats every bit of every row `times` times, `step` bits apart. The words of a row are `stride` apart.
#[inline(always)]
fn spread(words: &mut [u64], stride: usize, step: usize, times: usize) {
    let mut done = 1;
    while done < times {
        let more = done.min(times - done);
        let (skip, shift) = (more * step / 64, (more * step % 64) as u32);
        for word in (skip..words.len() / stride).rev() {
            let (below, rows) = words.split_at_mut(word * stride);
            if skip == 0 {
                let carried = below.chunks_exact(stride).next_back();
                match carried {
                    Some(carried) => {
                        for (row, carried) in rows[..stride].iter_mut().zip(carried) {
                            *row |= joined(*carried, *row, 64 - shift);
                        }
                    }
                    None => rows[..stride].iter_mut().for_each(|row| *row |= *row << shift),
                }
                continue;
            }
            let from = &below[(word - skip) * stride..][..stride];
            if word == skip {
                for (row, from) in rows[..stride].iter_mut().zip(from) {
                    *row |= from << shift;
                }
            } else {
                let carried = &below[(word - skip - 1) * stride..][..stride];
                for ((row, from), carried) in rows[..stride].iter_mut().zip(from).zip(carried) {
                    *row |= if shift == 0 { *from } else { joined(*carried, *from, 64 - shift) };
                }
            }
        }
        done += more;
    }
}

/// Sweeps ranges of azimuths with the widest instructions that this processor has, and marks what is decided. All
/// views have equally many poses.
pub(super) fn run(
    plan: &Plan,
    views: &[View],
    columns: &[Range<usize>],
    shell: &mut Shell,
) -> Vec<Undecided> {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("popcnt")
        {
            // SAFETY: the processor has these instructions
            return unsafe { run_avx512(plan, views, columns, shell) };
        }
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("popcnt")
        {
            // SAFETY: the processor has these instructions
            return unsafe { run_avx2(plan, views, columns, shell) };
        }
    }
    run_anywhere::<false>(plan, views, columns, shell)
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
    let ([sin, cos], [sin_turn, cos_turn]) = (plan.azimuths[azimuth], view.turn);
    let turned = [sin * cos_turn + cos * sin_turn, cos * cos_turn - sin * sin_turn];
    // at 0 and 180 degrees whole columns have a component that is zero or nearly so
    let is_exact = view.loses && !view.is_mirrored && (azimuth == 0 || 2 * azimuth == plan.azimuths.len());
    let (sines, cosines) = (&plan.elevations[0], &plan.elevations[1]);
    let blocks = sines.as_chunks::<LANES>().0.iter().zip(cosines.as_chunks::<LANES>().0);
    for (block, (sines, cosines)) in blocks.enumerate() {
        let directions = if is_exact {
            exact_directions(view, plan.azimuths[azimuth], sines, cosines)
        } else {
            directions::<FUSED>(view, turned, sines, cosines)
        };
        let tiny = if is_exact { 0.0 } else { TINY };
        let rays = aim::<FUSED>(plan, view, &directions, tiny);
        if rays.left.iter().fold(0, |any, left| any | left) != 0 {
            leave(plan, view, &rays, azimuth, block, hits);
        }
        for lane in 0..LANES {
            let bit = rays.bit[lane] as usize;
            hits.combs[rays.row[lane] as usize + bit / 64 * stride] |= 1 << (bit % 64);
        }
        walk_ends(plan, view, &rays, azimuth, block, hits);
    }
}

/// World directions of a block of beams: u, w, z.
type Directions = [[f64; LANES]; 3];

/// In the order of operations of the definition, so that what is zero there is zero here.
#[inline(never)]
fn exact_directions(
    view: &View,
    azimuth: [f64; 2],
    sines: &[f64; LANES],
    cosines: &[f64; LANES],
) -> Directions {
    let [sin_azimuth, cos_azimuth] = azimuth;
    view.rows.map(|row| {
        std::array::from_fn(|lane| {
            let local = [cosines[lane] * cos_azimuth, cosines[lane] * sin_azimuth, sines[lane]];
            row[0] * local[0] + row[1] * local[1] + row[2] * local[2]
        })
    })
}

#[inline(always)]
fn directions<const FUSED: bool>(
    view: &View,
    azimuth: [f64; 2],
    sines: &[f64; LANES],
    cosines: &[f64; LANES],
) -> Directions {
    let [sin_azimuth, cos_azimuth] = azimuth;
    let mut directions = [[0.0; LANES]; 3];
    for (row, values) in view.rows.iter().zip(&mut directions) {
        let level = row[0] * cos_azimuth + row[1] * sin_azimuth;
        for lane in 0..LANES {
            values[lane] = fused::<FUSED>(cosines[lane], level, row[2] * sines[lane]);
        }
    }
    directions
}

/// `a * b + c`, in one instruction where there is one.
#[inline(always)]
fn fused<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// The smaller of two numbers, neither of them NaN: one instruction, where `f64::min` asks for NaN first.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
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
fn aim<const FUSED: bool>(plan: &Plan, view: &View, directions: &Directions, tiny: f64) -> Rays {
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
    for lane in 0..LANES {
        let [du, dw, dz] = [directions[0][lane], directions[1][lane], directions[2][lane]];
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
        rays.left[lane] = if is_lost {
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
        rays.row[lane] = low_bits(if on_row { face + cell_across } else { dump_row });
        rays.bit[lane] = low_bits(if on_row { cell_along + walk } else { 0.0 });
        // poses before the row begins, or after it ends: half a voxel keeps the quotient off whole numbers
        let forward = du > 0.0;
        let beyond = if forward { cell_along + walk + 0.5 - cells[0] } else { -cell_along - 0.5 };
        let ends = smaller(greater((beyond * per_step).ceil(), 0.0), poses);
        rays.ends[lane] = low_bits(if is_left { 0.0 } else { ends });
        let per_u = size_wz * per_all;
        let (w_slope, z_slope) = (dw * per_u, dz * per_u);
        let start = if forward { to_end[1] } else { to_end[0] };
        let z_start = if forward { z_starts[1] } else { z_starts[0] };
        rays.w[lane] = fused::<FUSED>(w_slope, start, w_start).to_bits() as u32;
        rays.z[lane] = fused::<FUSED>(z_slope, start, z_start).to_bits() as u32;
        rays.w_step[lane] = fused::<FUSED>(w_slope, step_one, TO_WHOLE).to_bits() as u32;
        rays.z_step[lane] = fused::<FUSED>(z_slope, step_one, TO_WHOLE).to_bits() as u32;
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
    for lane in (0..LANES).filter(|lane| rays.left[*lane] == UNDECIDED) {
        hits.undecided.push(Undecided {
            class: view.class,
            azimuth,
            beam: plan.beam(block, lane),
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
        let mut place = [0u32; LANES];
        let mut any_near = 0;
        for lane in 0..LANES {
            let live = step < ends[lane];
            let fraction = (w[lane] << whole_bits).min(z[lane] << whole_bits);
            any_near |= u32::from(live & (fraction < near));
            let at = (z[lane] >> fraction_bits) << whole_bits | w[lane] >> fraction_bits;
            place[lane] = if live { at } else { nowhere };
        }
        if any_near != 0 {
            for lane in 0..LANES {
                let fraction = (w[lane] << whole_bits).min(z[lane] << whole_bits);
                if step < ends[lane] && fraction < near {
                    let is_other_end = place[lane] >> (2 * whole_bits - 1) != 0;
                    let pose = if is_other_end { view.poses - 1 - step as usize } else { step as usize };
                    place[lane] = nowhere;
                    let beam = plan.beam(block, lane);
                    hits.undecided.push(Undecided { class: view.class, azimuth, beam, pose: Some(pose) });
                }
            }
        }
        for at in place {
            // SAFETY: both halves of a place are what is left of 32 bits after a shift by 32 - whole_bits (the lanes
            // that mark nothing use a z that has as many bits), and there is a byte for every such number
            unsafe { *marks.get_unchecked_mut(at as usize) = 1 };
        }
        for lane in 0..LANES {
            w[lane] = w[lane].wrapping_add(w_step[lane]);
            z[lane] = z[lane].wrapping_add(z_step[lane]);
        }
    }
}

/// How many voxels settled shells of one size have marked.
pub(in crate::simulate::published) fn counts(shells: &[Shell]) -> Counts {
    let bitmaps: Vec<_> = shells.iter().map(Shell::words).collect();
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("popcnt") {
        // SAFETY: the processor has this instruction
        return unsafe { counts_popcnt(&bitmaps) };
    }
    Counts::of_bitmaps(&bitmaps)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "popcnt")]
fn counts_popcnt(bitmaps: &[&[u64]]) -> Counts {
    Counts::of_bitmaps(bitmaps)
}
