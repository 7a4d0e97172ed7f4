//! Scores as the model gets them.

use crate::design::optimize::Trial;

/// Scores made fit for a stationary model: standardised by the better half, the worse half drawn in logarithmically, so
/// that a cliff far below does not flatten the top; infeasible points lie below the worst feasible one, by their
/// violation.
pub(super) fn merits(trials: &[&Trial]) -> Vec<f64> {
    let feasible: Vec<f64> = trials.iter().filter(|t| t.violation == 0.0).map(|t| t.score).collect();
    let max_violation = trials.iter().map(|t| t.violation).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut sorted = feasible.clone();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let median = at(0.5);
    let spread = (sorted.last().copied().unwrap_or(0.0) - median).max(1e-9 * median.abs()).max(1e-12);
    let draw_in = |score: f64| {
        let z = (score - median) / spread;
        if z >= 0.0 { z } else { -(1.0 - z).ln() }
    };
    let worst = sorted.first().map_or(0.0, |score| draw_in(*score));
    trials
        .iter()
        .map(|t| match t.violation {
            0.0 => draw_in(t.score),
            violation => worst - 0.2 - violation / max_violation,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::optimize::Candidate;

    fn trial(score: f64, violation: f64) -> Trial {
        Trial { candidate: Candidate { values: vec![] }, score, violation }
    }

    #[test]
    fn merits_keep_the_order_of_trials() {
        let mut trials: Vec<Trial> = (0..20).map(|i| trial(f64::from(i * i), 0.0)).collect();
        trials.extend((1..5).map(|i| self::trial(1e6, f64::from(i))));
        let all: Vec<&Trial> = trials.iter().collect();
        let merits = merits(&all);
        for a in 0..all.len() {
            for b in 0..all.len() {
                assert_eq!(all[a].beats(all[b]), merits[a] > merits[b], "{:?} {:?}", all[a], all[b]);
            }
        }
    }

    #[test]
    fn equal_scores_give_equal_finite_merits() {
        let trials = vec![trial(5.0, 0.0); 4];
        assert!(merits(&trials.iter().collect::<Vec<_>>()).iter().all(|m| *m == 0.0));
    }
}
