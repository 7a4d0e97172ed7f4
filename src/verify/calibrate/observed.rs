//! Which unknowns of a mount are observable from the surfaces it saw, with the attitude of the body known.

use nalgebra::{SMatrix, SVector, SymmetricEigen};

/// Names of the unknowns, in order: shifts along and turns about the mount frame's axes, range offset.
pub const UNKNOWNS: [&str; 7] = ["x", "y", "z", "roll", "tilt", "yaw", "range"];

/// Share of the largest information below which a direction counts as degenerate: exact simulated planes give 0 for it.
const DEGENERATE: f64 = 1e-4;
/// Least information per ray about an unknown, of at most 1, the other unknowns free.
const LEAST_INFORMATION: f64 = 3e-4;
/// Part of an unknown that may lie in a degenerate direction, squared.
const MAX_DEGENERATE_PART: f64 = 0.01;

/// What is observable of one sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observed {
    /// By unknown.
    pub is_observable: [bool; 7],
    /// Largest over least eigenvalue; none where a direction is degenerate.
    pub condition_number: Option<f64>,
    /// Observable directions, in the unknowns' own units: columns of 7 numbers.
    pub basis: Vec<[f64; 7]>,
    /// Loose directions, normalised.
    degenerate: Vec<SVector<f64, 7>>,
    /// Size of a unit of each unknown when normalised.
    scale: [f64; 7],
}

impl Observed {
    /// From the sum of squares of the rows of one sensor.
    pub(crate) fn of(sum: &SMatrix<f64, 7, 7>, rays: f64, lever_m: f64) -> Self {
        if rays < 1.0 {
            return Self::default();
        }
        let scale: [f64; 7] =
            std::array::from_fn(|place| if (3..6).contains(&place) { lever_m.max(1e-6) } else { 1.0 });
        let normalised = SMatrix::<f64, 7, 7>::from_fn(|row, column| {
            sum[(row, column)] / (rays * scale[row] * scale[column])
        });
        let eigen = SymmetricEigen::new(normalised);
        let largest = eigen.eigenvalues.max();
        let (mut basis, mut degenerate, mut least) = (Vec::new(), Vec::new(), f64::INFINITY);
        for place in 0..7 {
            let direction: SVector<f64, 7> = eigen.eigenvectors.column(place).into();
            if eigen.eigenvalues[place] < DEGENERATE * largest {
                degenerate.push(direction);
            } else {
                least = least.min(eigen.eigenvalues[place]);
                basis.push(std::array::from_fn(|unknown| direction[unknown] / scale[unknown]));
            }
        }
        // information about each unknown, the others unknown: inverse of the inverse's diagonal
        let mut variance = SVector::<f64, 7>::zeros();
        for place in 0..7 {
            let value = eigen.eigenvalues[place];
            if value >= DEGENERATE * largest {
                variance += eigen.eigenvectors.column(place).map(|part| part * part) / value;
            }
        }
        let mut observed = Self {
            is_observable: [false; 7],
            condition_number: (degenerate.is_empty() && least > 0.0).then(|| largest / least),
            basis,
            degenerate,
            scale,
        };
        observed.is_observable = std::array::from_fn(|place| {
            let mut unit = [0.0; 7];
            unit[place] = 1.0;
            observed.tells(&unit) && 1.0 / variance[place] >= LEAST_INFORMATION
        });
        observed
    }

    /// Whether a combination of the unknowns has next to no part in a degenerate direction.
    pub(crate) fn tells(&self, weights: &[f64; 7]) -> bool {
        let normalised = SVector::<f64, 7>::from_fn(|place, _| weights[place] * self.scale[place].max(1e-12));
        let length = normalised.norm_squared();
        let degenerate: f64 =
            self.degenerate.iter().map(|direction| direction.dot(&normalised).powi(2)).sum();
        !self.basis.is_empty() && degenerate < MAX_DEGENERATE_PART * length
    }

    /// Names of what is observable.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        UNKNOWNS
            .iter()
            .zip(self.is_observable)
            .filter(|(_, is_observable)| *is_observable)
            .map(|(name, _)| *name)
            .collect()
    }
}
