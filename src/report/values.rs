//! Values as texts and pages show them; `-` where one is not known.

use super::chart::signed;
use crate::verify::calibrate::Estimate;

pub(crate) fn percent(share: Option<f64>) -> String {
    share.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share))
}

pub(crate) fn figure(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.4}"))
}

pub(crate) fn interval(ends: Option<[f64; 2]>) -> String {
    ends.map_or(String::new(), |[low, high]| format!(" [{low:.4}, {high:.4}]"))
}

/// A value and half of its 95 % interval.
pub(crate) fn estimate(estimate: Option<Estimate>, decimals: usize) -> String {
    estimate
        .map_or("-".into(), |known| format!("{} ± {:.decimals$}", signed(known.value, decimals), known.u95))
}

/// A p value: none is nothing.
pub(crate) fn p_value(p_value: f64) -> String {
    if p_value < 0.0005 { "p < 0.001".into() } else { format!("p {p_value:.3}") }
}
