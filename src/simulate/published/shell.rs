//! Voxels along the faces of the box, each in exactly one place: rows along the walk on floor, ceiling and both sides,
//! and the two end walls. A few hundred words where the whole grid has thousands.

#![allow(unsafe_code)] // a function compiled for one more instruction is called after the processor was asked for it

use crate::base::instructions::{Instructions, Level};
use crate::world::coverage::Counts;

/// Sizes of a shell; u runs along the walk, w across it, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShellSize {
    pub cells_u: usize,
    pub cells_w: usize,
    pub cells_z: usize,
}

impl ShellSize {
    /// Rows along the walk: floor, ceiling, side at w = 0, side at the maximum w.
    pub(crate) fn rows(&self) -> usize {
        2 * self.cells_w + 2 * self.cells_z
    }

    fn row_words(&self) -> usize {
        self.cells_u.div_ceil(64)
    }

    fn end_words(&self) -> usize {
        self.cells_w.div_ceil(64)
    }

    /// Where row k of an end wall starts among all words.
    fn end_at(&self, end: usize, k: usize) -> usize {
        self.rows() * self.row_words() + (end * self.cells_z + k) * self.end_words()
    }

    /// Where a voxel's bit lies.
    fn place(&self, [u, w, z]: [usize; 3]) -> (usize, usize) {
        let row = if z == 0 {
            w
        } else if z == self.cells_z - 1 {
            self.cells_w + w
        } else if w == 0 {
            2 * self.cells_w + z
        } else if w == self.cells_w - 1 {
            2 * self.cells_w + self.cells_z + z
        } else {
            return (self.end_at(usize::from(u != 0), z) + w / 64, w % 64);
        };
        (u / 64 * self.rows() + row, u % 64)
    }

    /// Which voxel a bit is.
    fn voxel(&self, at: usize, bit: usize) -> [usize; 3] {
        let rows = self.rows();
        let in_rows = rows * self.row_words();
        if at < in_rows {
            let (row, u) = (at % rows, at / rows * 64 + bit);
            let [w, z] = self.row_place(row);
            [u, w, z]
        } else {
            let place = at - in_rows;
            let (end_row, w) = (place / self.end_words(), place % self.end_words() * 64 + bit);
            [end_row / self.cells_z * (self.cells_u - 1), w, end_row % self.cells_z]
        }
    }

    /// w and z of a row along the walk.
    fn row_place(&self, row: usize) -> [usize; 2] {
        match row {
            _ if row < self.cells_w => [row, 0],
            _ if row < 2 * self.cells_w => [row - self.cells_w, self.cells_z - 1],
            _ if row < 2 * self.cells_w + self.cells_z => [0, row - 2 * self.cells_w],
            _ => [self.cells_w - 1, row - 2 * self.cells_w - self.cells_z],
        }
    }
}

/// Which voxels of the shell are seen. Rows along the walk come first, the first word of every row before the second
/// word of any; then the end walls, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shell {
    size: ShellSize,
    words: Vec<u64>,
}

impl Shell {
    pub(crate) fn new(size: ShellSize) -> Self {
        let words = size.end_at(2, 0);
        Self { size, words: vec![0; words] }
    }

    /// The n-th word of every row along the walk.
    pub(crate) fn row_words_mut(&mut self, n: usize) -> &mut [u64] {
        let rows = self.size.rows();
        &mut self.words[n * rows..][..rows]
    }

    /// Row z of an end wall.
    pub(crate) fn end_row_mut(&mut self, end: usize, z: usize) -> &mut [u64] {
        let (at, words) = (self.size.end_at(end, z), self.size.end_words());
        &mut self.words[at..][..words]
    }

    /// Marks one voxel, which must lie on the shell.
    pub(crate) fn mark(&mut self, voxel: [usize; 3]) {
        let (word, bit) = self.size.place(voxel);
        self.words[word] |= 1 << bit;
    }

    /// Moves the voxels along the edges of the box, which belong to two or three faces, to their one place.
    pub(crate) fn settle(&mut self) {
        let size = self.size;
        for end in 0..2 {
            let u = end * (size.cells_u - 1);
            for z in 0..size.cells_z {
                let whole_row = z == 0 || z == size.cells_z - 1;
                for word in 0..size.end_words() {
                    let last_w = size.cells_w - 1;
                    let mut edges = if whole_row { u64::MAX } else { 0 };
                    if word == 0 {
                        edges |= 1;
                    }
                    if word == last_w / 64 {
                        edges |= 1 << (last_w % 64);
                    }
                    let at = size.end_at(end, z) + word;
                    let moved = self.words[at] & edges;
                    self.words[at] &= !edges;
                    for bit in ones(moved) {
                        self.mark([u, word * 64 + bit, z]);
                    }
                }
            }
        }
        let rows = size.rows();
        for (side, w) in [(0, 0), (1, size.cells_w - 1)] {
            for (z, level) in [(0, 0), (size.cells_z - 1, size.cells_w)] {
                let from = 2 * size.cells_w + side * size.cells_z + z;
                for word in 0..size.row_words() {
                    let bits = std::mem::take(&mut self.words[word * rows + from]);
                    self.words[word * rows + level + w] |= bits;
                }
            }
        }
    }

    /// Adds what another shell of the same size has seen.
    pub(crate) fn join(&mut self, other: &Self) {
        for (word, bits) in self.words.iter_mut().zip(&other.words) {
            *word |= bits;
        }
    }

    /// The mirror image along the walk (`along`) or across it, of a settled shell.
    pub(crate) fn mirrored(&self, along: bool) -> Self {
        let size = self.size;
        let (rows, row_words, end_words) = (size.rows(), size.row_words(), size.end_words());
        let mut image = Self::new(size);
        if along {
            let spare = (row_words * 64 - size.cells_u) as u32;
            for word in 0..row_words {
                let low = &self.words[(row_words - 1 - word) * rows..][..rows];
                let to = &mut image.words[word * rows..][..rows];
                if word + 1 < row_words {
                    let high = &self.words[(row_words - 2 - word) * rows..][..rows];
                    for ((to, low), high) in to.iter_mut().zip(low).zip(high) {
                        *to = joined(low.reverse_bits(), high.reverse_bits(), spare);
                    }
                } else {
                    for (to, low) in to.iter_mut().zip(low) {
                        *to = low.reverse_bits() >> spare;
                    }
                }
            }
        } else {
            for word in 0..row_words {
                let from = &self.words[word * rows..][..rows];
                let to = &mut image.words[word * rows..][..rows];
                let (floor, ceiling) = (size.cells_w, 2 * size.cells_w);
                for w in 0..size.cells_w {
                    to[w] = from[floor - 1 - w];
                    to[floor + w] = from[ceiling - 1 - w];
                }
                let side = ceiling + size.cells_z;
                to[ceiling..side].copy_from_slice(&from[side..]);
                to[side..].copy_from_slice(&from[ceiling..side]);
            }
        }
        let spare = (end_words * 64 - size.cells_w) as u32;
        for end in 0..2 {
            for z in 0..size.cells_z {
                let from = &self.words[size.end_at(end, z)..][..end_words];
                if along {
                    image.end_row_mut(1 - end, z).copy_from_slice(from);
                } else {
                    for (word, to) in image.end_row_mut(end, z).iter_mut().enumerate() {
                        let low = from[end_words - 1 - word].reverse_bits();
                        let high = from[..end_words - 1 - word].last().map_or(0, |high| high.reverse_bits());
                        *to = joined(low, high, spare);
                    }
                }
            }
        }
        image
    }

    /// Every voxel that is marked, as u, w, z.
    pub(crate) fn voxels(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let size = self.size;
        self.words
            .iter()
            .enumerate()
            .flat_map(move |(at, word)| ones(*word).map(move |bit| size.voxel(at, bit)))
    }
}

/// How many voxels settled shells of one size have marked.
pub(super) fn counts(shells: &[Shell], instructions: Instructions) -> Counts {
    let bitmaps: Vec<_> = shells.iter().map(|shell| shell.words.as_slice()).collect();
    match instructions.level() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: these levels exist only where the processor has this instruction
        Level::Avx2 | Level::Avx512 => unsafe { counts_popcnt(&bitmaps) },
        _ => Counts::of_bitmaps(&bitmaps),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "popcnt")]
fn counts_popcnt(bitmaps: &[&[u64]]) -> Counts {
    Counts::of_bitmaps(bitmaps)
}

fn ones(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (word != 0).then(|| {
            let bit = word.trailing_zeros() as usize;
            word &= word - 1;
            bit
        })
    })
}

/// 64 bits of two words, the first `shift` bits of `low` left out.
pub(super) fn joined(low: u64, high: u64, shift: u32) -> u64 {
    if shift == 0 { low } else { low >> shift | high << (64 - shift) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ShellSize = ShellSize { cells_u: 100, cells_w: 70, cells_z: 9 };

    fn shell_voxels() -> Vec<[usize; 3]> {
        let mut all = Vec::new();
        for u in 0..SIZE.cells_u {
            for w in 0..SIZE.cells_w {
                for z in 0..SIZE.cells_z {
                    let at_face = |at: usize, count: usize| at == 0 || at == count - 1;
                    if at_face(u, SIZE.cells_u) || at_face(w, SIZE.cells_w) || at_face(z, SIZE.cells_z) {
                        all.push([u, w, z]);
                    }
                }
            }
        }
        all
    }

    #[test]
    fn every_voxel_of_the_shell_has_one_place() {
        let mut shell = Shell::new(SIZE);
        let mut expected = shell_voxels();
        for voxel in &expected {
            shell.mark(*voxel);
        }
        let mut found: Vec<_> = shell.voxels().collect();
        found.sort_unstable();
        expected.sort_unstable();
        assert_eq!(found, expected);
    }

    #[test]
    fn edges_settle_where_single_voxels_go() {
        let mut by_face = Shell::new(SIZE);
        by_face.row_words_mut(0)[2 * SIZE.cells_w] = 1; // u 0, w 0, z 0 through a side
        by_face.end_row_mut(1, SIZE.cells_z - 1)[0] = 1 << 5; // through an end wall
        by_face.end_row_mut(0, 4).copy_from_slice(&[1, 1 << 5]);
        by_face.settle();
        let mut one_by_one = Shell::new(SIZE);
        for voxel in [[0, 0, 0], [99, 5, 8], [0, 0, 4], [0, 69, 4]] {
            one_by_one.mark(voxel);
        }
        assert_eq!(by_face, one_by_one);
    }

    #[test]
    fn mirror_images_are_what_they_say() {
        for along in [true, false] {
            for voxel in shell_voxels().into_iter().step_by(7) {
                let mut shell = Shell::new(SIZE);
                shell.mark(voxel);
                let image: Vec<_> = shell.mirrored(along).voxels().collect();
                let [u, w, z] = voxel;
                let expected =
                    if along { [SIZE.cells_u - 1 - u, w, z] } else { [u, SIZE.cells_w - 1 - w, z] };
                assert_eq!(image, [expected], "{voxel:?}");
            }
        }
    }
}
