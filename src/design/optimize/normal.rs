//! The standard normal distribution.

use std::f64::consts::{PI, SQRT_2};

/// Density.
pub(crate) fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * PI).sqrt()
}

/// Probability of a value below `z`.
pub(crate) fn below(z: f64) -> f64 {
    0.5 * libm::erfc(-z / SQRT_2)
}

/// The value below which lies this probability, in (0, 1): bisection to the last bit of use, then Newton.
pub(crate) fn quantile(probability: f64) -> f64 {
    let (mut low, mut high) = (-38.0, 38.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The expected excess of a standard normal over `-z`; 0 from about -38 down.
pub(crate) fn expected_excess(z: f64) -> f64 {
    density(z) + z * below(z)
}

/// Logarithm of [`expected_excess`] without underflow (Ament et al. 2023, arXiv:2310.20708, appendix A).
pub(crate) fn ln_expected_excess(z: f64) -> f64 {
    if z > -1.0 {
        return expected_excess(z).ln();
    }
    let ln_density = -0.5 * z * z - 0.5 * (2.0 * PI).ln();
    if z > -25.0 {
        // below(z) / density(z) stays a normal number this far out
        let ratio = -z * below(z) / density(z);
        if ratio < 1.0 - 1e-9 {
            return ln_density + (1.0 - ratio).ln();
        }
    }
    // 1 - |z| * Mills ratio -> 1 / z^2 - 3 / z^4
    let inverse = 1.0 / (z * z);
    ln_density + (inverse - 3.0 * inverse * inverse).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_the_tables() {
        assert!((below(1.0) - 0.841_344_746_068_543).abs() < 1e-14);
        assert!((below(-6.0) - 9.865_876_450_376_98e-10).abs() < 1e-22);
        assert!((quantile(0.975) - 1.959_963_984_540_054).abs() < 1e-12);
        assert!((quantile(1e-9) + 5.997_807_015_007_686).abs() < 1e-9);
    }

    #[test]
    fn the_logarithm_of_the_expected_excess_is_smooth_into_the_far_tail() {
        assert!((ln_expected_excess(0.0) - (1.0 / (2.0 * PI).sqrt()).ln()).abs() < 1e-12);
        let mut last = ln_expected_excess(2.0);
        for step in 1..4000 {
            let z = 2.0 - 0.05 * f64::from(step);
            let now = ln_expected_excess(z);
            // the slope is about -z, never more than that by much
            assert!(
                now.is_finite() && now < last && last - now < 0.05 * (z.abs() + 1.5),
                "{z}: {last} {now}"
            );
            last = now;
        }
    }
}
