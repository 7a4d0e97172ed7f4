//! Gaussian process regression: Matérn 5/2 with a length scale per role, observation noise, unknown constant mean.
//!
//! Rasmussen, Williams 2006 (<https://gaussianprocess.org/gpml>), chapters 2, 4 and 5; mean and signal variance at
//! their most likely values in closed form (Jones 2001, doi:10.1023/A:1012771025575).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

use super::ascent::minimise;
use super::forward_substitution::{WIDTH, solve_lower};
use crate::base::instructions::Instructions;

/// Length scales are shares of a variable's range.
const LN_LENGTH: (f64, f64) = (-3.9, 3.0);
/// Noise variance relative to the signal's.
const LN_NOISE: (f64, f64) = (-16.0, 0.7);
/// Weak normal priors of the logarithms (mean, deviation): few points leave a likelihood flat.
const PRIOR_LENGTH: (f64, f64) = (-0.7, 1.2);
const PRIOR_NOISE: (f64, f64) = (-6.0, 3.0);
const FIRST_JITTER: f64 = 1e-10;
const SQRT_5: f64 = 2.236_067_977_499_79;

/// Logarithms of the length scales, one per role, and of the noise ratio.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hyper {
    /// One per role.
    pub ln_lengths: Vec<f64>,
    /// Noise variance over signal variance.
    pub ln_noise: f64,
}

impl Hyper {
    /// The middle of the prior.
    pub(crate) fn typical(roles: usize) -> Self {
        Self { ln_lengths: vec![PRIOR_LENGTH.0; roles], ln_noise: PRIOR_NOISE.0 }
    }

    fn from_slice(values: &[f64]) -> Self {
        let (lengths, noise) = values.split_at(values.len() - 1);
        Self { ln_lengths: lengths.to_vec(), ln_noise: noise[0] }
    }

    fn to_vec(&self) -> Vec<f64> {
        self.ln_lengths.iter().copied().chain([self.ln_noise]).collect()
    }
}

/// Observations: points of the unit cube and values, and the role of each variable.
#[derive(Clone, Debug)]
pub struct Data {
    /// Role of each variable, counted from 0.
    roles: Vec<usize>,
    role_count: usize,
    points: Vec<Vec<f64>>,
    values: DVector<f64>,
}

impl Data {
    /// At least one point; all points as long as `roles`; its numbers are below `role_count`.
    pub(crate) fn new(roles: Vec<usize>, role_count: usize, points: Vec<Vec<f64>>, values: Vec<f64>) -> Self {
        Self { roles, role_count, points, values: DVector::from_vec(values) }
    }

    /// Number of observations.
    pub(crate) fn count(&self) -> usize {
        self.points.len()
    }

    /// Squared differences of all pairs `j <= i`, summed by role, role after role for each pair.
    fn differences(&self) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.points.len() * (self.points.len() + 1) / 2 * self.role_count);
        for j in 0..self.points.len() {
            for i in j..self.points.len() {
                let from = all.len();
                all.resize(from + self.role_count, 0.0);
                for (axis, &role) in self.roles.iter().enumerate() {
                    let difference = self.points[i][axis] - self.points[j][axis];
                    all[from + role] += difference * difference;
                }
            }
        }
        all
    }

    /// The most likely parameters from several starts. Without any that works (it takes values that are not finite):
    /// the first start.
    pub(crate) fn fit(&self, starts: &[Hyper], iterations: usize) -> Hyper {
        let differences = self.differences();
        let mut bounds = vec![LN_LENGTH; self.role_count];
        bounds.push(LN_NOISE);
        let objective = |x: &[f64]| self.loss(&differences, &Hyper::from_slice(x));
        let found = starts
            .iter()
            .filter_map(|start| minimise(objective, &start.to_vec(), &bounds, iterations))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        found.map_or_else(|| starts[0].clone(), |(_, x)| Hyper::from_slice(&x))
    }

    /// Negative logarithm of marginal likelihood and prior, up to a constant, with its gradient.
    fn loss(&self, differences: &[f64], hyper: &Hyper) -> Option<(f64, Vec<f64>)> {
        let n = self.points.len();
        let inverse_squares: Vec<f64> = hyper.ln_lengths.iter().map(|ln| (-2.0 * ln).exp()).collect();
        let noise = hyper.ln_noise.exp();
        let mut kernel = DMatrix::zeros(n, n);
        // the factor by which a change of squared distance moves the kernel, pair by pair
        let mut slopes = Vec::with_capacity(n * (n + 1) / 2);
        let mut pairs = differences.chunks_exact(self.role_count);
        for j in 0..n {
            for (i, pair) in (j..n).zip(&mut pairs) {
                let squared: f64 = pair.iter().zip(&inverse_squares).map(|(d, inverse)| d * inverse).sum();
                let (value, slope) = matern(squared);
                kernel[(i, j)] = value;
                kernel[(j, i)] = value;
                slopes.push(slope);
            }
            kernel[(j, j)] += noise;
        }
        let (cholesky, _) = factor(kernel)?;
        let ln_determinant = 2.0 * cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let inverse = cholesky.inverse();
        let (_, weights, variance) = trend(&cholesky, &self.values);
        let count = n as f64;
        let mut loss = 0.5 * (count * variance.ln() + ln_determinant);
        let mut gradient = vec![0.0; hyper.ln_lengths.len() + 1];
        let mut pairs = differences.chunks_exact(self.role_count).zip(slopes);
        for j in 0..n {
            let pull = |i: usize| inverse[(i, j)] - weights[i] * weights[j] / variance;
            for (i, (pair, slope)) in (j..n).zip(&mut pairs) {
                // each pair stands twice in the matrix
                let pull_slope = pull(i) * slope;
                for (gradient, difference) in gradient.iter_mut().zip(pair) {
                    *gradient += pull_slope * difference;
                }
            }
            gradient[self.role_count] += 0.5 * pull(j) * noise;
        }
        for (gradient, inverse) in gradient.iter_mut().zip(&inverse_squares) {
            *gradient *= inverse;
        }
        let priors = std::iter::repeat_n(PRIOR_LENGTH, hyper.ln_lengths.len()).chain([PRIOR_NOISE]);
        for ((value, (mean, deviation)), slope) in hyper.to_vec().iter().zip(priors).zip(&mut gradient) {
            let z = (value - mean) / deviation;
            loss += 0.5 * z * z;
            *slope += z / deviation;
        }
        (loss.is_finite() && gradient.iter().all(|g| g.is_finite())).then_some((loss, gradient))
    }
}

/// Matérn 5/2 of a squared scaled distance, and minus its derivative by half the squared distance: multiplied by a
/// role's share of the squared distance this is the derivative by that role's logarithmic length.
fn matern(squared: f64) -> (f64, f64) {
    let r = SQRT_5 * squared.sqrt();
    let decay = (-r).exp();
    ((1.0 + r + r * r / 3.0) * decay, 5.0 / 3.0 * (1.0 + r) * decay)
}

/// Cholesky factor and inverse ingredients, with as much jitter as it takes; `None` for what is not finite.
fn factor(mut matrix: DMatrix<f64>) -> Option<(Cholesky<f64, Dyn>, f64)> {
    if matrix.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let mut jitter = 0.0;
    loop {
        if let Some(cholesky) = Cholesky::new(matrix.clone()) {
            return Some((cholesky, jitter));
        }
        let next = if jitter == 0.0 { FIRST_JITTER } else { 10.0 * jitter };
        for i in 0..matrix.nrows() {
            matrix[(i, i)] += next - jitter;
        }
        jitter = next;
        if jitter > 1.0 {
            return None;
        }
    }
}

/// Most likely mean, weights `K^-1 (y - mean)` and signal variance (never zero).
fn trend(cholesky: &Cholesky<f64, Dyn>, values: &DVector<f64>) -> (f64, DVector<f64>, f64) {
    let from_values = cholesky.solve(values);
    let from_ones = cholesky.solve(&DVector::repeat(values.len(), 1.0));
    let mean = from_values.sum() / from_ones.sum();
    let weights = from_values - mean * from_ones;
    let variance = (values.dot(&weights) - mean * weights.sum()) / values.len() as f64;
    (mean, weights, variance.max(1e-12))
}

/// A fitted process.
#[derive(Clone, Debug)]
pub struct GaussianProcess {
    data: Data,
    inverse_lengths: Vec<f64>,
    noise_ratio: f64,
    mean: f64,
    weights: DVector<f64>,
    variance: f64,
    lower: DMatrix<f64>,
    /// The factor applied to ones.
    ones: Vec<f64>,
}

/// What the process believes of the noiseless function at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Expected value.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
}

impl GaussianProcess {
    /// Conditioned on the data; `None` when the data are not finite.
    pub(crate) fn new(data: Data, hyper: &Hyper) -> Option<Self> {
        let n = data.points.len();
        let inverse_lengths: Vec<f64> =
            data.roles.iter().map(|&role| (-hyper.ln_lengths[role]).exp()).collect();
        let noise_ratio = hyper.ln_noise.exp();
        let mut kernel = DMatrix::zeros(n, n);
        for j in 0..n {
            for i in j..n {
                let value = matern(distance(&data.points[i], &data.points[j], &inverse_lengths)).0;
                kernel[(i, j)] = value;
                kernel[(j, i)] = value;
            }
            kernel[(j, j)] += noise_ratio;
        }
        let (cholesky, _) = factor(kernel)?;
        let (mean, weights, variance) = trend(&cholesky, &data.values);
        let lower = cholesky.l();
        let mut ones = vec![[1.0; WIDTH]; n];
        solve_lower(&lower, &mut ones, Instructions::best());
        let ones = ones.into_iter().map(|elements| elements[0]).collect();
        (mean.is_finite() && variance.is_finite()).then_some(Self {
            data,
            inverse_lengths,
            noise_ratio,
            mean,
            weights,
            variance,
            lower,
            ones,
        })
    }

    /// Belief at a point of the unit cube.
    #[cfg(test)]
    fn predict(&self, point: &[f64]) -> Prediction {
        self.predict_many(&[point.to_vec()])[0]
    }

    /// Beliefs at points of the unit cube, `WIDTH` at a time: each entry of the factor is then read once for all of them.
    /// What is believed of a point does not depend on its neighbours in the list.
    pub(crate) fn predict_many(&self, points: &[Vec<f64>]) -> Vec<Prediction> {
        let ones_ones: f64 = self.ones.iter().map(|o| o * o).sum();
        let mut beliefs = Vec::with_capacity(points.len());
        let mut right = vec![[0.0; WIDTH]; self.data.points.len()];
        let instructions = Instructions::best();
        for group in points.chunks(WIDTH) {
            let mut means = [self.mean; WIDTH];
            for (row, known) in self.data.points.iter().enumerate() {
                for (element, point) in group.iter().enumerate() {
                    let value = matern(distance(known, point, &self.inverse_lengths)).0;
                    means[element] += value * self.weights[row];
                    right[row][element] = value;
                }
            }
            solve_lower(&self.lower, &mut right, instructions);
            let (mut explained, mut ones_solved) = ([0.0; WIDTH], [0.0; WIDTH]);
            for (solved, one) in right.iter().zip(&self.ones) {
                for element in 0..WIDTH {
                    explained[element] += solved[element] * solved[element];
                    ones_solved[element] += one * solved[element];
                }
            }
            beliefs.extend((0..group.len()).map(|element| {
                let unknown_mean = (1.0 - ones_solved[element]).powi(2) / ones_ones;
                let variance = self.variance * (1.0 - explained[element] + unknown_mean).max(0.0);
                Prediction { mean: means[element], deviation: variance.sqrt() }
            }));
        }
        beliefs
    }

    /// Standard deviation of the observation noise.
    pub(crate) fn noise_deviation(&self) -> f64 {
        (self.variance * self.noise_ratio).sqrt()
    }
}

fn distance(a: &[f64], b: &[f64], inverse_lengths: &[f64]) -> f64 {
    a.iter().zip(b).zip(inverse_lengths).map(|((a, b), inverse)| ((a - b) * inverse).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(count: usize) -> Data {
        let points: Vec<Vec<f64>> = (0..count)
            .map(|i| vec![(i as f64 * 0.618_034).fract(), (i as f64 * 0.414_214).fract()])
            .collect();
        let values = points.iter().map(|p| (5.0 * p[0]).sin() + 0.3 * p[1]).collect();
        Data::new(vec![0, 1], 2, points, values)
    }

    #[test]
    fn the_gradient_of_the_likelihood_is_its_slope() {
        let data = waves(25);
        let differences = data.differences();
        let at = vec![-0.9, 0.4, -4.0];
        let loss = |x: &[f64]| data.loss(&differences, &Hyper::from_slice(x)).unwrap();
        let (_, gradient) = loss(&at);
        for axis in 0..3 {
            let step = 1e-5;
            let (mut low, mut high) = (at.clone(), at.clone());
            low[axis] -= step;
            high[axis] += step;
            let slope = (loss(&high).0 - loss(&low).0) / (2.0 * step);
            assert!(
                (slope - gradient[axis]).abs() < 1e-4 * slope.abs().max(1.0),
                "{axis}: {slope} {gradient:?}"
            );
        }
    }

    #[test]
    fn a_smooth_function_is_learned_and_the_dull_axis_gets_the_longer_scale() {
        let data = waves(40);
        let hyper = data.fit(&[Hyper::typical(2)], 100);
        assert!(hyper.ln_lengths[1] > hyper.ln_lengths[0] + 0.5, "{hyper:?}");
        let process = GaussianProcess::new(data, &hyper).unwrap();
        for point in [[0.3_f64, 0.5], [0.72, 0.11], [0.5, 0.9]] {
            let truth = (5.0 * point[0]).sin() + 0.3 * point[1];
            let belief = process.predict(&point);
            assert!((belief.mean - truth).abs() < 0.02, "{point:?}: {belief:?}, true {truth}");
            assert!((belief.mean - truth).abs() < 4.0 * belief.deviation + 1e-3);
        }
    }

    #[test]
    fn points_given_many_times_do_not_break_it() {
        let points = vec![vec![0.4]; 30];
        let data = Data::new(vec![0], 1, points, vec![1.0; 30]);
        let hyper = Hyper { ln_lengths: vec![0.0], ln_noise: LN_NOISE.0 };
        let process = GaussianProcess::new(data.clone(), &hyper).unwrap();
        assert!((process.predict(&[0.4]).mean - 1.0).abs() < 1e-6);
        assert!(process.predict(&[0.9]).deviation.is_finite());
        let fitted = data.fit(&[Hyper::typical(1)], 20);
        assert!(fitted.ln_lengths[0].is_finite() && fitted.ln_noise.is_finite());
    }

    #[test]
    fn a_singular_kernel_gets_the_jitter_it_needs() {
        let (_, jitter) = factor(DMatrix::from_element(6, 6, 1.0)).unwrap();
        assert!((FIRST_JITTER..1e-6).contains(&jitter), "{jitter}");
        assert!(factor(DMatrix::from_element(2, 2, f64::NAN)).is_none());
    }
}
