//! The host's clock against one that only goes forward.

use std::time::{Duration, Instant};

/// A step that no slewing makes between two looks.
const STEP_S: f64 = 0.1;

/// Tells when the system's time was set.
#[derive(Clone, Copy, Debug)]
pub struct HostClock {
    begun: Instant,
    /// Unix time minus steady time, ns.
    offset_ns: i128,
}

impl HostClock {
    /// From a pair of simultaneous readings.
    pub(crate) fn new(steady: Instant, unix_ns: u64) -> Self {
        Self { begun: steady, offset_ns: i128::from(unix_ns) }
    }

    /// How far the system's time was set forward since the last look, s; none where it was not.
    pub(crate) fn sample(&mut self, steady: Instant, unix_ns: u64) -> Option<f64> {
        let since: Duration = steady.saturating_duration_since(self.begun);
        let offset_ns = i128::from(unix_ns) - since.as_nanos() as i128;
        let moved_s = (offset_ns - self.offset_ns) as f64 * 1e-9;
        self.offset_ns = offset_ns;
        (moved_s.abs() > STEP_S).then_some(moved_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_reported_once_and_slewing_never() {
        let begun = Instant::now();
        let mut clock = HostClock::new(begun, 1_000_000_000_000);
        let mut set_ns = 0i64;
        let mut steps = Vec::new();
        for look in 1..100u64 {
            set_ns += 50_000; // 500 ppm, the most that is slewed
            set_ns += match look {
                30 => -3_600_000_000_000,
                60 => 2_000_000_000,
                _ => 0,
            };
            let steady = begun + Duration::from_millis(100 * look);
            let unix_ns = 10_000_000_000_000i64 + 100_000_000 * look as i64 + set_ns;
            steps.extend(clock.sample(steady, unix_ns as u64));
        }
        // the first look tells of the wrong beginning
        let expected = [9000.0, -3600.0, 2.0];
        assert_eq!(steps.len(), expected.len(), "{steps:?}");
        assert!(steps.iter().zip(expected).all(|(step, exact)| (step - exact).abs() < 0.01), "{steps:?}");
    }
}
