//! The inner loops: plain arithmetic over blocks of elements, compiled once for each instruction set.

#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them
#![allow(clippy::needless_range_loop)] // elements of several arrays side by side become vector instructions

use std::ops::Range;

use super::ends::{Ends, Kind};
use super::view::{FaceView, View};
use super::{Faces, Left};
use crate::base::instructions::{Instructions, Level};
use crate::simulate::published::elements::{WIDTH, exact_directions, fused_f32};

/// Bytes that a sweep marks: every voxel of the faces, and one for what hits none of them.
pub(super) fn marks(faces: &Faces) -> usize {
    faces.voxels() + 1
}

/// What a sweep needs room for, from pose to pose.
pub(super) struct Scratch {
    ends: Ends,
    kinds: Vec<Kind>,
    /// Whether a block has beams in a column that are not decided.
    again: Vec<bool>,
}

impl Scratch {
    pub(crate) fn new(faces: &Faces) -> Self {
        let (kinds, again) = (vec![Kind::default(); faces.columns], vec![false; faces.columns]);
        Self { ends: Ends::new(faces), kinds, again }
    }
}

/// Sweeps all columns of a pose, marks what is decided and leaves the rest.
pub(super) fn run(
    faces: &Faces,
    view: &View<'_>,
    scratch: &mut Scratch,
    marks: &mut [u8],
    left: &mut Left,
    instructions: Instructions,
) {
    assert!(marks.len() == self::marks(faces), "a byte for every place");
    let Scratch { ends, kinds, again } = scratch;
    ends.look(faces, view, instructions);
    for block in 0..faces.ends.len() - 1 {
        ends.kinds(block, kinds);
        let mut block = Block { faces, view, block, levels: &ends.levels, kinds, again, marks, left };
        match instructions.level() {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx512 => unsafe { sweep_avx512(&mut block) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx2 => unsafe { sweep_avx2(&mut block) },
            _ => block.sweep::<false>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma")]
fn sweep_avx512(block: &mut Block<'_>) {
    block.sweep::<true>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn sweep_avx2(block: &mut Block<'_>) {
    block.sweep::<true>();
}

/// A block of beams at one pose.
struct Block<'a> {
    faces: &'a Faces,
    view: &'a View<'a>,
    block: usize,
    levels: &'a [Vec<f32>; 3],
    kinds: &'a [Kind],
    again: &'a mut [bool],
    marks: &'a mut [u8],
    left: &'a mut Left,
}

/// Bytes to mark for a block of beams of one column.
#[repr(align(64))] // so that no vector of it lies across two lines of the cache
#[derive(Clone, Copy)]
struct Places([u32; WIDTH]);

/// Places that wait for their marks: what was stored as one vector is slow to read in parts right afterwards.
struct Waiting {
    places: [Places; WAITING],
    next: usize,
}

const WAITING: usize = 8;

impl Block<'_> {
    /// Marks what the block hits in any column, and leaves to the definition what is not decided.
    #[inline(always)]
    fn sweep<const FUSED: bool>(&mut self) {
        let nowhere = self.marks.len() as u32 - 1;
        let mut waiting = Waiting { places: [Places([nowhere; WIDTH]); WAITING], next: 0 };
        let mut start = 0;
        for run in self.kinds.chunk_by(|a, b| a == b) {
            let columns = start..start + run.len();
            start += run.len();
            let mut may_lose = false;
            for axis in 0..3 {
                if self.view.loses && run[0].may_vanish(axis) {
                    may_lose |= self.may_lose::<FUSED>(axis, columns.clone());
                }
            }
            if !may_lose {
                self.mark_run::<FUSED>(run[0], columns, &mut waiting);
                continue;
            }
            for column in columns {
                self.again[column] = false;
                if !self.lose(column) {
                    self.mark_run::<FUSED>(run[0], column..column + 1, &mut waiting);
                }
            }
        }
        for places in &waiting.places {
            mark(places, self.marks);
        }
        for column in 0..self.kinds.len() {
            if self.again[column] {
                self.look_again::<FUSED>(column);
            }
        }
    }

    #[inline(always)]
    fn mark_run<const FUSED: bool>(&mut self, kind: Kind, columns: Range<usize>, waiting: &mut Waiting) {
        let [begin, end] = kind.faces();
        let faces = [self.view.faces[begin], self.view.faces[end]];
        if begin == end {
            self.mark_faces::<FUSED, false>(faces, columns, waiting);
        } else {
            self.mark_faces::<FUSED, true>(faces, columns, waiting);
        }
    }

    #[inline(always)]
    fn mark_faces<const FUSED: bool, const TWO: bool>(
        &mut self,
        [begin, end]: [FaceView; 2],
        columns: Range<usize>,
        waiting: &mut Waiting,
    ) {
        let nowhere = self.marks.len() as u32 - 1;
        let tangents = &self.faces.tangents.as_chunks::<WIDTH>().0[self.block];
        let mut next = waiting.next;
        let again = &mut self.again[columns.clone()];
        let begin_levels = levels_of(self.levels, &begin, &columns);
        let end_levels = levels_of(self.levels, &end, &columns);
        for at in 0..columns.len() {
            let places = &mut waiting.places[next % WAITING];
            mark(places, self.marks);
            let begin_levels =
                [begin_levels[0][at] * begin.per_distance, begin_levels[1][at], begin_levels[2][at]];
            let end_levels = [end_levels[0][at] * end.per_distance, end_levels[1][at], end_levels[2][at]];
            let mut any = false;
            for element in 0..WIDTH {
                let mut found = place::<FUSED, TWO>(&begin, begin_levels, tangents[element], nowhere);
                if TWO {
                    found = least(found, place::<FUSED, TWO>(&end, end_levels, tangents[element], nowhere));
                }
                places.0[element] = found;
                any |= found == nowhere;
            }
            again[at] = any;
            next += 1;
        }
        waiting.next = next;
    }

    /// Tries all faces in a column, and leaves to the definition what none decides.
    #[inline(always)]
    fn look_again<const FUSED: bool>(&mut self, column: usize) {
        let nowhere = self.marks.len() as u32 - 1;
        let tangents = &self.faces.tangents.as_chunks::<WIDTH>().0[self.block];
        let mut decided = [false; WIDTH];
        for face in self.view.faces {
            let [ahead, first, second] = levels_of(self.levels, &face, &(column..column + 1));
            let levels = [ahead[0] * face.per_distance, first[0], second[0]];
            let mut places = Places([0; WIDTH]);
            for element in 0..WIDTH {
                places.0[element] = place::<FUSED, true>(&face, levels, tangents[element], nowhere);
                decided[element] |= places.0[element] != nowhere;
            }
            mark(&places, self.marks);
        }
        // the last block repeats the last beam
        for (decided, beam) in decided.iter().zip(self.block * WIDTH..self.faces.beams) {
            if !decided {
                self.left.rays.push((column, beam));
            }
        }
    }

    /// Whether a component of a direction is so small in some columns that it may be zero.
    #[inline(always)]
    fn may_lose<const FUSED: bool>(&self, axis: usize, columns: Range<usize>) -> bool {
        let tangents = &self.faces.tangents.as_chunks::<WIDTH>().0[self.block];
        let (slope, tiny) = (self.view.slopes[axis], self.view.tiny[axis]);
        let mut least = [f32::INFINITY; WIDTH];
        for level in &self.levels[axis][columns] {
            for element in 0..WIDTH {
                let size = fused_f32::<FUSED>(tangents[element], slope, *level).abs();
                least[element] = if size < least[element] { size } else { least[element] };
            }
        }
        let mut any = false;
        for element in 0..WIDTH {
            any |= least[element] <= tiny;
        }
        any
    }

    /// Where the quirk loses a ray of a column, counts those and leaves the others to the definition.
    #[cold]
    fn lose(&mut self, column: usize) -> bool {
        let [sines, cosines] = &self.faces.elevations;
        let azimuth = self.faces.azimuth(self.view.simulator, self.view.pose, column);
        let directions = exact_directions(
            &self.view.pose.rows,
            azimuth.into(),
            &sines.as_chunks::<WIDTH>().0[self.block],
            &cosines.as_chunks::<WIDTH>().0[self.block],
        );
        let is_lost = |element: &usize| (0..3).any(|axis| directions[axis][*element] == 0.0);
        // the last block repeats the last beam
        let first = self.block * WIDTH;
        let elements = 0..WIDTH.min(self.faces.beams - first);
        let lost = elements.clone().filter(is_lost).count();
        if lost > 0 {
            self.left.lost += lost as u64;
            self.left.rays.extend(
                elements.filter(|element| !is_lost(element)).map(|element| (column, first + element)),
            );
        }
        lost > 0
    }
}

#[inline(always)]
fn mark(places: &Places, marks: &mut [u8]) {
    for element in 0..WIDTH {
        // SAFETY: every place is one of a mark or `nowhere`, the last of the marks
        unsafe { *marks.get_unchecked_mut(places.0[element] as usize) = 1 };
    }
}

#[inline(always)]
fn least(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

/// What a face has of the directions of some columns at elevation 0.
#[inline(always)]
fn levels_of<'a>(levels: &'a [Vec<f32>; 3], face: &FaceView, columns: &Range<usize>) -> [&'a [f32]; 3] {
    let along = |axis: usize| &levels[axis][columns.clone()];
    [along(face.axes[0]), along(face.axes[1]), along(face.axes[2])]
}

/// Number of the voxel that a ray hits on a face; `nowhere` where it hits none, or might not, or where `IN_FACE` asks
/// whether the ray passes the face by.
#[inline(always)]
fn place<const FUSED: bool, const IN_FACE: bool>(
    face: &FaceView,
    levels: [f32; 3],
    tangent: f32,
    nowhere: u32,
) -> u32 {
    /// Adding this leaves the nearest whole number in the low bits of an f32 (1.5 * 2^23).
    const TO_WHOLE: f32 = 12_582_912.0;
    let bits = |whole: f32| whole.to_bits().wrapping_sub(TO_WHOLE.to_bits());
    let (reach, [first, second]) = face.crossing::<FUSED>(levels, tangent);
    let (whole_first, whole_second) = (first + TO_WHOLE, second + TO_WHOLE);
    let (in_row, row) = (whole_first - TO_WHOLE, whole_second - TO_WHOLE);
    let room = face.room::<FUSED>(reach);
    // false for what is no number
    let mut is_here = (reach > 0.0) & ((first - in_row).abs() < room) & ((second - row).abs() < room);
    if IN_FACE {
        is_here &= (bits(whole_first) < face.cells[0]) & (bits(whole_second) < face.cells[1]);
    }
    let place = bits(fused_f32::<FUSED>(row, face.per_row, whole_first)).wrapping_add(face.base);
    least(if is_here { place } else { nowhere }, nowhere)
}
