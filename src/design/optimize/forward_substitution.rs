//! Forward substitution for several right sides at once: half of what a search by a Gaussian process takes.
#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them

use nalgebra::DMatrix;

use crate::base::instructions::{Instructions, Level};

/// Right sides at once.
pub const WIDTH: usize = 8;
/// Number of columns with products that leave a row before it is written back.
const COLUMNS: usize = 4;

/// Replaces the right sides `b` (rows by elements) by the solutions of `lower x = b`. `lower` is square, as many rows as
/// `right`; what lies above its diagonal is not looked at. The bits are those of a substitution column by column, with
/// all instructions.
///
/// # Panics
///
/// If the sizes differ.
pub fn solve_lower(lower: &DMatrix<f64>, right: &mut [[f64; WIDTH]], instructions: Instructions) {
    assert_eq!((lower.nrows(), lower.ncols()), (right.len(), right.len()), "rows and columns of the factor");
    match instructions.level() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx512 => unsafe { solve_avx512(lower.as_slice(), right) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx2 => unsafe { solve_avx2(lower.as_slice(), right) },
        _ => solve_anywhere(lower.as_slice(), right),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
fn solve_avx512(lower: &[f64], right: &mut [[f64; WIDTH]]) {
    solve_anywhere(lower, right);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn solve_avx2(lower: &[f64], right: &mut [[f64; WIDTH]]) {
    solve_anywhere(lower, right);
}

/// `lower` column after column.
#[inline(always)]
fn solve_anywhere(lower: &[f64], right: &mut [[f64; WIDTH]]) {
    let n = right.len();
    let blocked = n - n % COLUMNS;
    for first in (0..blocked).step_by(COLUMNS) {
        let next = first + COLUMNS;
        for j in first..next {
            take_column(&lower[j * n..(j + 1) * n], j, next, right);
        }
        let (solved, below) = right.split_at_mut(next);
        let mut own = [[0.0; WIDTH]; COLUMNS];
        own.copy_from_slice(&solved[first..]);
        let mut columns: [&[f64]; COLUMNS] = [&[]; COLUMNS];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = &lower[(first + k) * n + next..(first + k + 1) * n];
        }
        for (row, values) in below.iter_mut().enumerate() {
            for (column, solved) in columns.iter().zip(&own) {
                take(values, solved, column[row]);
            }
        }
    }
    for j in blocked..n {
        take_column(&lower[j * n..(j + 1) * n], j, n, right);
    }
}

/// Solves row `j`, and takes its share out of the rows after it, as far as `end`.
#[inline(always)]
fn take_column(column: &[f64], j: usize, end: usize, right: &mut [[f64; WIDTH]]) {
    let mut solved = right[j];
    for value in &mut solved {
        *value /= column[j];
    }
    right[j] = solved;
    for (values, l) in right[j + 1..end].iter_mut().zip(&column[j + 1..end]) {
        take(values, &solved, *l);
    }
}

#[inline(always)]
fn take(values: &mut [f64; WIDTH], solved: &[f64; WIDTH], l: f64) {
    for (value, solved) in values.iter_mut().zip(solved) {
        *value -= solved * l;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    /// Column by column, one element at a time.
    fn reference(lower: &DMatrix<f64>, right: &mut [[f64; WIDTH]]) {
        for element in 0..WIDTH {
            for j in 0..right.len() {
                right[j][element] /= lower[(j, j)];
                for i in j + 1..right.len() {
                    right[i][element] -= right[j][element] * lower[(i, j)];
                }
            }
        }
    }

    #[test]
    fn the_bits_are_those_of_one_column_after_another() {
        let mut rng = Rng::new(3, 0);
        for n in [0, 1, 2, 3, 4, 5, 7, 8, 9, 31, 64, 130] {
            // entries above the diagonal must not matter
            let lower = DMatrix::from_fn(n, n, |i, j| match i.cmp(&j) {
                std::cmp::Ordering::Less => f64::NAN,
                std::cmp::Ordering::Equal => 1.0 + rng.uniform(),
                std::cmp::Ordering::Greater => rng.normal(),
            });
            let right: Vec<[f64; WIDTH]> = (0..n).map(|_| std::array::from_fn(|_| rng.normal())).collect();
            let mut expected = right.clone();
            reference(&lower, &mut expected);
            for instructions in Instructions::available() {
                let mut found = right.clone();
                solve_lower(&lower, &mut found, instructions);
                let bits = |rows: &[[f64; WIDTH]]| {
                    rows.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<_>>()
                };
                assert_eq!(bits(&found), bits(&expected), "{n} rows, {instructions:?}");
            }
        }
    }

    #[test]
    #[should_panic(expected = "rows and columns of the factor")]
    fn sizes_that_differ_are_refused() {
        solve_lower(&DMatrix::zeros(3, 3), &mut [[0.0; WIDTH]; 2], Instructions::best());
    }
}
