//! What every method is given at the start.

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

/// The settings that every method starts with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Source of all random numbers.
    pub seed: u64,
    /// Evaluations planned: methods that split their budget do so by it. The loop's own limit may differ.
    pub budget: usize,
    /// Stop by the method's own published rule; otherwise a method that has converged starts again elsewhere.
    pub early_stop: bool,
    /// Points that a model proposes at once, to be evaluated side by side; methods with populations have sizes of their
    /// own.
    pub batch: NonZeroUsize,
    /// By what a model chooses its next point.
    pub acquisition: Acquisition,
}

impl Settings {
    /// A search by any method with so many evaluations, one point of a model at a time.
    pub fn new(seed: u64, budget: usize) -> Self {
        Self {
            seed,
            budget,
            early_stop: false,
            batch: NonZeroUsize::MIN,
            acquisition: Acquisition::default(),
        }
    }
}

/// The quantity that a model's next point maximizes. "Plus" is the guard against over-exploitation of Bull 2011.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Acquisition {
    /// Logarithm of the expected improvement of the next observation, noise and all, guarded.
    #[default]
    LogEiPlus,
    /// The same without the guard.
    LogEi,
    /// Expected improvement of what lies under the noise, guarded: as published.
    EiPlus,
    /// The same without the guard.
    Ei,
}

impl Acquisition {
    /// Whether a point with a deviation far below the noise is refused.
    pub(super) fn is_guarded(self) -> bool {
        matches!(self, Self::LogEiPlus | Self::EiPlus)
    }
}
