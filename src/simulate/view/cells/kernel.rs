//! What an eye sees of a voxel, by its records. Every operation is one IEEE operation in a fixed order, nothing fused: the
//! same bits with any instruction set.

use glam::DVec3;

use super::Fan;
use super::records::{Block, Layer, WIDTH};
use crate::base::instructions::Kernel;

/// A voxel that remains unseen with this chance is seen for certain.
const CERTAIN: f32 = 1e-3;
/// Steps of the table of rows.
const STEPS: usize = 4096;
/// 2^23: the steps between numbers of this size are 1.
const LARGE: f32 = 8_388_608.0;
/// Root of the solid angle of a patch over its height: floors and tables are seen at a slant. Of 1.0 to 1.4 this ranks the
/// mounts of two sensors in a furnished house best.
const FLATNESS: f32 = 1.2;
/// The gap that a single row fills, rad.
const ONE_ROW_RAD: f64 = 0.01;
/// How far beyond the outermost rows the table goes, rad: no voxel outside a sensor's least range looks wider.
const BEYOND_RAD: f64 = 0.25;

/// The rows of a sensor: how far a direction is from the nearest one.
pub(super) struct Rows {
    /// Sine of the elevation at the first step.
    low: f32,
    per_sine: f32,
    /// Distance to the nearest row, rad.
    distance_rad: Box<[f32; STEPS]>,
    /// Columns per radian.
    columns_per_rad: f32,
    /// Beams per steradian and revolution.
    per_sr: Box<[f32; STEPS]>,
    /// `distance_rad` holds points per steradian and period instead: a sensor without rings.
    is_pattern: bool,
}

impl Rows {
    pub(crate) fn new(fan: &Fan) -> Self {
        if let Some(directions) = fan.pattern() {
            return Self::of_pattern(directions, fan.axis());
        }
        let rows_rad: Vec<f64> = fan.elevations_rad().collect();
        let (first, last) = (rows_rad[0], rows_rad[rows_rad.len() - 1]);
        let right = std::f64::consts::FRAC_PI_2;
        let low = (first - BEYOND_RAD).max(-right).sin();
        let high = (last + BEYOND_RAD).min(right).sin();
        let columns_per_rad = fan.columns as f64 / std::f64::consts::TAU;
        let mut distance_rad = Box::new([0.0; STEPS]);
        let mut per_sr = Box::new([0.0; STEPS]);
        for (step, distance) in distance_rad.iter_mut().enumerate() {
            let sine = low + (high - low) * step as f64 / (STEPS - 1) as f64;
            let elevation_rad = sine.clamp(-1.0, 1.0).asin();
            let nearest =
                rows_rad.iter().map(|row| (row - elevation_rad).abs()).fold(f64::INFINITY, f64::min);
            *distance = nearest as f32;
            let cosine = elevation_rad.cos().max(1e-3);
            per_sr[step] = (rows_per_rad(&rows_rad, elevation_rad) * columns_per_rad / cosine) as f32;
        }
        Self {
            low: low as f32,
            per_sine: ((STEPS - 1) as f64 / (high - low)) as f32,
            distance_rad,
            columns_per_rad: columns_per_rad as f32,
            per_sr,
            is_pattern: false,
        }
    }

    /// How densely a pattern fills the sphere by the angle to its axis: zones of equal solid angle.
    fn of_pattern(directions: &[DVec3], axis: DVec3) -> Self {
        const ZONES: usize = 256;
        let mut points = [0.0_f64; ZONES];
        for along in directions {
            let sine = along.dot(axis).clamp(-1.0, 1.0);
            points[((0.5 * (sine + 1.0) * ZONES as f64) as usize).min(ZONES - 1)] += 1.0;
        }
        let zone_sr = 2.0 * std::f64::consts::TAU / ZONES as f64;
        let mut distance_rad = Box::new([0.0; STEPS]);
        for (step, density) in distance_rad.iter_mut().enumerate() {
            *density = (points[step * ZONES / STEPS] / zone_sr) as f32;
        }
        Self {
            low: -1.0,
            per_sine: 0.5 * (STEPS - 1) as f32,
            per_sr: distance_rad.clone(),
            distance_rad,
            columns_per_rad: 0.0,
            is_pattern: true,
        }
    }
}

/// Rows per radian around an elevation: one per gap between neighbours, half a gap beyond the outermost.
fn rows_per_rad(rows_rad: &[f64], elevation_rad: f64) -> f64 {
    let above = rows_rad.partition_point(|row| *row < elevation_rad);
    let gap_rad = |above: usize| (rows_rad[above] - rows_rad[above - 1]).max(1e-4);
    let last = rows_rad.len() - 1;
    let (outer_rad, gap_rad) = match above {
        _ if last == 0 => ((elevation_rad - rows_rad[0]).abs(), ONE_ROW_RAD),
        0 => (rows_rad[0] - elevation_rad, gap_rad(1)),
        above if above > last => (elevation_rad - rows_rad[last], gap_rad(last)),
        above => (0.0, gap_rad(above)),
    };
    if outer_rad <= 0.5 * gap_rad { 1.0 / gap_rad } else { 0.0 }
}

/// A sensor in the frame of the body.
pub(super) struct Eye<'a> {
    pub origin_m: [f32; 3],
    /// Its spin axis.
    pub axis: [f32; 3],
    pub rows: &'a Rows,
    pub min_range_m: f32,
    pub max_range_m: f32,
    pub scans_per_view: u32,
    /// The layers below and above it.
    pub layers: [usize; 2],
    /// How far it is from the lower to the upper one.
    pub share: f32,
}

/// Expected numbers of voxels of one rig.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    pub per_sensor: Vec<f64>,
    pub union: f64,
    pub overlap: f64,
}

impl Sums {
    pub(crate) fn nothing(sensors: usize) -> Self {
        Self { per_sensor: vec![0.0; sensors], union: 0.0, overlap: 0.0 }
    }

    pub(crate) fn add(&mut self, more: &Self) {
        self.per_sensor.iter_mut().zip(&more.per_sensor).for_each(|(sum, more)| *sum += more);
        self.union += more.union;
        self.overlap += more.overlap;
    }
}

/// Some voxels and the eyes of each rig that look at them.
#[derive(Clone, Copy)]
pub(super) struct Looking<'a> {
    pub layers: &'a [Layer],
    pub voxels: &'a [u32],
    pub rigs: &'a [Vec<Eye<'a>>],
}

/// What each rig sees of them.
pub(super) struct Counting<'a>(pub Looking<'a>);

/// How many of them each rig sees: the first sensor that sees a voxel for certain ends the search through it.
pub(super) struct CountingUnion<'a>(pub Looking<'a>);

/// The same where a voxel needs so many returns of all sensors together.
pub(super) struct CountingReturns<'a>(pub Looking<'a>, pub u16);

/// Those of them that some rig may miss.
pub(super) struct Uncertain<'a>(pub Looking<'a>);

impl Kernel for Counting<'_> {
    type Output = Vec<Sums>;

    #[inline(always)]
    fn run(self) -> Vec<Sums> {
        let Self(Looking { layers, voxels, rigs }) = self;
        let mut sums: Vec<Sums> = rigs.iter().map(|eyes| Sums::nothing(eyes.len())).collect();
        for voxel in voxels {
            for (eyes, sums) in rigs.iter().zip(&mut sums) {
                // chance that no sensor sees it, and that exactly one does
                let (mut none, mut one) = (1.0_f64, 0.0_f64);
                for (sensor, eye) in eyes.iter().enumerate() {
                    let unseen = f64::from(unseen(layers, *voxel as usize, eye));
                    one = one * unseen + none * (1.0 - unseen);
                    none *= unseen;
                    sums.per_sensor[sensor] += 1.0 - unseen;
                }
                sums.union += 1.0 - none;
                sums.overlap += 1.0 - none - one;
            }
        }
        sums
    }
}

impl Kernel for CountingUnion<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run(self) -> Vec<f64> {
        let Self(Looking { layers, voxels, rigs }) = self;
        let mut sums = vec![0.0; rigs.len()];
        for voxel in voxels {
            for (eyes, sum) in rigs.iter().zip(&mut sums) {
                let mut none = 1.0_f64;
                for eye in eyes {
                    none *= f64::from(unseen(layers, *voxel as usize, eye));
                    if none == 0.0 {
                        break;
                    }
                }
                *sum += 1.0 - none;
            }
        }
        sums
    }
}

impl Kernel for CountingReturns<'_> {
    type Output = Vec<Sums>;

    #[inline(always)]
    fn run(self) -> Vec<Sums> {
        let Self(Looking { layers, voxels, rigs }, min_hits) = self;
        let needed = f64::from(min_hits);
        // more returns than this are surely enough
        let plenty = (needed + 6.0 * needed.sqrt() + 6.0) as f32;
        let mut sums: Vec<Sums> = rigs.iter().map(|eyes| Sums::nothing(eyes.len())).collect();
        let mut expected: Vec<f64> = Vec::new();
        for voxel in voxels {
            for (eyes, sums) in rigs.iter().zip(&mut sums) {
                expected.clear();
                for eye in eyes {
                    expected.push(f64::from(returns(layers, *voxel as usize, eye, plenty)));
                }
                let enough = chance_of(needed, expected.iter().sum());
                if enough == 0.0 {
                    continue;
                }
                // chance that no sensor meets it, and that exactly one does
                let (mut none, mut one) = (1.0_f64, 0.0_f64);
                for (sensor, expected) in expected.iter().enumerate() {
                    let unseen = (-expected).exp();
                    one = one * unseen + none * (1.0 - unseen);
                    none *= unseen;
                    sums.per_sensor[sensor] += enough * (1.0 - unseen);
                }
                sums.union += enough;
                sums.overlap += enough * (1.0 - none - one);
            }
        }
        sums
    }
}

/// Chance of `needed` returns or more where so many are expected (Poisson, by Wilson and Hilferty 1931,
/// doi:10.1073/pnas.17.12.684).
fn chance_of(needed: f64, expected: f64) -> f64 {
    let variance = 1.0 / (9.0 * needed);
    let off = ((expected / needed).cbrt() - (1.0 - variance)) / variance.sqrt();
    if expected > 0.0 { 0.5 * libm::erfc(-off / std::f64::consts::SQRT_2) } else { 0.0 }
}

/// Returns that an eye expects of a voxel; those beyond `plenty` are not counted.
#[inline(always)]
fn returns(layers: &[Layer], voxel: usize, eye: &Eye<'_>, plenty: f32) -> f32 {
    let [low, high] = eye.layers;
    let below = returns_in(&layers[low], voxel, eye, plenty);
    if low == high || eye.share == 0.0 {
        return below;
    }
    below + eye.share * (returns_in(&layers[high], voxel, eye, plenty) - below)
}

#[inline(always)]
fn returns_in(layer: &Layer, voxel: usize, eye: &Eye<'_>, plenty: f32) -> f32 {
    let mut sum = 0.0_f32;
    let (first, end) = (layer.starts[voxel] as usize, layer.starts[voxel + 1] as usize);
    for block in &layer.blocks[first..end] {
        sum += eye.scans_per_view as f32 * returns_of(layer, block, eye);
        if sum > plenty {
            return plenty;
        }
    }
    sum
}

/// Returns that the records of a block give in a revolution: beams per steradian times the solid angle of each.
#[inline(always)]
fn returns_of(layer: &Layer, block: &Block, eye: &Eye<'_>) -> f32 {
    let rows = eye.rows;
    let mut solids_sr = [0.0_f32; WIDTH];
    let mut steps = [0_u32; WIDTH];
    for element in 0..WIDTH {
        let x = f32::from(block.x[element]) * layer.step_m - eye.origin_m[0];
        let y = f32::from(block.y[element]) * layer.step_m - eye.origin_m[1];
        let z = f32::from(block.z[element]) * layer.step_m - eye.origin_m[2];
        let width_m = f32::from(block.width[element]) * layer.width_step_m;
        let square = x * x + y * y + z * z;
        let range_m = square.sqrt();
        let along_m = x * eye.axis[0] + y * eye.axis[1] + z * eye.axis[2];
        let step = (along_m / range_m - rows.low) * rows.per_sine;
        let step = if step > 0.0 { step } else { 0.0 };
        let step = if step < (STEPS - 1) as f32 { step } else { (STEPS - 1) as f32 };
        steps[element] = (step + LARGE).to_bits() & (STEPS - 1) as u32;
        let is_met = (range_m >= eye.min_range_m) & (range_m <= eye.max_range_m);
        solids_sr[element] = if is_met { width_m * width_m / square } else { 0.0 };
    }
    let mut sum = 0.0;
    for element in 0..WIDTH {
        sum += rows.per_sr[steps[element] as usize & (STEPS - 1)] * solids_sr[element];
    }
    sum
}

impl Kernel for Uncertain<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run(self) -> Vec<u32> {
        let Self(Looking { layers, voxels, rigs }) = self;
        let mut uncertain = Vec::new();
        for voxel in voxels {
            let mut is_seen_by_all = true;
            for eyes in rigs {
                let mut is_seen = false;
                for eye in eyes {
                    is_seen = is_seen || unseen(layers, *voxel as usize, eye) == 0.0;
                }
                is_seen_by_all = is_seen_by_all && is_seen;
                if !is_seen_by_all {
                    uncertain.push(*voxel);
                    break;
                }
            }
        }
        uncertain
    }
}

/// Chance that an eye does not see a voxel.
#[inline(always)]
fn unseen(layers: &[Layer], voxel: usize, eye: &Eye<'_>) -> f32 {
    let [low, high] = eye.layers;
    let below = unseen_in(&layers[low], voxel, eye);
    if low == high || eye.share == 0.0 {
        return below;
    }
    let above = unseen_in(&layers[high], voxel, eye);
    below + eye.share * (above - below)
}

#[inline(always)]
fn unseen_in(layer: &Layer, voxel: usize, eye: &Eye<'_>) -> f32 {
    let mut unseen = 1.0_f32;
    let (first, end) = (layer.starts[voxel] as usize, layer.starts[voxel + 1] as usize);
    for block in &layer.blocks[first..end] {
        let missed = unseen_by(layer, block, eye);
        for _ in 0..eye.scans_per_view {
            unseen *= missed;
        }
        if unseen < CERTAIN {
            return 0.0;
        }
    }
    unseen
}

/// Chance that no record of a block is seen in a revolution.
#[inline(always)]
fn unseen_by(layer: &Layer, block: &Block, eye: &Eye<'_>) -> f32 {
    let rows = eye.rows;
    let mut missed = [1.0_f32; WIDTH];
    let mut steps = [0_u32; WIDTH];
    let mut ranges_m = [0.0_f32; WIDTH];
    let mut widths_m = [0.0_f32; WIDTH];
    let mut columns = [0.0_f32; WIDTH];
    let mut ranges_per_width = [0.0_f32; WIDTH];
    for element in 0..WIDTH {
        let x = f32::from(block.x[element]) * layer.step_m - eye.origin_m[0];
        let y = f32::from(block.y[element]) * layer.step_m - eye.origin_m[1];
        let z = f32::from(block.z[element]) * layer.step_m - eye.origin_m[2];
        let width_m = f32::from(block.width[element]) * layer.width_step_m;
        let square = x * x + y * y + z * z;
        let along_m = x * eye.axis[0] + y * eye.axis[1] + z * eye.axis[2];
        let across = square - along_m * along_m;
        let per_range = inverse_root(square);
        let per_across = inverse_root(if across > 1e-6 { across } else { 1e-6 });
        let range_m = square * per_range;
        let step = (along_m * per_range - rows.low) * rows.per_sine;
        let step = if step > 0.0 { step } else { 0.0 };
        let step = if step < (STEPS - 1) as f32 { step } else { (STEPS - 1) as f32 };
        // the lowest digits of a number so large are the rounded step: a conversion that every instruction set has
        steps[element] = (step + LARGE).to_bits() & (STEPS - 1) as u32;
        ranges_m[element] = range_m;
        widths_m[element] = width_m;
        columns[element] = width_m * rows.columns_per_rad * per_across;
        ranges_per_width[element] = range_m / width_m;
    }
    let mut distances_rad = [0.0_f32; WIDTH];
    for element in 0..WIDTH {
        distances_rad[element] = rows.distance_rad[steps[element] as usize & (STEPS - 1)];
    }
    if rows.is_pattern {
        for element in 0..WIDTH {
            let points = distances_rad[element] / (ranges_per_width[element] * ranges_per_width[element]);
            // exp(-points) in a few operations
            let none = 1.0 / (1.0 + points * (1.0 + points * (0.5 + points * (1.0 / 6.0))));
            let is_met = (widths_m[element] > 0.0)
                & (ranges_m[element] >= eye.min_range_m)
                & (ranges_m[element] <= eye.max_range_m);
            missed[element] = if is_met { none } else { 1.0 };
        }
        return product(missed);
    }
    for element in 0..WIDTH {
        // a row surely crosses a patch near its middle, and none near its edges
        let row = 1.5 - FLATNESS * 2.0 * distances_rad[element] * ranges_per_width[element];
        let row = if row > 0.0 { row } else { 0.0 };
        let row = if row < 1.0 { row } else { 1.0 };
        let column = if columns[element] < 1.0 { columns[element] } else { 1.0 };
        let is_met = (widths_m[element] > 0.0)
            & (ranges_m[element] >= eye.min_range_m)
            & (ranges_m[element] <= eye.max_range_m);
        missed[element] = if is_met { 1.0 - row * column } else { 1.0 };
    }
    product(missed)
}

/// One over the root of a normal number, to a few millionths: a guess from its digits and two of Newton's steps, which together take
/// less than a root alone. The guess: Lomont, Fast inverse square root, 2003.
#[inline(always)]
fn inverse_root(value: f32) -> f32 {
    let half = 0.5 * value;
    let guess = f32::from_bits(0x5f37_5a86 - (value.to_bits() >> 1));
    let once = guess * (1.5 - half * guess * guess);
    once * (1.5 - half * once * once)
}

#[inline(always)]
fn product(mut factors: [f32; WIDTH]) -> f32 {
    let mut width = WIDTH / 2;
    while width > 0 {
        for element in 0..width {
            factors[element] *= factors[element + width];
        }
        width /= 2;
    }
    factors[0]
}
