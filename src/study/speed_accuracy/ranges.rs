//! Numbers in words.

use crate::report::chart;

/// Numbers in order, neighbours at most 1 apart as "first to last".
pub(super) fn runs(values: &[f64]) -> String {
    let run = |run: &[f64]| match run {
        [one] => chart::number(*one, 0),
        _ => format!("{} to {}", chart::number(run[0], 0), chart::number(run[run.len() - 1], 0)),
    };
    let words: Vec<String> = values.chunk_by(|a, b| b - a <= 1.0).map(run).collect();
    if words.is_empty() { "-".into() } else { words.join(", ") }
}
