//! Ranges of numbers on the command line and in rig.toml: what a flag asks for in memory and time is bounded before any
//! of it is allocated.

/// A finite number of a range, which is named where it is left. NaN lies in no range.
pub(crate) fn within(
    least: f64,
    most: f64,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.trim().parse().ok().filter(|number: &f64| (least..=most).contains(number));
        number.ok_or_else(|| format!("expected a number from {least} to {most}"))
    }
}

/// A whole number of a range.
pub(crate) fn count(
    least: usize,
    most: usize,
) -> impl Fn(&str) -> Result<usize, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.trim().parse().ok().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| format!("expected a whole number from {least} to {most}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_outside_is_refused_with_the_range() {
        assert_eq!(within(0.5, 100.0)("10"), Ok(10.0));
        for text in ["0", "-1", "NaN", "inf", "1e-9", "1e9", "1e308", "x", ""] {
            assert_eq!(within(0.5, 100.0)(text), Err("expected a number from 0.5 to 100".into()), "{text}");
        }
        assert_eq!(count(1, 16)("16"), Ok(16));
        for text in ["0", "-1", "17", "1.5", "18446744073709551616"] {
            assert_eq!(count(1, 16)(text), Err("expected a whole number from 1 to 16".into()), "{text}");
        }
    }
}
