//! Any poses, no structure of a path: every ray of every pose on its own, in blocks of lanes.
//!
//! Exact by a guard, as the fast way: a ray whose hit lies so near to a voxel's face that rounding could decide is left
//! to the definition (`brute.rs`). The f64 arithmetic up to a hit is off by less than 1e-11 voxel; places on a face are
//! then cut to 32-bit fixed point, and the guard covers that cut.
#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them
#![allow(clippy::needless_range_loop)] // lanes of several arrays side by side become vector instructions

use super::lanes::{LANES, TINY, TO_WHOLE, exact_directions, fused, greater, smaller};
use super::{BoxPose, Simulator, brute};
use crate::instructions::{Instructions, Level};

/// How far a fixed-point place may be off, in its last bits: half a bit at the start and half a bit at the end.
const GUARD: u32 = 2;

/// Bits that tell the six faces apart.
const FACE_BITS: u32 = 3;

/// What is prepared once per experiment.
#[derive(Clone, Debug)]
pub(super) struct Faces {
    /// Cells of the grid.
    cells: [usize; 3],
    /// Bits of a number of a cell along any edge.
    cell_bits: u32,
    /// Sine and cosine of every azimuth of a pattern that has not turned.
    azimuths: Vec<(f64, f64)>,
    /// Sines and cosines of the elevations, filled up to whole blocks with the last beam.
    elevations: [Vec<f64>; 2],
    beams: usize,
}

impl Faces {
    /// None where the numbers would not fit: extremely many voxels.
    pub fn new(simulator: &Simulator) -> Option<Self> {
        let most = *simulator.cells.iter().max()?;
        let cell_bits = usize::BITS - (most - 1).leading_zeros();
        let beams = simulator.elevations.len();
        let padded = beams.next_multiple_of(LANES);
        let column =
            |part: usize| (0..padded).map(|at| simulator.elevations[at.min(beams - 1)][part]).collect();
        let azimuths = (0..simulator.experiment.azimuths)
            .map(|azimuth| brute::azimuth_rad(simulator, 0.0, azimuth).sin_cos())
            .collect();
        (cell_bits <= 11).then_some(Self {
            cells: simulator.cells,
            cell_bits,
            azimuths,
            elevations: [column(0), column(1)],
            beams,
        })
    }

    /// Bits of the second place of a mark, which holds the face too.
    fn second_bits(&self) -> u32 {
        self.cell_bits + FACE_BITS
    }

    fn marks(&self) -> usize {
        1 << (self.cell_bits + self.second_bits())
    }

    /// Bitmap over the whole grid of what is marked.
    fn bitmap(&self, marks: &[u8]) -> Vec<u64> {
        let [nx, ny, nz] = self.cells;
        let mut bitmap = vec![0u64; (nx * ny * nz).div_ceil(64)];
        for face in 0..6 {
            let (axis, side) = (face / 2, face % 2);
            let [first, second] = others(axis);
            let mut cell = [0; 3];
            cell[axis] = side * (self.cells[axis] - 1);
            for b in 0..self.cells[second] {
                cell[second] = b;
                let row = &marks[((face << self.cell_bits) + b) << self.cell_bits..][..self.cells[first]];
                for (eight, bytes) in row.chunks(8).enumerate() {
                    let mut padded = [0; 8];
                    padded[..bytes.len()].copy_from_slice(bytes);
                    let mut seen = u64::from_le_bytes(padded);
                    while seen != 0 {
                        cell[first] = 8 * eight + seen.trailing_zeros() as usize / 8;
                        seen &= seen - 1;
                        let index = cell[0] + nx * (cell[1] + ny * cell[2]);
                        bitmap[index / 64] |= 1 << (index % 64);
                    }
                }
            }
        }
        bitmap
    }
}

/// The axes that span a face: x and y of floor and ceiling, x or y and z of a wall.
fn others(axis: usize) -> [usize; 2] {
    [[1, 2], [0, 2], [0, 1]][axis]
}

/// Bitmap of what a sensor sees from poses, and the number of rays that the quirk lost.
pub(super) fn see(
    simulator: &Simulator,
    faces: &Faces,
    poses: &[BoxPose],
    instructions: Instructions,
) -> (Vec<u64>, u64) {
    let mut marks = vec![0_u8; faces.marks()];
    let loses = simulator.loses();
    let mut left = Left::default();
    for pose in poses {
        let view = View::new(simulator, faces, pose, loses);
        match instructions.level() {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx512 => unsafe { sweep_avx512(faces, &view, &mut marks, &mut left) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx2 => unsafe { sweep_avx2(faces, &view, &mut marks, &mut left) },
            _ => sweep::<false>(faces, &view, &mut marks, &mut left),
        }
        left.ends.push(left.rays.len());
    }
    let mut bitmap = faces.bitmap(&marks);
    let mut start = 0;
    for (pose, end) in poses.iter().zip(&left.ends) {
        for (azimuth, beam) in &left.rays[start..*end] {
            let direction = brute::direction(simulator, pose, *azimuth, *beam);
            match brute::voxel(simulator, pose.origin_m, direction) {
                Some(index) => bitmap[index / 64] |= 1 << (index % 64),
                None => left.lost += 1,
            }
        }
        start = *end;
    }
    (bitmap, left.lost)
}

/// What only the definition can decide.
#[derive(Default)]
struct Left {
    /// How many rays the quirk lost.
    lost: u64,
    /// Azimuth and beam.
    rays: Vec<(usize, usize)>,
    /// Where each pose's rays end.
    ends: Vec<usize>,
}

/// One pose seen from the voxel grid: lengths in voxels from the box's least corner.
struct View<'a> {
    rows: [[f64; 3]; 3],
    simulator: &'a Simulator,
    /// What is added to every azimuth, in steps.
    turn: f64,
    /// The same as an angle's sine and cosine.
    turn_sin_cos: (f64, f64),
    /// What a direction is multiplied with to get the share of the way to the face at 0 and at the far end.
    per_face: [[f64; 2]; 3],
    /// Shares below this belong to components that rounding may turn into zero or back.
    tiny: f64,
    /// Origin in fixed point, ready to be added.
    starts: [f64; 3],
    /// The same of the second place, with the face's number, by axis and side.
    second_starts: [[f64; 2]; 3],
    /// One voxel in fixed point, of the first and the second place.
    ones: [f64; 2],
    /// Whether rays with a zero component are lost.
    loses: bool,
}

impl<'a> View<'a> {
    fn new(simulator: &'a Simulator, faces: &Faces, pose: &BoxPose, loses: bool) -> Self {
        let (preset, voxel_m) = (&simulator.experiment.preset, simulator.experiment.voxel_m);
        let origin = [0, 1, 2].map(|axis| (pose.origin_m[axis] - preset.box_min_m[axis]) / voxel_m);
        let ones = [faces.cell_bits, faces.second_bits()].map(|bits| (1_u64 << (32 - bits)) as f64);
        let guard = f64::from(GUARD);
        let turn_rad = brute::azimuth_rad(simulator, pose.turn, 0);
        let per_face =
            [0, 1, 2].map(|axis| [-1.0 / origin[axis], 1.0 / (faces.cells[axis] as f64 - origin[axis])]);
        Self {
            rows: pose.rows,
            simulator,
            turn: pose.turn,
            turn_sin_cos: turn_rad.sin_cos(),
            per_face,
            tiny: TINY * per_face.iter().flatten().fold(0.0, |most, share| greater(most, share.abs())),
            starts: origin.map(|at| at * ones[0] + guard + TO_WHOLE),
            second_starts: [0, 1, 2].map(|axis| {
                let at = origin[others(axis)[1]];
                [0, 1].map(|side| {
                    let face = ((2 * axis + side) << faces.cell_bits) as f64;
                    (at + face) * ones[1] + guard + TO_WHOLE
                })
            }),
            ones,
            loses,
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma")]
fn sweep_avx512(faces: &Faces, view: &View<'_>, marks: &mut [u8], left: &mut Left) {
    sweep::<true>(faces, view, marks, left);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn sweep_avx2(faces: &Faces, view: &View<'_>, marks: &mut [u8], left: &mut Left) {
    sweep::<true>(faces, view, marks, left);
}

#[inline(always)]
fn sweep<const FUSED: bool>(faces: &Faces, view: &View<'_>, marks: &mut [u8], left: &mut Left) {
    let (sines, cosines) = (&faces.elevations[0], &faces.elevations[1]);
    assert!(marks.len() == faces.marks(), "a byte for every place");
    let mut lifts: [Vec<f64>; 3] = Default::default();
    for (lift, row) in lifts.iter_mut().zip(&view.rows) {
        lift.extend(sines.iter().map(|sine| row[2] * sine));
    }
    let (sin_turn, cos_turn) = view.turn_sin_cos;
    for (azimuth, (sin, cos)) in faces.azimuths.iter().enumerate() {
        let (sin, cos) = (sin * cos_turn + cos * sin_turn, cos * cos_turn - sin * sin_turn);
        let levels = view.rows.map(|row| row[0] * cos + row[1] * sin);
        // a column with a component that is zero or nearly so for every beam
        let is_flat = |axis: usize| levels[axis].abs() < 1e-9 && view.rows[axis][2].abs() < 1e-9;
        let is_exact = view.loses && (is_flat(0) || is_flat(1) || is_flat(2));
        let exact_azimuth = if is_exact {
            brute::azimuth_rad(view.simulator, view.turn, azimuth).sin_cos()
        } else {
            (sin, cos)
        };
        let blocks = sines.as_chunks::<LANES>().0.iter().zip(cosines.as_chunks::<LANES>().0);
        for (block, (sines, cosines)) in blocks.enumerate() {
            let lift = |axis: usize| &lifts[axis].as_chunks::<LANES>().0[block];
            let lifts = [lift(0), lift(1), lift(2)];
            let rays = if is_exact {
                let directions = exact_directions(&view.rows, exact_azimuth.into(), sines, cosines);
                aim::<FUSED, true>(faces, view, |axis, lane| directions[axis][lane])
            } else {
                aim::<FUSED, false>(faces, view, |axis, lane| {
                    fused::<FUSED>(cosines[lane], levels[axis], lifts[axis][lane])
                })
            };
            if !rays.are_done() {
                leave(&rays, azimuth, block, faces.beams, left);
            }
            for place in rays.place {
                // SAFETY: both halves of a place are what is left of 32 bits after shifts to as many bits as there
                // are bytes for
                unsafe { *marks.get_unchecked_mut(place as usize) = 1 };
            }
        }
    }
}

/// A block of rays of one column.
#[repr(align(64))] // so that no vector of it lies across two lines of the cache
struct Rays {
    /// Byte to mark.
    place: [u32; LANES],
    /// The lesser of both places' fractions of a cell.
    fraction: [u32; LANES],
    /// Fractions up to this are left to the definition.
    near: u32,
    /// A bit for each ray that is lost.
    lost: u32,
}

#[inline(always)]
fn aim<const FUSED: bool, const EXACT: bool>(
    faces: &Faces,
    view: &View<'_>,
    direction: impl Fn(usize, usize) -> f64,
) -> Rays {
    let mut first = [0_u32; LANES];
    let mut second = [0_u32; LANES];
    let [first_one, second_one] = view.ones;
    let tiny = if view.loses && !EXACT { view.tiny } else { f64::NEG_INFINITY };
    // constants in locals, so that a choice between two of them is no load from a chosen place
    let [[x_low, x_high], [y_low, y_high], [z_low, z_high]] = view.per_face;
    let [x_start, y_start, _] = view.starts;
    let [[in_x_low, in_x_high], [in_y_low, in_y_high], [in_z_low, in_z_high]] = view.second_starts;
    for lane in 0..LANES {
        let [dx, dy, dz] = [direction(0, lane), direction(1, lane), direction(2, lane)];
        // share of the way to the face ahead, by axis: the greatest is the face that is hit
        let (sx, sy, sz) = (
            greater(dx * x_low, dx * x_high),
            greater(dy * y_low, dy * y_high),
            greater(dz * z_low, dz * z_high),
        );
        let side_share = greater(sx, sy);
        let (is_level, is_x) = (sz > side_share, sx > sy);
        let way = 1.0 / greater(side_share, sz);
        let is_tiny = smaller(smaller(sx, sy), sz) < tiny;
        let start_x = if dx > 0.0 { in_x_high } else { in_x_low };
        let start_y = if dy > 0.0 { in_y_high } else { in_y_low };
        let start_z = if dz > 0.0 { in_z_high } else { in_z_low };
        let start_side = if is_x { start_x } else { start_y };
        let start_second = if is_level { start_z } else { start_side };
        let d_second = if is_level { dy } else { dz };
        let is_wall_x = is_x & !is_level;
        let (d_first, start_first) =
            (if is_wall_x { dy } else { dx }, if is_wall_x { y_start } else { x_start });
        // a fraction of zero is near a face: left to the definition
        let place = fused::<FUSED>(d_first * way, first_one, start_first);
        first[lane] = if is_tiny { TO_WHOLE } else { place }.to_bits() as u32;
        second[lane] = fused::<FUSED>(d_second * way, second_one, start_second).to_bits() as u32;
    }
    let (first_bits, second_bits) = (faces.cell_bits, faces.second_bits());
    let nowhere = faces.marks() as u32 - 1;
    let mut rays =
        Rays { place: [0; LANES], fraction: [0; LANES], near: (2 * GUARD) << second_bits, lost: 0 };
    for lane in 0..LANES {
        let place = (second[lane] >> (32 - second_bits)) << first_bits | first[lane] >> (32 - first_bits);
        let fraction = least(first[lane] << first_bits, second[lane] << second_bits);
        rays.fraction[lane] = fraction;
        rays.place[lane] = if fraction > rays.near { place } else { nowhere };
    }
    if EXACT {
        for lane in 0..LANES {
            if (0..3).any(|axis| direction(axis, lane) == 0.0) {
                rays.lost |= 1 << lane;
                rays.place[lane] = nowhere;
            }
        }
    }
    rays
}

#[inline(always)]
fn least(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

impl Rays {
    /// Whether every ray is decided.
    #[inline(always)]
    fn are_done(&self) -> bool {
        let mut fraction = self.fraction;
        let mut width = LANES / 2;
        while width > 0 {
            for lane in 0..width {
                fraction[lane] = least(fraction[lane], fraction[lane + width]);
            }
            width /= 2;
        }
        fraction[0] > self.near && self.lost == 0
    }
}

#[cold]
fn leave(rays: &Rays, azimuth: usize, block: usize, beams: usize, left: &mut Left) {
    // the last block repeats the last beam
    for lane in 0..LANES.min(beams - block * LANES) {
        if rays.lost >> lane & 1 == 1 {
            left.lost += 1;
        } else if rays.fraction[lane] <= rays.near {
            left.rays.push((azimuth, block * LANES + lane));
        }
    }
}
