//! Numbers as people read them.

/// A number for people: thousands separated, as many decimals as asked for.
pub fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return value.to_string();
    }
    let text = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = text.split_once('.').map_or((text.as_str(), ""), |(w, f)| (w, f));
    let mut grouped = String::new();
    for (place, digit) in whole.chars().enumerate() {
        if place > 0 && (whole.len() - place) % 3 == 0 {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    let sign = if value < 0.0 && text.chars().any(|c| ('1'..='9').contains(&c)) { "-" } else { "" };
    if fraction.is_empty() { format!("{sign}{grouped}") } else { format!("{sign}{grouped}.{fraction}") }
}

/// How many, for people: thousands separated.
pub(crate) fn count(count: u64) -> String {
    number(count as f64, 0)
}

/// A difference for people: always signed, and `+` where it rounds to nothing.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = format!("{value:+.decimals$}");
    let is_nothing = value.is_finite() && !text.chars().any(|c| ('1'..='9').contains(&c));
    if is_nothing { text.replace('-', "+") } else { text }
}

/// So many of something: `1 frame`, `2 frames`.
pub(crate) fn counted(count: u64, of_one: &str) -> String {
    format!("{count} {of_one}{}", if count == 1 { "" } else { "s" })
}

/// Decimals that half of a 95 % interval leaves: two digits of it, at most four decimals.
pub(crate) fn decimals_of(u95: f64) -> usize {
    if u95 > 0.0 { (1 - u95.log10().floor() as i32).clamp(0, 4) as usize } else { 2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_has_no_minus() {
        assert_eq!(
            [-0.04, -0.06, 0.04, -12.0].map(|value| signed(value, 1)),
            ["+0.0", "-0.1", "+0.0", "-12.0"]
        );
        assert_eq!(signed(f64::NEG_INFINITY, 1), "-inf");
        assert_eq!(number(-0.0004, 3), "0.000");
    }

    #[test]
    fn numbers_are_grouped_and_never_minus_zero() {
        assert_eq!(number(1234567.891, 1), "1,234,567.9");
        assert_eq!(number(-999.0, 0), "-999");
        assert_eq!(number(-0.0001, 2), "0.00");
        assert_eq!(number(f64::NAN, 2), "NaN");
    }
}
