//! What a sweep has hit: combs along the walk and bytes for the end walls, and how they become a shell.

use super::Plan;
use crate::simulate::published::shell::{Shell, joined};

/// What a sweep has hit.
pub(super) struct Hits {
    /// For each row along the walk the voxels hit from the first pose, where the walk's length lies before the first
    /// voxel; one more row takes what hits none. The first word of every row comes before the second word of any.
    pub combs: Vec<u64>,
    /// Rows and the one more.
    pub stride: usize,
    /// A byte for each voxel of the end walls: end and z before w, each in `whole_bits` bits.
    pub ends: Vec<u8>,
    pub undecided: Vec<Undecided>,
}

impl Hits {
    pub(crate) fn new(plan: &Plan, poses: usize) -> Self {
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
    pub(crate) fn mark(&mut self, plan: &Plan, poses: usize, shell: &mut Shell) {
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

/// A ray, or one pose of it, that the definition must decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Undecided {
    pub class: usize,
    pub azimuth: usize,
    pub beam: usize,
    /// Counted within the class; none for the whole walk.
    pub pose: Option<usize>,
}
