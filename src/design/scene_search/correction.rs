//! What the model gets wrong, as a smooth function of the mounts: a ridge fit of exact minus model.

use nalgebra::{DMatrix, DVector};

use crate::rig::Mount;

/// Terms of one master without the constant.
const TERMS: usize = 5;
/// Weight of a term of size one against the data, in observations.
const RIDGE: f64 = 0.05;
/// Lengths and angles over which the terms are of size one.
const LENGTH_M: f64 = 0.15;
const PITCH_RAD: f64 = 0.5;

/// The fitted error of a model.
#[derive(Clone, Debug, Default)]
pub(super) struct Correction {
    mean: f64,
    weights: Vec<f64>,
    error: Option<ModelError>,
}

/// How far the corrected model is off mounts that it was not fitted to.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub(crate) struct ModelError {
    /// Exact minus corrected, each mount left out in turn: mean, voxels.
    pub mean: f64,
    /// Standard deviation, voxels.
    pub sd: f64,
    /// Mounts evaluated exactly.
    pub n: usize,
    /// Exact minus model before the correction, mean, voxels.
    pub uncorrected_mean: f64,
}

/// Inward tilts (x and pitch of opposite sign) are under-rated, and heights are stored in layers.
fn terms(mounts: &[Mount]) -> Vec<f64> {
    let of_master = |mount: &Mount| -> [f64; TERMS] {
        let (x, y, z) = (mount.x_m / LENGTH_M, mount.y_m / LENGTH_M, mount.z_m / LENGTH_M);
        let pitch = mount.pitch_rad / PITCH_RAD;
        let side = if pitch < 0.0 { -1.0 } else { 1.0 };
        [pitch.abs(), x * side, x * pitch, z, y * side]
    };
    mounts.iter().flat_map(of_master).collect()
}

impl Correction {
    /// Fits to the masters of exactly evaluated rigs and exact minus model of each.
    pub(crate) fn fit(observed: &[(Vec<Mount>, f64)]) -> Self {
        let rows: Vec<Vec<f64>> = observed.iter().map(|(mounts, _)| terms(mounts)).collect();
        let Some(columns) = rows.first().map(Vec::len) else { return Self::default() };
        let n = rows.len();
        let mean = observed.iter().map(|(_, error)| error).sum::<f64>() / n as f64;
        let mut middle = vec![0.0; columns];
        rows.iter()
            .for_each(|row| middle.iter_mut().zip(row).for_each(|(sum, value)| *sum += value / n as f64));
        let design = DMatrix::from_fn(n, columns, |row, column| rows[row][column] - middle[column]);
        let target = DVector::from_fn(n, |row, _| observed[row].1 - mean);
        let mut normal = design.transpose() * &design;
        for column in 0..columns {
            normal[(column, column)] += RIDGE * n as f64 * 0.1 + RIDGE;
        }
        let Some(inverse) = normal.cholesky().map(|factors| factors.inverse()) else {
            return Self { mean, weights: vec![0.0; columns], error: None };
        };
        let weights = &inverse * design.transpose() * &target;
        let hat = &design * inverse * design.transpose();
        let residuals = &target - &design * &weights;
        // each left out in turn, without fitting again (Hastie, Tibshirani, Friedman 2009, equation 7.64)
        let left_out: Vec<f64> =
            (0..n).map(|row| residuals[row] / (1.0 - hat[(row, row)] - 1.0 / n as f64).max(1e-3)).collect();
        let left_mean = left_out.iter().sum::<f64>() / n as f64;
        let square = left_out.iter().map(|error| (error - left_mean).powi(2)).sum::<f64>();
        let sd = (square / (n.max(2) - 1) as f64).sqrt();
        let constant = mean - weights.iter().zip(&middle).map(|(weight, value)| weight * value).sum::<f64>();
        Self {
            mean: constant,
            weights: weights.iter().copied().collect(),
            error: (n > 2).then_some(ModelError { mean: left_mean, sd, n, uncorrected_mean: mean }),
        }
    }

    /// What is added to the model's score.
    pub(crate) fn of(&self, mounts: &[Mount]) -> f64 {
        self.mean + self.weights.iter().zip(terms(mounts)).map(|(weight, term)| weight * term).sum::<f64>()
    }

    pub(crate) fn error(&self) -> Option<ModelError> {
        self.error
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    #[test]
    fn a_smooth_error_is_found_and_the_rest_is_reported() {
        let mut rng = Rng::new(3, 0);
        let mut observe = |count: usize, noise: f64| -> Vec<(Vec<Mount>, f64)> {
            (0..count)
                .map(|_| {
                    let mount = Mount {
                        x_m: rng.between(0.0, 0.15),
                        y_m: rng.between(-0.25, 0.25),
                        z_m: rng.between(-0.15, 0.15),
                        pitch_rad: rng.between(-1.0, 1.0),
                        ..Mount::default()
                    };
                    let error =
                        400.0 + 300.0 * mount.x_m * mount.pitch_rad / 0.075 - 200.0 * mount.z_m / 0.15;
                    (vec![mount], error + noise * rng.normal())
                })
                .collect()
        };
        let correction = Correction::fit(&observe(30, 20.0));
        let error = correction.error().unwrap();
        assert!((10.0..45.0).contains(&error.sd) && error.n == 30, "{error:?}");
        let off: f64 = observe(200, 0.0)
            .iter()
            .map(|(mounts, error)| (correction.of(mounts) - error).powi(2) / 200.0)
            .sum();
        assert!(off.sqrt() < 40.0, "{off}");
        assert_eq!(Correction::fit(&[]).of(&[Mount::default()]), 0.0);
    }
}
