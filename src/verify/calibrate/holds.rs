//! The stretches of a session in which an axis held one target.

use super::{Reached, Setting};
use crate::recording::ServoReport;
use crate::verify::compare::Thinning;

/// Returns stored of each setting.
const RAYS: usize = 400_000;
/// An axis that says it holds may still swing for so long, ns.
const SETTLE_NS: u64 = 300_000_000;
/// Shorter settings are left out, ns.
const LEAST_HELD_NS: u64 = 500_000_000;
/// Shortest hold that counts, s.
pub(crate) const SHORTEST_HOLD_S: f64 = (SETTLE_NS + LEAST_HELD_NS) as f64 * 1e-9;

/// A stretch in which an axis held, on the host's clock.
pub(crate) struct Hold {
    pub(crate) from_ns: u64,
    pub(crate) to_ns: u64,
    pub(crate) measured_rad: f64,
    reached: Option<Reached>,
    pub(crate) rays: Thinning,
}

impl Hold {
    pub(crate) fn setting(self) -> Setting {
        Setting {
            measured_rad: self.measured_rad,
            reached: self.reached,
            rays: Thinning::joined([self.rays]),
        }
    }
}

/// The stretches in which an axis held one target, in order of time.
pub(crate) fn holds(reports: &[ServoReport], axis: usize) -> Vec<Hold> {
    let mut own: Vec<&ServoReport> =
        reports.iter().filter(|report| report.axis == axis && report.source == "measured").collect();
    own.sort_by_key(|report| report.time_ns);
    let mut holds: Vec<Hold> = Vec::new();
    for run in own.chunk_by(|a, b| (&a.state, a.target_urad) == (&b.state, b.target_urad)) {
        let (first, last) = (run[0], run[run.len() - 1]);
        let from_ns = first.time_ns + SETTLE_NS;
        if first.state != "holding" || last.time_ns < from_ns + LEAST_HELD_NS {
            continue;
        }
        let steady = run.iter().filter(|report| report.time_ns >= from_ns);
        let urad: Vec<f64> = steady.map(|report| f64::from(report.position_urad)).collect();
        let measured_rad = 1e-6 * urad.iter().sum::<f64>() / urad.len() as f64;
        let reached = holds.last().map(|before| Reached::between(before.measured_rad, measured_rad));
        holds.push(Hold { from_ns, to_ns: last.time_ns, measured_rad, reached, rays: Thinning::new(RAYS) });
    }
    holds
}
