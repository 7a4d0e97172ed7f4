//! Forward substitution in the model of the Bayesian search, beside nalgebra's.
//!
//! `cargo bench --bench substitution` prints processor time per right side on one thread, and the median of the ratios
//! of one run.

mod support;

use nalgebra::{DMatrix, DVector};
use outrigger::base::instructions::Instructions;
use outrigger::design::optimize::forward_substitution::{WIDTH, solve_lower};
use support::{median, median_cpu_s};

const ROUNDS: usize = 15;

fn main() {
    let levels = Instructions::available();
    println!(
        "{WIDTH} right sides at once; microseconds per right side, and how many times faster than nalgebra's"
    );
    for n in [56, 80, 150, 300, 600] {
        let lower = DMatrix::from_fn(n, n, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => 0.0,
            std::cmp::Ordering::Equal => 2.0,
            std::cmp::Ordering::Greater => ((i * 31 + j * 17) % 100) as f64 / 1e4,
        });
        let value = |row: usize, lane: usize| ((row * 7 + lane) % 11) as f64;
        let sides: Vec<DVector<f64>> =
            (0..WIDTH).map(|lane| DVector::from_fn(n, |row, _| value(row, lane))).collect();
        let lanes: Vec<[f64; WIDTH]> =
            (0..n).map(|row| std::array::from_fn(|lane| value(row, lane))).collect();
        let repetitions = 20_000_000 / (n * n * WIDTH);
        let mut peers = Vec::new();
        let mut ours = vec![Vec::new(); levels.len()];
        for _ in 0..ROUNDS {
            peers.push(median_cpu_s(1, || {
                for _ in 0..repetitions {
                    for side in &sides {
                        let mut side = side.clone();
                        lower.solve_lower_triangular_unchecked_mut(&mut side);
                        std::hint::black_box(&side);
                    }
                }
            }));
            for (level, times) in levels.iter().zip(&mut ours) {
                times.push(median_cpu_s(1, || {
                    for _ in 0..repetitions {
                        let mut right = lanes.clone();
                        solve_lower(&lower, &mut right, *level);
                        std::hint::black_box(&right);
                    }
                }));
            }
        }
        let per_side = |times: &[f64]| 1e6 * median(times.to_vec()) / (repetitions * WIDTH) as f64;
        print!("{n:4} rows: nalgebra {:7.2}", per_side(&peers));
        for (level, times) in levels.iter().zip(&ours) {
            let ratio = median(peers.iter().zip(times).map(|(peer, own)| peer / own).collect());
            print!("   {level:?} {:7.2} ({ratio:.1})", per_side(times));
        }
        println!();
    }
}
