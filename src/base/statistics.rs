//! Order statistics that several parts need.

/// Quantile of sorted values, by straight lines between them (Hyndman and Fan's type 7, doi:10.1080/00031305.1996.10473566).
/// NaN without values.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (place - place.floor()) * (sorted[above] - sorted[below])
}

/// The values in ascending order.
pub(crate) fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The middle value, the upper one of two; none of nothing. Puts the values into another order.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// 1.4826 times the median size of errors: their standard deviation if they are normal, whatever a few of them are.
pub(crate) fn robust_deviation(sizes: &mut [f64]) -> Option<f64> {
    median(sizes).map(|middle| 1.4826 * middle)
}

/// The first of equals; 0 without values.
pub(crate) fn index_of_max(values: &[f64]) -> usize {
    (1..values.len()).fold(0, |best, at| if values[at] > values[best] { at } else { best })
}

/// Mean and standard deviation of a sample; the deviation is 0 for fewer than two values, both NaN without any.
pub(crate) fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    if values.len() < 2 {
        return (mean, 0.0 * mean);
    }
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (mean, (squares / (count - 1.0)).sqrt())
}

/// Chance of a value of Student's t at least this far from zero, either side, for whole degrees of freedom (Abramowitz and
/// Stegun, 26.7.3 and 26.7.4). Own code: `statrs` brings a second linear algebra for these lines.
pub(crate) fn student_two_sided(t: f64, freedom: usize) -> f64 {
    if !t.is_finite() || freedom == 0 {
        return if t.is_infinite() && freedom > 0 { 0.0 } else { 1.0 };
    }
    let angle = (t.abs() / (freedom as f64).sqrt()).atan();
    let (sine, cosine) = angle.sin_cos();
    let is_odd = freedom % 2 == 1;
    let (mut sum, mut term) = (0.0, if is_odd { cosine } else { 1.0 });
    for step in (if is_odd { 3 } else { 2 }..=freedom).step_by(2) {
        sum += term;
        term *= cosine * cosine * (step - 1) as f64 / step as f64;
    }
    let inside = if is_odd { (angle + sine * sum) * std::f64::consts::FRAC_2_PI } else { sine * sum };
    (1.0 - inside).clamp(0.0, 1.0)
}

/// Where [`student_two_sided`] falls to this chance.
pub(crate) fn student_quantile(chance: f64, freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1e6);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if student_two_sided(middle, freedom) > chance {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Spearman's rank correlation of two lists of the same length, equal values sharing their mean rank
/// (doi:10.2307/1412159). None where one of the lists does not vary.
pub(crate) fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let (a, b) = (ranks(a), ranks(b));
    let (mean_a, mean_b) = (mean_and_deviation(&a).0, mean_and_deviation(&b).0);
    let sum = |product: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(&b).map(|(a, b)| product(a - mean_a, b - mean_b)).sum()
    };
    let both = sum(&|a, b| a * b);
    let scale = (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt();
    (scale > 0.0).then(|| both / scale)
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let mut end = start;
        while end < order.len() && values[order[end]] == values[order[start]] {
            end += 1;
        }
        for place in &order[start..end.max(start + 1)] {
            ranks[*place] = (start + end.max(start + 1) - 1) as f64 / 2.0;
        }
        start = end.max(start + 1);
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the printed tables.
    #[test]
    fn students_t_is_that_of_the_tables() {
        for (freedom, expected) in
            [(1, 12.706), (2, 4.303), (5, 2.571), (10, 2.228), (29, 2.045), (120, 1.980)]
        {
            let found = student_quantile(0.05, freedom);
            assert!((found - expected).abs() < 6e-4, "{freedom}: {found}");
        }
        assert_eq!(student_two_sided(0.0, 4), 1.0);
        assert!((student_two_sided(3.747, 4) - 0.02).abs() < 2e-5);
    }

    #[test]
    fn quantiles_lie_on_straight_lines() {
        let values = sorted([4.0, 1.0, 3.0, 2.0]);
        assert_eq!([0.0, 0.5, 0.25, 1.0].map(|share| quantile(&values, share)), [1.0, 2.5, 1.75, 4.0]);
        assert!(quantile(&[], 0.5).is_nan());
        assert_eq!(quantile(&[7.0], 0.9), 7.0);
    }

    #[test]
    fn the_first_of_equal_maxima() {
        assert_eq!(index_of_max(&[1.0, 3.0, 3.0, 2.0]), 1);
        assert_eq!((index_of_max(&[7.0]), index_of_max(&[])), (0, 0));
    }

    #[test]
    fn spread_of_a_sample() {
        let (mean, deviation) = mean_and_deviation(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert!((mean - 5.0).abs() < 1e-12 && (deviation - (32.0_f64 / 7.0).sqrt()).abs() < 1e-12);
        assert_eq!(mean_and_deviation(&[3.0]), (3.0, 0.0));
        assert!(mean_and_deviation(&[]).0.is_nan());
    }

    /// Figures of SciPy's `spearmanr`.
    #[test]
    fn rank_correlation_with_and_without_ties() {
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-9, "{a:?} {b}");
        near(rank_correlation(&[1.0, 2.0, 3.0], &[10.0, 20.0, 30.0]), 1.0);
        near(
            rank_correlation(&[1.0, 2.0, 3.0, 4.0, 5.0], &[5.0, 6.0, 7.0, 8.0, 7.0]),
            0.820_782_681_668_123_3,
        );
        assert_eq!(rank_correlation(&[1.0, 1.0], &[1.0, 2.0]), None);
        assert_eq!(rank_correlation(&[], &[]), None);
    }
}
