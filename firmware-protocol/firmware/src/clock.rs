//! Microseconds that never wrap, from a counter that does.

/// Widens a free-running 32-bit counter. It must be asked more often than the counter wraps.
///
/// Ticks of an interrupt are no clock: an emulator or a debugger that pauses the core loses some.
pub struct Clock {
    ticks_per_us: u32,
    last: u32,
    ticks: u64,
}

impl Clock {
    /// A clock that starts at zero with the counter at `counter`.
    pub fn new(ticks_per_us: u32, counter: u32) -> Self {
        Self { ticks_per_us, last: counter, ticks: 0 }
    }

    /// Microseconds since the start, with the counter at `counter` (which counts up).
    pub fn now_us(&mut self, counter: u32) -> u64 {
        self.ticks += u64::from(counter.wrapping_sub(self.last));
        self.last = counter;
        self.ticks / u64::from(self.ticks_per_us)
    }
}
