//! Ridge fits. Their sums are added in a fixed order: a library's product of matrices rounds by the instructions of the machine,
//! and a search finds the same mounts on every one.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A fitted linear function of terms.
pub(super) struct RidgeFit {
    pub weights: Vec<f64>,
    factors: Cholesky<f64, Dyn>,
}

impl RidgeFit {
    /// To rows of terms, all of one length, and a target for each. `ridge` by term: its weight of size one against the data, in
    /// rows. None where terms depend on each other.
    pub(super) fn new(rows: &[Vec<f64>], targets: &[f64], ridge: impl Fn(usize) -> f64) -> Option<Self> {
        let columns = rows.first().map_or(0, Vec::len);
        let product = |a: usize, b: usize| rows.iter().map(|row| row[a] * row[b]).sum::<f64>();
        let normal =
            DMatrix::from_fn(columns, columns, |a, b| product(a, b) + if a == b { ridge(a) } else { 0.0 });
        let right = DVector::from_fn(columns, |column, _| {
            rows.iter().zip(targets).map(|(row, target)| row[column] * target).sum()
        });
        let factors = normal.cholesky()?;
        Some(Self { weights: factors.solve(&right).iter().copied().collect(), factors })
    }

    pub(super) fn value(&self, terms: &[f64]) -> f64 {
        dot(&self.weights, terms)
    }

    /// By how much the value at a row follows the row's own target (Hastie, Tibshirani, Friedman 2009, equation 3.47).
    pub(super) fn leverage(&self, row: &[f64]) -> f64 {
        dot(row, self.factors.solve(&DVector::from_column_slice(row)).as_slice())
    }
}

/// Of the shorter one's length.
pub(super) fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}
