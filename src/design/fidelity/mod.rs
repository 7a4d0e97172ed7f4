//! How finely a question must be looked at: cheap looks first, finer ones only where they can still change the answer.
//!
//! Coverage is counted with finitely many rays and grows with them. Each level of a [`Ladder`] takes about twice the
//! rays of the one before, so what is still missing shrinks by a ratio that the levels themselves show; the sum of the
//! geometric series that is left down to the finest level is added (Richardson, doi:10.1098/rsta.1911.0009). What that sum turned out to be
//! wrong by, from each level to the next, is the stated error. Two questions are separate: which candidate is
//! best ([`rank`]: errors that all candidates share do not matter), and how much one is worth ([`settle`]: they do).

mod mount;
mod published;
mod rank;
mod scene;
mod settle;

pub(crate) use mount::MountFidelity;
pub use published::BoxLadder;
pub use rank::{Ranking, RankingStep, Rules, Stopped, rank};
pub use scene::SceneLadder;
pub use settle::{Settled, settle};

/// Ways to look at a candidate, from coarse to fine, each with about twice the rays of the one before.
pub trait Ladder: Sync {
    /// What is looked at.
    type Candidate: Sync;
    /// What a level leaves for the next one, so that no ray is cast twice.
    type Memo: Default + Send;
    /// Why it cannot be.
    type Error: Send;

    /// Number of levels, at least two.
    fn levels(&self) -> usize;

    /// Rays that one candidate costs at a level after all those before it.
    fn rays(&self, level: usize, candidate: &Self::Candidate) -> u64;

    /// What a level is, in words.
    fn name(&self, level: usize) -> String;

    /// Score at a level: larger is better. `memo` holds what earlier levels stored, or nothing; the score is the same.
    ///
    /// # Errors
    /// Why the candidate cannot be looked at.
    fn score(
        &self,
        level: usize,
        candidate: &Self::Candidate,
        memo: &mut Self::Memo,
    ) -> Result<f64, Self::Error>;
}

/// What a candidate is worth, and by how much that may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Judged {
    /// Score that the finest level would give.
    pub value: f64,
    /// That one lies within plus and minus this.
    pub bound: f64,
    /// The finest level at which it was looked at.
    pub level: usize,
}

/// What one level adds is what the one before added times a ratio; without any other knowledge rays are worth the less
/// the more there are, one by one.
const FIRST_RATIO: f64 = 0.5;
/// No series is trusted to end faster than this, whatever two levels say.
const LEAST_RATIO: f64 = 0.2;
/// Nor to fade more slowly than this: rooms full of small things come near it.
const MAX_RATIO: f64 = 0.8;
/// Share of a value below which no error is stated: single cells on the edge of being seen.
const LEAST_BOUND: f64 = 2e-4;

/// Sum of so many further terms of a geometric series, in units of its last one.
fn tail(ratio: f64, terms: usize) -> f64 {
    (1..=terms as i32).map(|term| ratio.powi(term)).sum()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Scores that miss `missing / rays`, and something that does not fade in order.
    pub struct Invented {
        pub levels: usize,
        pub noise: f64,
    }

    impl Ladder for Invented {
        type Candidate = [f64; 2];
        type Memo = ();
        type Error = String;

        fn levels(&self) -> usize {
            self.levels
        }

        fn rays(&self, level: usize, _: &[f64; 2]) -> u64 {
            1000 << level
        }

        fn name(&self, level: usize) -> String {
            format!("level {level}")
        }

        fn score(&self, level: usize, candidate: &[f64; 2], (): &mut ()) -> Result<f64, String> {
            let [value, missing] = *candidate;
            if value.is_nan() {
                return Err("no number".into());
            }
            let rays = f64::from(1_u32 << level);
            // a fixed pattern of either sign, different for every candidate and level
            let pattern = (value * 12.9898 + level as f64 * 78.233).sin();
            Ok(value - missing / rays + self.noise * pattern / rays)
        }
    }
}
