//! Voxels along the faces of the box, each in exactly one place: rows along the walk on floor, ceiling and both sides,
//! and the two end walls. A few hundred words where the whole grid has thousands.

use crate::coverage::Counts;

/// Sizes of a shell; u runs along the walk, w across it, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShellSize {
    pub cells_u: usize,
    pub cells_w: usize,
    pub cells_z: usize,
}

impl ShellSize {
    /// Rows along the walk: floor, ceiling, side at w = 0, side at the greatest w.
    pub fn rows(&self) -> usize {
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
}

/// Which voxels of the shell are seen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shell {
    size: ShellSize,
    words: Vec<u64>,
}

impl Shell {
    pub fn new(size: ShellSize) -> Self {
        let words = size.end_at(2, 0);
        Self { size, words: vec![0; words] }
    }

    /// Marks part of a row along the walk.
    pub fn mark_row(&mut self, row: usize, bits: &[u64]) {
        let words = self.size.row_words();
        for (word, bits) in self.words[row * words..][..words].iter_mut().zip(bits) {
            *word |= bits;
        }
    }

    /// Marks part of row k of an end wall.
    pub fn mark_end_row(&mut self, end: usize, k: usize, bits: &[u64]) {
        let (at, words) = (self.size.end_at(end, k), self.size.end_words());
        for (word, bits) in self.words[at..][..words].iter_mut().zip(bits) {
            *word |= bits;
        }
    }

    /// Marks one voxel, which must lie on the shell.
    pub fn mark(&mut self, [u, w, z]: [usize; 3]) {
        let size = self.size;
        let row = if z == 0 {
            w
        } else if z == size.cells_z - 1 {
            size.cells_w + w
        } else if w == 0 {
            2 * size.cells_w + z
        } else if w == size.cells_w - 1 {
            2 * size.cells_w + size.cells_z + z
        } else {
            let end = usize::from(u != 0);
            self.words[size.end_at(end, z) + w / 64] |= 1 << (w % 64);
            return;
        };
        self.words[row * size.row_words() + u / 64] |= 1 << (u % 64);
    }

    /// Moves the voxels along the edges of the box, which belong to two or three faces, to their one place.
    pub fn settle(&mut self) {
        let size = self.size;
        for end in 0..2 {
            let u = end * (size.cells_u - 1);
            for z in 0..size.cells_z {
                let at = size.end_at(end, z);
                let whole_row = z == 0 || z == size.cells_z - 1;
                for w in 0..size.cells_w {
                    if !whole_row && w != 0 && w != size.cells_w - 1 {
                        continue;
                    }
                    let (word, bit) = (at + w / 64, 1u64 << (w % 64));
                    if self.words[word] & bit != 0 {
                        self.words[word] &= !bit;
                        self.mark([u, w, z]);
                    }
                }
            }
        }
        let words = size.row_words();
        for (side, w) in [(0, 0), (1, size.cells_w - 1)] {
            for (z, floor) in [(0, 0), (size.cells_z - 1, size.cells_w)] {
                let from = (2 * size.cells_w + side * size.cells_z + z) * words;
                for word in 0..words {
                    let bits = std::mem::take(&mut self.words[from + word]);
                    self.words[(floor + w) * words + word] |= bits;
                }
            }
        }
    }

    /// Adds what another shell of the same size has seen.
    pub fn join(&mut self, other: &Self) {
        for (word, bits) in self.words.iter_mut().zip(&other.words) {
            *word |= bits;
        }
    }

    /// The mirror image along the walk (`along`) or across it.
    pub fn mirrored(&self, along: bool) -> Self {
        let size = self.size;
        let (row_words, end_words) = (size.row_words(), size.end_words());
        let mut image = Self::new(size);
        for row in 0..size.rows() {
            let from = &self.words[row * row_words..][..row_words];
            if along {
                reverse(from, size.cells_u, &mut image.words[row * row_words..][..row_words]);
            } else {
                let to = match row {
                    _ if row < size.cells_w => size.cells_w - 1 - row,
                    _ if row < 2 * size.cells_w => 3 * size.cells_w - 1 - row,
                    _ if row < 2 * size.cells_w + size.cells_z => row + size.cells_z,
                    _ => row - size.cells_z,
                };
                image.words[to * row_words..][..row_words].copy_from_slice(from);
            }
        }
        for end in 0..2 {
            for z in 0..size.cells_z {
                let from = &self.words[size.end_at(end, z)..][..end_words];
                if along {
                    let to = size.end_at(1 - end, z);
                    image.words[to..][..end_words].copy_from_slice(from);
                } else {
                    let to = size.end_at(end, z);
                    reverse(from, size.cells_w, &mut image.words[to..][..end_words]);
                }
            }
        }
        image
    }

    /// Every voxel that is marked, as u, w, z.
    pub fn voxels(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let size = self.size;
        let (row_words, end_words) = (size.row_words(), size.end_words());
        let rows = size.rows() * row_words;
        self.words.iter().enumerate().flat_map(move |(at, word)| {
            ones(*word).map(move |bit| {
                if at < rows {
                    let (row, u) = (at / row_words, at % row_words * 64 + bit);
                    let [w, z] = size.row_place(row);
                    [u, w, z]
                } else {
                    let place = at - rows;
                    let (end_row, w) = (place / end_words, place % end_words * 64 + bit);
                    let (end, z) = (end_row / size.cells_z, end_row % size.cells_z);
                    [end * (size.cells_u - 1), w, z]
                }
            })
        })
    }
}

impl ShellSize {
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

/// How many voxels settled shells of one size have marked.
pub(super) fn counts(shells: &[Shell]) -> Counts {
    let bitmaps: Vec<_> = shells.iter().map(|shell| shell.words.as_slice()).collect();
    Counts::of_bitmaps(&bitmaps)
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

/// Reverses the order of `count` bits.
fn reverse(from: &[u64], count: usize, to: &mut [u64]) {
    let words = from.len();
    let spare = (words * 64 - count) as u32;
    for word in 0..words {
        let low = from[words - 1 - word].reverse_bits();
        let high = if word + 1 < words { from[words - 2 - word].reverse_bits() } else { 0 };
        to[word] = if spare == 0 { low } else { low >> spare | high << (64 - spare) };
    }
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
        assert_eq!(counts(&[shell]).union, expected.len() as u64);
    }

    #[test]
    fn edges_settle_where_single_voxels_go() {
        let mut by_face = Shell::new(SIZE);
        by_face.mark_row(2 * SIZE.cells_w, &[1, 0]); // u 0, w 0, z 0 by way of a side
        by_face.mark_end_row(1, SIZE.cells_z - 1, &[1 << 5, 0]); // by way of an end wall
        by_face.mark_end_row(0, 4, &[1, 1 << 5]);
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
