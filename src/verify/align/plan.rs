//! Where the walls of a walk fit those of a scene: every turn and every place at once, by correlation of horizontal slices.

use std::sync::Arc;

use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::surface::Patch;

/// Edge of a cell of the plan, m, and most cells along an edge: larger scenes take larger cells.
const CELL_M: f64 = 0.2;
const MOST_CELLS: f64 = 640.0;
/// Least thickness of a slice, m, and most slices.
const SLICE_M: f64 = 0.4;
const MOST_SLICES: usize = 12;
/// Turns about the vertical that are tried.
const YAWS: usize = 120;
/// Walls farther from the middle of the walk are left out, m: a turn between two that are tried moves them too far.
const FARTHEST_M: f64 = 25.0;
/// Number of best peaks held of each turn and height, and of all.
const PEAKS: usize = 8;
const MOST_GUESSES: usize = 60;
/// Two guesses nearer than this in place and turn are one.
const APART_M: f64 = 0.5;
const APART_RAD: f64 = 0.11;

/// A place that the walls speak for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guess {
    /// Turn of the upright walk.
    pub yaw_rad: f64,
    /// Where the middle of the walk lies, m.
    pub at_m: DVec3,
    /// Share of the walk's walls that meet walls.
    pub score: f32,
}

impl Guess {
    fn is_apart(&self, other: &Self) -> bool {
        let turn = (self.yaw_rad - other.yaw_rad).rem_euclid(std::f64::consts::TAU);
        self.at_m.distance(other.at_m) > APART_M || turn.min(std::f64::consts::TAU - turn) > APART_RAD
    }
}

/// Walls in horizontal slices over a grid.
struct Grid {
    low_m: DVec2,
    cell_m: f64,
    /// Cells of the scene.
    scene: [usize; 2],
    fft: Fft2,
    lowest_m: f64,
    slice_m: f64,
    slices: usize,
}

/// The best guesses, apart from each other, best first; `walk` upright about its middle; `is_allowed`: whether the middle of
/// the walk may lie there, turned so.
pub(super) fn guesses(
    walk: &[Patch],
    scene: &[Patch],
    heights_m: &[f64],
    bounds_m: [DVec3; 2],
    is_allowed: &(dyn Fn(DVec2, f64) -> bool + Sync),
) -> Vec<Guess> {
    let walls = |patches: &[Patch]| -> Vec<DVec3> {
        patches.iter().filter(|patch| patch.is_upright()).map(|patch| patch.at_m).collect()
    };
    let mut own = walls(walk);
    own.retain(|at_m| at_m.truncate().length() < FARTHEST_M);
    let Some(grid) = Grid::of(&own, bounds_m) else { return Vec::new() };
    let scene = walls(scene);
    let spectra: Vec<Vec<Vec<Complex32>>> =
        heights_m.par_iter().map(|height_m| grid.scene_spectra(&scene, *height_m)).collect();
    let of_yaw = |number: usize| {
        let yaw_rad = std::f64::consts::TAU * number as f64 / YAWS as f64;
        grid.peaks(&own, yaw_rad, heights_m, &spectra, is_allowed)
    };
    let mut all: Vec<Guess> = (0..YAWS).into_par_iter().flat_map_iter(of_yaw).collect();
    all.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable: equals keep their order
    let mut best: Vec<Guess> = Vec::new();
    for guess in all {
        if best.len() == MOST_GUESSES {
            break;
        }
        if best.iter().all(|other| guess.is_apart(other)) {
            best.push(guess);
        }
    }
    best
}

impl Grid {
    fn of(walk: &[DVec3], [low_m, high_m]: [DVec3; 2]) -> Option<Self> {
        let reach_m = walk.iter().map(|at_m| at_m.truncate().length()).reduce(f64::max)?;
        let size_m = (high_m - low_m).truncate();
        let cell_m = CELL_M.max((size_m.max_element() + reach_m) / MOST_CELLS);
        let scene = [size_m.x, size_m.y].map(|size_m| (size_m / cell_m) as usize + 2);
        // a walk at the scene's edge does not reach over to its other side
        let reach = (reach_m / cell_m) as usize + 2;
        let fft = Fft2::new(scene.map(|cells| quick_size(cells + reach)));
        let lowest_m = walk.iter().map(|at_m| at_m.z).reduce(f64::min)?;
        let highest_m = walk.iter().map(|at_m| at_m.z).reduce(f64::max)?;
        let slice_m = SLICE_M.max((highest_m - lowest_m) / MOST_SLICES as f64);
        let slices = (((highest_m - lowest_m) / slice_m) as usize + 1).min(MOST_SLICES);
        Some(Self { low_m: low_m.truncate(), cell_m, scene, fft, lowest_m, slice_m, slices })
    }

    /// Slice of a height of the walk.
    fn slice(&self, z_m: f64) -> Option<usize> {
        let slice = ((z_m - self.lowest_m) / self.slice_m).floor();
        (slice >= 0.0 && slice < self.slices as f64).then_some(slice as usize)
    }

    /// Two slices to an image, as its real and its imaginary part: the real part of their product is the sum over both.
    fn images(&self) -> Vec<Vec<Complex32>> {
        let [columns, rows] = self.fft.size;
        vec![vec![Complex32::default(); columns * rows]; self.slices.div_ceil(2)]
    }

    fn scene_spectra(&self, walls_m: &[DVec3], height_m: f64) -> Vec<Vec<Complex32>> {
        let mut images = self.images();
        let columns = self.fft.size[0];
        for at_m in walls_m {
            let Some(slice) = self.slice(at_m.z - height_m) else { continue };
            let cell = ((at_m.truncate() - self.low_m) / self.cell_m).floor();
            let [x, y] = [cell.x as usize, cell.y as usize];
            // half as much next to a wall as in it
            for (dx, dy) in (0..9).map(|n| (n % 3, n / 3)) {
                let (Some(x), Some(y)) = ((x + dx).checked_sub(1), (y + dy).checked_sub(1)) else { continue };
                if x >= self.scene[0] || y >= self.scene[1] {
                    continue;
                }
                let value: f32 = if dx == 1 && dy == 1 { 1.0 } else { 0.5 };
                let pixel = part(&mut images[slice / 2][y * columns + x], slice);
                *pixel = pixel.max(value);
            }
        }
        images.iter_mut().for_each(|image| self.fft.forward(image));
        images
    }

    fn peaks(
        &self,
        walk: &[DVec3],
        yaw_rad: f64,
        heights_m: &[f64],
        spectra: &[Vec<Vec<Complex32>>],
        is_allowed: &dyn Fn(DVec2, f64) -> bool,
    ) -> Vec<Guess> {
        let turn = DMat2::from_angle(yaw_rad);
        let [columns, rows] = self.fft.size;
        let mut images = self.images();
        let mut cells = 0;
        for at_m in walk {
            let Some(slice) = self.slice(at_m.z) else { continue };
            let cell = (turn * at_m.truncate() / self.cell_m).floor();
            let x = (cell.x as i64).rem_euclid(columns as i64) as usize;
            let y = (cell.y as i64).rem_euclid(rows as i64) as usize;
            let pixel = part(&mut images[slice / 2][y * columns + x], slice);
            cells += usize::from(*pixel == 0.0);
            *pixel = 1.0;
        }
        images.iter_mut().for_each(|image| self.fft.forward(image));
        let mut found = Vec::new();
        let mut sum = vec![Complex32::default(); columns * rows];
        for (height_m, scene) in heights_m.iter().zip(spectra) {
            sum.fill(Complex32::default());
            for (own, scene) in images.iter().zip(scene) {
                for ((sum, own), scene) in sum.iter_mut().zip(own).zip(scene) {
                    *sum += own.conj() * scene;
                }
            }
            self.fft.inverse(&mut sum);
            let scale = 1.0 / (columns * rows * cells.max(1)) as f32;
            for (score, [x, y]) in self.highest(&sum, yaw_rad, is_allowed) {
                let at_m = self.low_m + self.cell_m * DVec2::new(x as f64, y as f64);
                found.push(Guess { yaw_rad, at_m: at_m.extend(*height_m), score: score * scale });
            }
        }
        found
    }

    /// The highest local maxima.
    fn highest(
        &self,
        sum: &[Complex32],
        yaw_rad: f64,
        is_allowed: &dyn Fn(DVec2, f64) -> bool,
    ) -> Vec<(f32, [usize; 2])> {
        let columns = self.fft.size[0];
        let mut peaks: Vec<(f32, [usize; 2])> = Vec::new();
        for y in 1..self.scene[1] {
            for x in 1..self.scene[0] {
                let at = y * columns + x;
                let score = sum[at].re;
                let is_high = peaks.len() < PEAKS || score > peaks[peaks.len() - 1].0;
                let around = [at - 1, at + 1, at - columns, at + columns];
                if score <= 0.0 || !is_high || around.iter().any(|neighbour| sum[*neighbour].re > score) {
                    continue;
                }
                if !is_allowed(self.low_m + self.cell_m * DVec2::new(x as f64, y as f64), yaw_rad) {
                    continue;
                }
                let place = peaks.partition_point(|(other, _)| *other >= score);
                peaks.insert(place, (score, [x, y]));
                peaks.truncate(PEAKS);
            }
        }
        peaks
    }
}

fn part(pixel: &mut Complex32, slice: usize) -> &mut f32 {
    if slice.is_multiple_of(2) { &mut pixel.re } else { &mut pixel.im }
}

/// Not less, of factors 2, 3 and 5 alone.
fn quick_size(least: usize) -> usize {
    let is_quick = |size: &usize| {
        let without = |size: usize, factor: usize| {
            let mut left = size;
            while left.is_multiple_of(factor) {
                left /= factor;
            }
            left
        };
        without(without(without(*size, 2), 3), 5) == 1
    };
    (least.max(1)..).find(is_quick).unwrap_or(least)
}

/// Transforms of images of one size, row after row. What is transformed lies column after column.
struct Fft2 {
    /// Columns and rows.
    size: [usize; 2],
    forward: [Arc<dyn Fft<f32>>; 2],
    inverse: [Arc<dyn Fft<f32>>; 2],
}

impl Fft2 {
    fn new(size: [usize; 2]) -> Self {
        let mut planner = FftPlanner::new();
        let forward = size.map(|length| planner.plan_fft_forward(length));
        let inverse = size.map(|length| planner.plan_fft_inverse(length));
        Self { size, forward, inverse }
    }

    fn forward(&self, image: &mut Vec<Complex32>) {
        self.forward[0].process(image);
        *image = transposed(image, self.size[0]);
        self.forward[1].process(image);
    }

    fn inverse(&self, image: &mut Vec<Complex32>) {
        self.inverse[1].process(image);
        *image = transposed(image, self.size[1]);
        self.inverse[0].process(image);
    }
}

/// Edge of the blocks that are transposed at once: they fit the nearest cache.
const BLOCK: usize = 16;

fn transposed(image: &[Complex32], columns: usize) -> Vec<Complex32> {
    let rows = image.len() / columns;
    let mut turned = vec![Complex32::default(); image.len()];
    for row_block in (0..rows).step_by(BLOCK) {
        for column_block in (0..columns).step_by(BLOCK) {
            for row in row_block..(row_block + BLOCK).min(rows) {
                for column in column_block..(column_block + BLOCK).min(columns) {
                    turned[column * rows + row] = image[row * columns + column];
                }
            }
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transform_and_its_inverse_give_the_image_back() {
        let size = [quick_size(13), quick_size(31)];
        assert_eq!(size, [15, 32]);
        let fft = Fft2::new(size);
        let image: Vec<Complex32> =
            (0..15 * 32).map(|at| Complex32::new((at % 7) as f32, (at % 5) as f32)).collect();
        let mut changed = image.clone();
        fft.forward(&mut changed);
        let mean: Complex32 = image.iter().sum();
        assert!((changed[0] - mean).norm() < 1e-2);
        fft.inverse(&mut changed);
        let scale = 1.0 / (15.0 * 32.0);
        assert!(changed.iter().zip(&image).all(|(a, b)| (a * scale - b).norm() < 1e-4));
    }
}
