//! How long packets take, counted without storing them. (Own code: `hdrhistogram` takes no value through a shared reference,
//! and receive threads must not wait for a lock.)

use std::sync::atomic::{AtomicU64, Ordering};

/// Buckets per doubling of time: a percentile is exact within 9 %.
const PER_OCTAVE: f64 = 8.0;
/// 1 us to 2^24 us = 17 s.
const BUCKETS: usize = 8 * 24 + 1;

/// Times in buckets that grow by 9 %. Any thread may add.
#[derive(Debug)]
pub(super) struct Latency {
    buckets: Vec<AtomicU64>,
}

/// What was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Percentiles {
    /// Number of times.
    pub count: u64,
    /// Median, ms.
    pub p50_ms: f64,
    /// 99 of 100 are shorter, ms.
    pub p99_ms: f64,
    /// The longest, ms.
    pub most_ms: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { buckets: (0..BUCKETS).map(|_| AtomicU64::new(0)).collect() }
    }
}

impl Latency {
    /// Adds the time from one moment to another; a clock that was set back counts as no time.
    pub(crate) fn add(&self, from_ns: u64, to_ns: u64) {
        let us = to_ns.saturating_sub(from_ns) as f64 * 1e-3;
        let bucket = if us <= 1.0 { 0.0 } else { (us.log2() * PER_OCTAVE).ceil() };
        self.buckets[(bucket as usize).min(BUCKETS - 1)].fetch_add(1, Ordering::Relaxed);
    }

    /// What was added so far.
    pub(crate) fn percentiles(&self) -> Percentiles {
        let counts: Vec<u64> = self.buckets.iter().map(|bucket| bucket.load(Ordering::Relaxed)).collect();
        let count: u64 = counts.iter().sum();
        let upper_ms = |bucket: usize| (bucket as f64 / PER_OCTAVE).exp2() * 1e-3;
        let at = |share: f64| {
            let wanted = (count as f64 * share).ceil().max(1.0) as u64;
            let mut seen = 0;
            let bucket = counts.iter().position(|bucket| {
                seen += bucket;
                seen >= wanted
            });
            bucket.map_or(0.0, upper_ms)
        };
        let most = counts.iter().rposition(|bucket| *bucket > 0);
        Percentiles { count, p50_ms: at(0.5), p99_ms: at(0.99), most_ms: most.map_or(0.0, upper_ms) }
    }

    /// Forgets everything.
    pub(crate) fn clear(&self) {
        self.buckets.iter().for_each(|bucket| bucket.store(0, Ordering::Relaxed));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_within_a_bucket() {
        let latency = Latency::default();
        assert_eq!(latency.percentiles(), Percentiles::default());
        (1..=1000u64).for_each(|ms| latency.add(5, 5 + ms * 1_000_000));
        let Percentiles { count, p50_ms, p99_ms, most_ms } = latency.percentiles();
        assert_eq!(count, 1000);
        for (found, exact) in [(p50_ms, 500.0), (p99_ms, 990.0), (most_ms, 1000.0)] {
            assert!(found >= exact * 0.999 && found < exact * 1.1, "{found} for {exact}");
        }
        latency.add(10, 5);
        latency.add(0, u64::MAX);
        assert!(latency.percentiles().most_ms > 16_000.0);
        latency.clear();
        assert_eq!(latency.percentiles().count, 0);
    }
}
