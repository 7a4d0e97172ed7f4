//! The host's own clock: what was stamped before and after it was set, on one time line.
//!
//! The kernel stamps packets by `CLOCK_REALTIME`, which NTP steps (a host without a battery clock at every start). Only a
//! step parts it from `CLOCK_BOOTTIME`: slewing drives both alike, and both count through a suspend, through which
//! `CLOCK_MONOTONIC` stands. A time line is what the clock showed when it began, going on steadily.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use nix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// A difference of the two clocks that reading them does not make, ns.
const STEP_NS: u64 = 1_000_000;
/// Readings of both clocks that are tried for one that nothing interrupted, and what counts as that, ns.
const READINGS: usize = 5;
const UNINTERRUPTED_NS: u64 = 20_000;
/// Stamps of processors differ by less, and what is written has been stamped before, ns.
const SLACK_NS: i128 = 1_000_000;
/// Stamps of one stream that are not farther apart go on from each other, ns.
const GOES_ON_NS: i128 = 100_000_000;

/// Both clocks of the host at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostTime {
    /// `CLOCK_REALTIME`: UTC nanoseconds since 1970, as far as the host knows.
    pub unix_ns: u64,
    /// `CLOCK_BOOTTIME`: nanoseconds since the host started, suspends included.
    pub boot_ns: u64,
    /// By how much the moments of the two differ at most, ns.
    pub apart_ns: u64,
}

impl HostTime {
    /// Reads both.
    pub(crate) fn now() -> Self {
        let mut best = Self::read();
        for _ in 1..READINGS {
            if best.apart_ns <= UNINTERRUPTED_NS {
                break;
            }
            let other = Self::read();
            if other.apart_ns < best.apart_ns {
                best = other;
            }
        }
        best
    }

    fn read() -> Self {
        let before_ns = clock_ns(ClockId::CLOCK_BOOTTIME);
        let unix_ns = clock_ns(ClockId::CLOCK_REALTIME);
        let apart_ns = clock_ns(ClockId::CLOCK_BOOTTIME).saturating_sub(before_ns);
        Self { unix_ns, boot_ns: before_ns + apart_ns / 2, apart_ns }
    }

    fn unix_minus_boot_ns(&self) -> i128 {
        i128::from(self.unix_ns) - i128::from(self.boot_ns)
    }
}

/// 0 where there is no such clock, which Linux has since 2.6.39.
fn clock_ns(clock: ClockId) -> u64 {
    let time = clock_gettime(clock).unwrap_or_else(|_| nix::sys::time::TimeSpec::new(0, 0));
    (time.tv_sec() as u64).saturating_mul(1_000_000_000).saturating_add(time.tv_nsec() as u64)
}

/// Nanoseconds on the time line of this process: UTC when it was first asked for, going on steadily, whatever becomes of the
/// host's clock. Readings of a rig are stamped by it.
pub(crate) fn steady_now_ns() -> u64 {
    steady_ns(&HostTime::now())
}

/// The same for a moment that was read.
pub(crate) fn steady_ns(at: &HostTime) -> u64 {
    static BEGIN: OnceLock<HostTime> = OnceLock::new();
    let begin = BEGIN.get_or_init(|| *at);
    clamped(i128::from(at.boot_ns) + begin.unix_minus_boot_ns())
}

fn clamped(time_ns: i128) -> u64 {
    time_ns.clamp(0, i128::from(u64::MAX)) as u64
}

/// The host's clock was set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostStep {
    /// When, on the time line: between these, ns.
    pub between_ns: [u64; 2],
    /// How far forward, ns.
    pub step_ns: i64,
}

impl HostStep {
    /// In words, the time from `begin_ns` on.
    pub(crate) fn words(&self, begin_ns: u64) -> String {
        let side = if self.step_ns > 0 { "forward" } else { "back" };
        let (by_s, at_s) =
            (self.step_ns.unsigned_abs() as f64 * 1e-9, self.between_ns[1].saturating_sub(begin_ns));
        format!("the host's clock was set {side} by {by_s:.3} s at {:.3} s", at_s as f64 * 1e-9)
    }
}

/// Where a stream of stamps is on a time line: how many steps are behind it.
#[derive(Clone, Copy, Debug, Default)]
pub struct StreamPlace {
    passed: usize,
    last_ns: Option<u64>,
}

/// A time line that begins as the host's clock and goes on steadily, and every step that the clock made meanwhile.
#[derive(Clone, Debug)]
pub struct Timeline {
    begin: HostTime,
    last: HostTime,
    steps: Vec<HostStep>,
    /// Sum of the steps so far, ns.
    stepped_ns: i128,
}

impl Timeline {
    /// Begins now.
    pub(crate) fn new(begin: HostTime) -> Self {
        Self { begin, last: begin, steps: Vec::new(), stepped_ns: 0 }
    }

    /// What both clocks showed when it began.
    pub(crate) fn begin(&self) -> HostTime {
        self.begin
    }

    /// A moment on the line, ns.
    pub(crate) fn time_ns(&self, at: &HostTime) -> u64 {
        clamped(i128::from(at.boot_ns) + self.begin.unix_minus_boot_ns())
    }

    /// The steps so far.
    pub(crate) fn steps(&self) -> &[HostStep] {
        &self.steps
    }

    /// Looks at the clocks; a step since the last look.
    pub(crate) fn sample(&mut self, at: HostTime) -> Option<HostStep> {
        let moved_ns = at.unix_minus_boot_ns() - self.begin.unix_minus_boot_ns() - self.stepped_ns;
        let between_ns = [self.time_ns(&self.last), self.time_ns(&at)];
        self.last = at;
        if moved_ns.unsigned_abs() <= u128::from(STEP_NS + at.apart_ns) {
            return None;
        }
        let step = HostStep { between_ns, step_ns: i64::try_from(moved_ns).ok()? };
        self.stepped_ns += moved_ns;
        self.steps.push(step);
        Some(step)
    }

    /// Stamp of a stream, by the host's clock, on the line, ns. The stream's stamps come in their order and not before they
    /// were made; the last look was not long ago.
    ///
    /// Around a step a stamp may be from before or after it. Where the stream goes on from its last stamp, that tells;
    /// otherwise the younger of what is possible counts: what waits to be written does not wait for long.
    pub(crate) fn place(&self, unix_ns: u64, stream: &mut StreamPlace) -> u64 {
        let now_ns = i128::from(self.time_ns(&self.last));
        let mut time_ns = i128::from(unix_ns);
        time_ns -= self.steps[..stream.passed].iter().map(|step| i128::from(step.step_ns)).sum::<i128>();
        let mut best: Option<((bool, i128), usize, i128)> = None;
        let as_before_ns = time_ns;
        for passed in stream.passed..=self.steps.len() {
            if passed > stream.passed {
                time_ns -= i128::from(self.steps[passed - 1].step_ns);
            }
            let is_before = |step: &HostStep| time_ns <= i128::from(step.between_ns[1]) + SLACK_NS;
            let is_after = |step: &HostStep| time_ns >= i128::from(step.between_ns[0]) - SLACK_NS;
            let age_ns = now_ns - time_ns;
            let is_possible = age_ns >= -SLACK_NS
                && self.steps.get(passed).is_none_or(is_before)
                && passed.checked_sub(1).is_none_or(|last| is_after(&self.steps[last]));
            if !is_possible {
                continue;
            }
            let gap_ns = stream.last_ns.map(|last_ns| time_ns - i128::from(last_ns));
            let gap_ns = gap_ns.filter(|gap_ns| (-SLACK_NS..GOES_ON_NS).contains(gap_ns));
            let order = gap_ns.map_or((true, age_ns), |gap_ns| (false, gap_ns.abs()));
            if best.is_none_or(|(other, ..)| order < other) {
                best = Some((order, passed, time_ns));
            }
        }
        // stamps of another clock than the host's stay as they are
        let (passed, time_ns) =
            best.map_or((stream.passed, as_before_ns), |(_, passed, time_ns)| (passed, time_ns));
        let time_ns = clamped(time_ns);
        *stream = StreamPlace { passed, last_ns: Some(time_ns) };
        time_ns
    }
}

/// Streams of stamps. Known steps of their clock are removed from each stream, one after the other, where it makes them:
/// the time from stamp to stamp tells.
#[derive(Clone, Debug, Default)]
pub struct StepsUndone {
    steps_ns: Vec<i64>,
    streams: BTreeMap<usize, StreamPlace>,
    last_ns: Option<u64>,
}

impl StepsUndone {
    /// For these steps, in the order in which they were made.
    pub(crate) fn new(steps_ns: Vec<i64>) -> Self {
        Self { steps_ns, ..Self::default() }
    }

    /// A stamp of a stream as if the clock had not been set.
    pub(crate) fn place(&mut self, stream: usize, unix_ns: u64) -> u64 {
        if self.steps_ns.is_empty() {
            return unix_ns;
        }
        let known = self.streams.entry(stream).or_default();
        let last_ns = known.last_ns.or(self.last_ns).map_or(i128::from(unix_ns), i128::from);
        let stepped_ns =
            |passed: usize| self.steps_ns[..passed].iter().map(|step| i128::from(*step)).sum::<i128>();
        let times_ns = (known.passed..=self.steps_ns.len())
            .map(|passed| (passed, i128::from(unix_ns) - stepped_ns(passed)));
        let nearest = times_ns.min_by_key(|(_, time_ns)| (time_ns - last_ns).unsigned_abs());
        let (passed, time_ns) = nearest.unwrap_or((known.passed, i128::from(unix_ns)));
        let time_ns = clamped(time_ns);
        *known = StreamPlace { passed, last_ns: Some(time_ns) };
        self.last_ns = Some(time_ns);
        time_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIX_NS: u64 = 1_700_000_000_000_000_000;
    const BOOT_NS: u64 = 5_000_000_000;
    const MS: u64 = 1_000_000;

    /// A host sets its clock by each of these at its time, s. Packets come every 1.5 ms, wait `lag` ms until they
    /// are written and are looked at every `every` ms. Max error of a packet's time, ns.
    fn worst_ns(steps: &[(u64, i64)], lag: u64, every: u64, silent_ms: std::ops::Range<u64>) -> (u64, usize) {
        let unix_ns = |at_ns: u64| {
            let set: i64 = steps.iter().filter(|(at_s, _)| at_ns >= at_s * 1000 * MS).map(|(_, by)| by).sum();
            (UNIX_NS + at_ns).saturating_add_signed(set)
        };
        let host = |at_ns: u64| HostTime { unix_ns: unix_ns(at_ns), boot_ns: BOOT_NS + at_ns, apart_ns: 100 };
        let mut line = Timeline::new(host(0));
        let mut stream = StreamPlace::default();
        let (mut worst_ns, mut sent_ns) = (0, 0);
        for look_ns in (0..20_000 * MS).step_by((every * MS) as usize) {
            line.sample(host(look_ns));
            while sent_ns + lag * MS <= look_ns {
                if !silent_ms.contains(&(sent_ns / MS)) {
                    let placed_ns = line.place(unix_ns(sent_ns), &mut stream);
                    worst_ns = worst_ns.max(placed_ns.abs_diff(UNIX_NS + sent_ns));
                }
                sent_ns += 1_500_000;
            }
        }
        (worst_ns, line.steps().len())
    }

    #[test]
    fn stamps_around_a_step_are_put_on_one_line() {
        let day_ns = 86_400_000_000_000;
        for by_ns in
            [100 * day_ns, -100 * day_ns, 3_600_000_000_000, -3_000_000_000, 250_000_000, -250_000_000]
        {
            for (lag, every) in [(0, 1), (3, 7), (40, 20), (900, 500)] {
                let (worst_ns, steps) = worst_ns(&[(10, by_ns)], lag, every, 0..0);
                assert_eq!((worst_ns, steps), (0, 1), "{by_ns} {lag} {every}");
            }
        }
        // a sensor that is silent around the step and begins soon after it
        for by_ns in [5_000_000_000, -5_000_000_000] {
            assert_eq!(worst_ns(&[(10, by_ns)], 3, 7, 8_000..11_000), (0, 1), "{by_ns}");
            assert_eq!(worst_ns(&[(10, by_ns)], 3, 7, 0..11_000), (0, 1), "{by_ns}");
        }
        // two steps, the second of which takes the first back
        assert_eq!(worst_ns(&[(8, day_ns), (10, -day_ns)], 3, 7, 0..0), (0, 2));
        // a step below the distance of two packets cannot be assigned to one packet
        let (worst_ns, steps) = worst_ns(&[(10, -1_300_000)], 3, 7, 0..0);
        assert!(worst_ns <= 1_300_000 && steps == 1, "{worst_ns} {steps}");
    }

    #[test]
    fn known_steps_are_removed_from_every_stream() {
        for steps_ns in [[8_640_000_000_000_000, -8_640_000_000_000_000], [-3_000_000_000, 20_000_000]] {
            let mut undone = StepsUndone::new(steps_ns.to_vec());
            for at_ms in 0..6_000 {
                let passed = usize::from(at_ms >= 2_000) + usize::from(at_ms >= 4_000);
                let set_ns: i64 = steps_ns[..passed].iter().sum();
                let true_ns = UNIX_NS + at_ms * MS;
                // the third begins late
                for stream in (0..3).filter(|stream| *stream != 2 || at_ms > 3_000) {
                    assert_eq!(
                        undone.place(stream, true_ns.saturating_add_signed(set_ns)),
                        true_ns,
                        "{stream} {at_ms}"
                    );
                }
            }
        }
    }

    #[test]
    fn slewing_and_a_busy_host_are_no_step() {
        let mut line = Timeline::new(HostTime { unix_ns: UNIX_NS, boot_ns: BOOT_NS, apart_ns: 0 });
        for second in 1..100_000 {
            // both clocks are slewed alike; reading them was interrupted for 40 ms
            let at_ns = second * 1_000_500_000;
            let apart_ns = if second % 7 == 0 { 40 * MS } else { 100 };
            let late_ns = apart_ns / 2;
            let unix_ns = UNIX_NS + at_ns + late_ns;
            assert_eq!(line.sample(HostTime { unix_ns, boot_ns: BOOT_NS + at_ns, apart_ns }), None);
        }
    }

    #[test]
    fn the_clocks_of_this_host_go_alike() {
        let begin = HostTime::now();
        let mut line = Timeline::new(begin);
        std::thread::sleep(std::time::Duration::from_millis(20));
        let now = HostTime::now();
        line.sample(now);
        let since_ns = line.time_ns(&now) - begin.unix_ns;
        assert!((20 * MS..60_000 * MS).contains(&since_ns), "{since_ns}");
        assert!(steady_now_ns() >= steady_ns(&now));
    }

    #[test]
    fn a_step_is_reported_with_when_and_how_much() {
        let step = HostStep {
            between_ns: [UNIX_NS + 1_000_000_000, UNIX_NS + 1_500_000_000],
            step_ns: -2_250_000_000,
        };
        assert_eq!(step.words(UNIX_NS), "the host's clock was set back by 2.250 s at 1.500 s");
    }
}
