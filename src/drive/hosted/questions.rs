//! Which question an answer on a bus may belong to.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Questions for one encoder that may still be answered: an answer that is late looks like that to a later question, and
/// its sample may be as old as the first of them.
#[derive(Clone, Debug, Default)]
pub(in crate::drive) struct Questions(VecDeque<Instant>);

/// After this time no answer comes any more.
const FORGOTTEN: Duration = Duration::from_millis(500);

impl Questions {
    /// A question leaves.
    pub(crate) fn ask(&mut self, now: Instant) {
        while self.0.front().is_some_and(|asked| now.saturating_duration_since(*asked) > FORGOTTEN) {
            self.0.pop_front();
        }
        self.0.push_back(now);
    }

    /// How many were not answered.
    pub(crate) fn waiting(&self) -> u32 {
        self.0.len() as u32
    }

    /// An answer is there; between which times it was sampled. One without a waiting question is old.
    pub(crate) fn answer(&mut self, now: Instant) -> [Instant; 2] {
        [self.0.pop_front().or_else(|| now.checked_sub(FORGOTTEN)).unwrap_or(now), now]
    }
}
