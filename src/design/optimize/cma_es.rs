//! Covariance matrix adaptation with a margin that keeps integers moving, and restarts with growing populations.
//!
//! CMA-ES: Hansen 2016 (arXiv:1604.00772). Margin: Hamano, Saito, Nomura, Shirakawa 2022
//! (doi:10.1145/3512290.3528827). Restarts: Auger, Hansen 2005 (doi:10.1109/CEC.2005.1554902). Works in the unit cube; a
//! sample beyond it is drawn again a few times, then moved to the border.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::{Candidate, Optimizer, Settings, Space, Trial, generator, normal};
use crate::base::rng::Rng;

const FIRST_SIGMA: f64 = 0.25;
const LAST_SIGMA: f64 = 1e-6;
const CONDITION_MAX: f64 = 1e14;
const REDRAWS: usize = 20;
/// A run is over when its best does not move for so many generations (more with dimension).
const STALL_GENERATIONS: usize = 20;
/// Populations double at each restart up to this factor.
const GROWTH_MAX: usize = 16;

/// CMA-ES with margin.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CmaEs {
    space: Space,
    seed: u64,
    early_stop: bool,
    step: u64,
    restarts: u32,
    run: Run,
    /// What was asked: before the margin's scaling, and in the cube.
    asked: Vec<(Vec<f64>, Vec<f64>)>,
}

/// One run between restarts; vectors in the unit cube.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Run {
    generation: u32,
    members: usize,
    sigma: f64,
    mean: Vec<f64>,
    covariance: DMatrix<f64>,
    path_sigma: Vec<f64>,
    path_covariance: Vec<f64>,
    /// The margin's scale of each axis.
    margin_scale: Vec<f64>,
    best_scores: Vec<(f64, f64)>,
    is_degenerate: bool,
}

/// Constants that follow from dimension and population (Hansen 2016, table 1; positive weights only).
struct Rates {
    weights: Vec<f64>,
    effective: f64,
    c_sigma: f64,
    damping: f64,
    c_path: f64,
    c_one: f64,
    c_mu: f64,
    expected_norm: f64,
}

impl Rates {
    fn new(dimensions: usize, members: usize) -> Self {
        let n = dimensions as f64;
        let parents = members / 2;
        let raw: Vec<f64> =
            (0..parents).map(|i| (members as f64 / 2.0 + 0.5).ln() - (i as f64 + 1.0).ln()).collect();
        let total: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / total).collect();
        let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let c_sigma = (effective + 2.0) / (n + effective + 5.0);
        let c_one = 2.0 / ((n + 1.3).powi(2) + effective);
        let c_mu =
            (2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0).powi(2) + effective)).min(1.0 - c_one);
        Self {
            weights,
            effective,
            c_sigma,
            damping: 1.0 + 2.0 * (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma,
            c_path: (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n),
            c_one,
            c_mu: c_mu.max(0.0),
            expected_norm: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}

impl Run {
    fn new(mean: Vec<f64>, members: usize) -> Self {
        let n = mean.len();
        Self {
            generation: 0,
            members,
            sigma: FIRST_SIGMA,
            mean,
            covariance: DMatrix::identity(n, n),
            path_sigma: vec![0.0; n],
            path_covariance: vec![0.0; n],
            margin_scale: vec![1.0; n],
            best_scores: Vec::new(),
            is_degenerate: false,
        }
    }

    /// Eigenvectors and square roots of the eigenvalues; `None` when the matrix has lost its shape.
    fn factors(&self) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let eigen = SymmetricEigen::try_new(self.covariance.clone(), 1e-14, 10_000)?;
        let (least, max) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        let sound = least > 0.0 && max.is_finite() && max / least < CONDITION_MAX;
        sound.then(|| (eigen.eigenvectors, eigen.eigenvalues.map(f64::sqrt)))
    }

    fn is_over(&self) -> bool {
        let stall = STALL_GENERATIONS + 5 * self.mean.len() / self.members;
        let stalled = self.best_scores.len() > stall && {
            let recent = &self.best_scores[self.best_scores.len() - stall..];
            recent.iter().all(|score| *score == recent[0])
        };
        stalled || self.is_degenerate || self.sigma < LAST_SIGMA || self.sigma > 1e3
    }

    /// The update of mean, paths, covariance and step size from the better half, best first.
    fn learn(&mut self, sorted: &[&(Vec<f64>, Vec<f64>)]) {
        let n = self.mean.len();
        let rates = Rates::new(n, self.members);
        let Some((axes, lengths)) = self.factors() else {
            self.is_degenerate = true;
            return;
        };
        // steps in the space before the margin's scaling: (x - mean) / (sigma * scale)
        let steps: Vec<DVector<f64>> = sorted
            .iter()
            .take(rates.weights.len())
            .map(|(_, x)| {
                let step = |i: usize| (x[i] - self.mean[i]) / (self.sigma * self.margin_scale[i]);
                DVector::from_fn(n, |i, _| step(i))
            })
            .collect();
        let mut mean_step = DVector::zeros(n);
        for (weight, step) in rates.weights.iter().zip(&steps) {
            mean_step += *weight * step;
        }
        for i in 0..n {
            self.mean[i] = (self.mean[i] + self.sigma * self.margin_scale[i] * mean_step[i]).clamp(0.0, 1.0);
        }
        let whitened = &axes * (axes.transpose() * &mean_step).component_div(&lengths);
        let gain = (rates.c_sigma * (2.0 - rates.c_sigma) * rates.effective).sqrt();
        for i in 0..n {
            self.path_sigma[i] = (1.0 - rates.c_sigma) * self.path_sigma[i] + gain * whitened[i];
        }
        self.generation += 1;
        let norm = self.path_sigma.iter().map(|p| p * p).sum::<f64>().sqrt();
        let unbiased = norm / (1.0 - (1.0 - rates.c_sigma).powi(2 * self.generation as i32)).sqrt();
        let slow = unbiased < (1.4 + 2.0 / (n as f64 + 1.0)) * rates.expected_norm;
        let slow = f64::from(u8::from(slow));
        let gain = slow * (rates.c_path * (2.0 - rates.c_path) * rates.effective).sqrt();
        for i in 0..n {
            self.path_covariance[i] = (1.0 - rates.c_path) * self.path_covariance[i] + gain * mean_step[i];
        }
        let path = DVector::from_column_slice(&self.path_covariance);
        let memo = (1.0 - slow) * rates.c_one * rates.c_path * (2.0 - rates.c_path);
        self.covariance *= 1.0 - rates.c_one - rates.c_mu + memo;
        self.covariance += rates.c_one * &path * path.transpose();
        for (weight, step) in rates.weights.iter().zip(&steps) {
            self.covariance += rates.c_mu * *weight * step * step.transpose();
        }
        self.covariance = 0.5 * (&self.covariance + self.covariance.transpose());
        self.sigma *= ((rates.c_sigma / rates.damping) * (norm / rates.expected_norm - 1.0)).min(1.0).exp();
    }

    /// Moves mean and scale of each integer axis so that its neighbouring values keep a small probability.
    fn keep_margin(&mut self, space: &Space) {
        let alpha = 1.0 / (self.mean.len() * self.members) as f64;
        for (axis, variable) in space.variables().iter().enumerate() {
            let count = variable.high - variable.low + 1.0;
            if !variable.integer || count < 2.0 {
                continue;
            }
            let deviation =
                self.sigma * self.covariance[(axis, axis)].max(0.0).sqrt() * self.margin_scale[axis];
            if deviation <= 0.0 {
                continue;
            }
            let bin = (self.mean[axis] * count).floor().clamp(0.0, count - 1.0);
            let (low, high) = (bin / count, (bin + 1.0) / count);
            let probability_low =
                if bin > 0.0 { normal::below((low - self.mean[axis]) / deviation) } else { 0.0 };
            let probability_high =
                if bin < count - 1.0 { normal::below((self.mean[axis] - high) / deviation) } else { 0.0 };
            if bin == 0.0 {
                if probability_high < alpha {
                    self.mean[axis] = high + normal::quantile(alpha) * deviation;
                }
            } else if bin == count - 1.0 {
                if probability_low < alpha {
                    self.mean[axis] = low - normal::quantile(alpha) * deviation;
                }
            } else if probability_low < alpha / 2.0 || probability_high < alpha / 2.0 {
                let reach_low = -normal::quantile(probability_low.clamp(alpha / 2.0, 0.45));
                let reach_high = -normal::quantile(probability_high.clamp(alpha / 2.0, 0.45));
                let wanted = (high - low) / (reach_low + reach_high);
                self.mean[axis] = low + reach_low * wanted;
                self.margin_scale[axis] *= wanted / deviation;
            }
            self.mean[axis] = self.mean[axis].clamp(0.0, 1.0);
        }
    }
}

impl CmaEs {
    /// Nothing evaluated yet.
    pub(crate) fn new(space: Space, settings: Settings) -> Self {
        let run = Run::new(vec![0.5; space.len()], first_members(&space));
        let Settings { seed, early_stop, .. } = settings;
        Self { space, seed, early_stop, step: 0, restarts: 0, run, asked: Vec::new() }
    }

    fn draw(&self, axes: &DMatrix<f64>, lengths: &DVector<f64>, rng: &mut Rng) -> (Vec<f64>, Vec<f64>) {
        let n = self.space.len();
        let mut unit = vec![0.0; n];
        for attempt in 0..=REDRAWS {
            let normal = DVector::from_fn(n, |_, _| rng.normal());
            let step = axes * normal.component_mul(lengths);
            for i in 0..n {
                unit[i] = self.run.mean[i] + self.run.sigma * self.run.margin_scale[i] * step[i];
            }
            if attempt == REDRAWS || unit.iter().all(|u| (0.0..=1.0).contains(u)) {
                break;
            }
        }
        let inside: Vec<f64> = unit.iter().map(|u| u.clamp(0.0, 1.0)).collect();
        (unit, inside)
    }
}

fn first_members(space: &Space) -> usize {
    4 + (3.0 * (space.len() as f64).ln()) as usize
}

impl Optimizer for CmaEs {
    fn ask(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.seed, self.step);
        self.step += 1;
        if self.run.is_over() {
            if self.early_stop {
                return Vec::new();
            }
            self.restarts += 1;
            let growth = GROWTH_MAX.min(1 << self.restarts.min(30));
            let mean = (0..self.space.len()).map(|_| rng.uniform()).collect();
            self.run = Run::new(mean, first_members(&self.space) * growth);
        }
        let n = self.space.len();
        let (axes, lengths) = self.run.factors().unwrap_or_else(|| {
            self.run.covariance = DMatrix::identity(n, n);
            (DMatrix::identity(n, n), DVector::repeat(n, 1.0))
        });
        self.asked = (0..self.run.members).map(|_| self.draw(&axes, &lengths, &mut rng)).collect();
        self.asked.iter().map(|(_, unit)| Candidate { values: self.space.values_at(unit) }).collect()
    }

    fn tell(&mut self, trials: &[Trial]) {
        let asked = std::mem::take(&mut self.asked);
        let mut order: Vec<usize> = (0..trials.len()).collect();
        order.sort_by(|&a, &b| trials[a].order(&trials[b]));
        let Some(&first) = order.first() else { return };
        self.run.best_scores.push((trials[first].violation, trials[first].score));
        let sorted: Vec<_> = order.iter().map(|&index| &asked[index]).collect();
        self.run.learn(&sorted);
        self.run.keep_margin(&self.space);
    }
}
