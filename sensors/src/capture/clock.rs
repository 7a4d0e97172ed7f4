//! Ticks of an interface's clock.

/// What an interface's stamps count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Clock {
    pub(super) ticks_per_second: u128,
    pub(super) offset_s: i64,
}

impl Default for Clock {
    fn default() -> Self {
        Self { ticks_per_second: 1_000_000, offset_s: 0 }
    }
}

impl Clock {
    pub(super) fn time_ns(self, ticks: u64) -> u64 {
        match (self.ticks_per_second, self.offset_s) {
            // as nearly every file has it, without a wide division
            (1_000_000_000, 0) => return ticks,
            (1_000_000, 0) => return ticks.saturating_mul(1000),
            _ => {}
        }
        let since_offset = u128::from(ticks) * 1_000_000_000 / self.ticks_per_second; // below 2^94
        let time_ns = since_offset as i128 + i128::from(self.offset_s) * 1_000_000_000;
        time_ns.clamp(0, i128::from(u64::MAX)) as u64
    }
}
