//! Medians over seeds and how sure they are.

use crate::base::rng::Rng;
use crate::base::statistics::{quantile as at, sorted};
use crate::report::chart;

const RESAMPLES: usize = 2000;

/// Median, quartiles and extremes of a sample, and a 95 % interval of the median.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// How many values.
    pub count: usize,
    /// Least.
    pub min: f64,
    /// First quartile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// Third quartile.
    pub high: f64,
    /// Max.
    pub max: f64,
    /// 95 % of the medians of resampled values lie in here (Efron 1979, doi:10.1214/aos/1176344552).
    pub interval: [f64; 2],
}

impl Spread {
    /// Of these values; none without any.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        let sorted = sorted(values.iter().copied());
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let mut rng = Rng::new(sorted.len() as u64, 0);
        let mut medians: Vec<f64> = (0..RESAMPLES)
            .map(|_| {
                let mut drawn: Vec<f64> =
                    sorted.iter().map(|_| sorted[rng.below(sorted.len() as u64) as usize]).collect();
                drawn.sort_by(f64::total_cmp);
                at(&drawn, 0.5)
            })
            .collect();
        medians.sort_by(f64::total_cmp);
        Some(Self {
            count: sorted.len(),
            min,
            low: at(&sorted, 0.25),
            median: at(&sorted, 0.5),
            high: at(&sorted, 0.75),
            max,
            interval: [at(&medians, 0.025), at(&medians, 0.975)],
        })
    }

    /// Median, then the range from min to max.
    pub(crate) fn words(&self, decimals: usize) -> String {
        let [min, median, max] =
            [self.min, self.median, self.max].map(|value| chart::number(value, decimals));
        if self.count == 1 { median } else { format!("{median} ({min} to {max})") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_and_an_interval_that_holds_the_median() {
        let values: Vec<f64> = (0..=20).rev().map(f64::from).collect();
        let spread = Spread::of(&values).unwrap();
        assert_eq!(
            [spread.min, spread.low, spread.median, spread.high, spread.max],
            [0.0, 5.0, 10.0, 15.0, 20.0]
        );
        assert!(spread.interval[0] < 10.0 && spread.interval[1] > 10.0, "{spread:?}");
        assert_eq!(Spread::of(&[3.0]).unwrap().interval, [3.0, 3.0]);
        assert_eq!(Spread::of(&[]), None);
    }
}
