//! How much one candidate is worth.

use super::{FIRST_RATIO, Judged, LEAST_BOUND, Ladder, tail};

/// What one candidate is worth.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Settled {
    /// Value, error and level.
    #[serde(flatten)]
    pub judged: Judged,
    /// The score at each level that was looked at, from the coarsest.
    pub scores: Vec<f64>,
    /// Whether the error is within the tolerance.
    pub within_tolerance: bool,
    /// Rays in all.
    pub rays: u64,
}

/// A single candidate's own levels scatter, so its ratio is believed within narrower limits than that of many.
const RATIOS: (f64, f64) = (0.3, 0.6);
/// Added to every error, as a share of the value.
const MARGIN: f64 = 5e-4;

/// Refines until the error is at most `tolerance`, a share of the value, or the ladder ends.
///
/// # Errors
/// Why the candidate cannot be looked at.
pub fn settle<L: Ladder>(ladder: &L, candidate: &L::Candidate, tolerance: f64) -> Result<Settled, L::Error> {
    let mut scores: Vec<f64> = Vec::new();
    let mut memo = L::Memo::default();
    let mut rays = 0;
    let (mut value, mut error): (f64, f64) = (f64::NAN, 0.0);
    let mut bound = f64::INFINITY;
    for level in 0..ladder.levels() {
        scores.push(ladder.score(level, candidate, &mut memo)?);
        rays += ladder.rays(level, candidate);
        let Some(before) = level.checked_sub(1) else {
            value = scores[0];
            continue;
        };
        let added = scores[level] - scores[before];
        let ratio = match before.checked_sub(1).map(|first| scores[before] - scores[first]) {
            Some(then) if then > 0.0 => (added / then).clamp(RATIOS.0, RATIOS.1),
            Some(_) => RATIOS.0,
            None => FIRST_RATIO,
        };
        let missing = added * tail(ratio, ladder.levels() - scores.len());
        let refined = scores[level] + missing;
        if level >= 2 {
            let now = (refined - value).abs();
            // one lucky level must not end the refinement
            bound = now.max(0.5 * error).max(missing.abs()) + MARGIN * refined.abs();
            error = now;
        }
        value = refined;
        if bound <= tolerance * value.abs() {
            break;
        }
    }
    if bound.is_infinite() {
        // two levels only: the sum is all that is known
        bound = (value - scores[0]).abs() + LEAST_BOUND * value.abs();
    }
    Ok(Settled {
        judged: Judged { value, bound, level: scores.len() - 1 },
        within_tolerance: bound <= tolerance * value.abs(),
        scores,
        rays,
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::Invented;
    use super::*;

    #[test]
    fn the_error_that_is_stated_holds() {
        let ladder = Invented { levels: 10, noise: 40.0 };
        let mut held = 0;
        for n in 0..200 {
            let candidate = [1000.0 + f64::from(n) * 1.7, 100.0 + f64::from(n)];
            let settled = settle(&ladder, &candidate, 0.01).unwrap();
            assert!(settled.within_tolerance && settled.judged.bound <= 0.01 * settled.judged.value);
            assert!(settled.scores.len() < 10, "a percent needs no finest level");
            let finest = ladder.score(9, &candidate, &mut ()).unwrap();
            held += u32::from((settled.judged.value - finest).abs() <= settled.judged.bound);
        }
        assert!(held >= 190, "{held}");
    }

    #[test]
    fn what_cannot_be_reached_is_reported() {
        let ladder = Invented { levels: 4, noise: 40.0 };
        let settled = settle(&ladder, &[1000.0, 300.0], 1e-4).unwrap();
        assert!(!settled.within_tolerance);
        assert_eq!((settled.scores.len(), settled.rays), (4, 15_000));
        let two = settle(&Invented { levels: 2, noise: 0.0 }, &[1000.0, 300.0], 1e-4).unwrap();
        assert!(two.judged.bound.is_finite() && !two.within_tolerance);
        assert!(settle(&ladder, &[f64::NAN, 0.0], 0.1).is_err());
    }
}
