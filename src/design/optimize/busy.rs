//! How long at least one call ran: the objective's share of a search, however many threads call it.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Counts calls that run.
#[derive(Debug, Default)]
pub(crate) struct Busy(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    running: usize,
    since: Option<Instant>,
    total: Duration,
}

impl Busy {
    /// Calls, and counts its time once where calls overlap.
    pub(crate) fn during<T>(&self, call: impl FnOnce() -> T) -> T {
        {
            let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            if state.running == 0 {
                state.since = Some(Instant::now());
            }
            state.running += 1;
        }
        let result = call();
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.running -= 1;
        if state.running == 0
            && let Some(since) = state.since.take()
        {
            state.total += since.elapsed();
        }
        result
    }

    /// Seconds during which a call ran.
    pub(crate) fn seconds(&self) -> f64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).total.as_secs_f64()
    }
}
