//! Device time from microseconds of the hour.

/// The sensor's clock counts microseconds since the top of the UTC hour (or since power-on, modulo one hour). This
/// resolves the hour: the first stamp takes the hour that lies nearest to the host's clock (within 30 minutes),
/// later ones continue from it, so device time rises across the hour. The stamp in a packet is always
/// `time_ns / 1000` modulo one hour.
#[derive(Clone, Debug, Default)]
pub(crate) struct HourClock {
    newest: Option<Newest>,
    behind: Behind,
}

/// Packets in a row that are older than the newest, each younger than the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Behind {
    packets: u32,
    last_ns: u64,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    time_ns: u64,
    host_ns: u64,
}

/// A stamp with its hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Resolved {
    /// Device time, ns; counts from 1970 when the host has a clock.
    pub time_ns: u64,
    /// The device's clock was set or started anew: times before and after do not compare.
    pub restarted: bool,
}

const HOUR_NS: i64 = 3_600_000_000_000;
/// A step back by more than this is a new start of the clock, not a packet that was held up.
const MOST_LATE_NS: i64 = 1_000_000_000;
/// So many packets behind the newest, in order among themselves, were not held up: the clock was set back.
const STEADY_PACKETS: u32 = 8;
/// A step ahead by more than this is checked against the host's clock.
const LONG_NS: i64 = 10_000_000_000;
/// How far host and device may disagree about the length of a pause.
const PAUSE_TOLERANCE_NS: i64 = 5_000_000_000;

impl HourClock {
    /// Takes the stamp of a packet, us of the hour, and its arrival by the host's clock, ns since 1970 or 0.
    pub fn resolve(&mut self, stamp_us: u32, host_ns: u64) -> Resolved {
        let stamp_ns = i64::from(stamp_us) * 1000;
        let Some(newest) = self.newest else {
            return self.start(stamp_ns, host_ns, false);
        };
        let ahead_ns = wrap_to_half(stamp_ns - newest.time_ns as i64);
        let have_host = host_ns > 0 && newest.host_ns > 0;
        if !(-MOST_LATE_NS..=LONG_NS).contains(&ahead_ns) {
            if !have_host {
                if ahead_ns < 0 {
                    return self.start(stamp_ns, host_ns, true);
                }
            } else {
                let host_pause_ns = host_ns as i64 - newest.host_ns as i64;
                let pause_ns = ahead_ns + HOUR_NS * div_round(host_pause_ns - ahead_ns, HOUR_NS);
                if pause_ns < 0 || (pause_ns - host_pause_ns).abs() > PAUSE_TOLERANCE_NS {
                    return self.start(stamp_ns, host_ns, true);
                }
                return self.advance(newest.time_ns + pause_ns as u64, host_ns);
            }
        }
        if ahead_ns < 0 {
            let time_ns = newest.time_ns.saturating_sub(ahead_ns.unsigned_abs());
            let in_order = time_ns > self.behind.last_ns;
            let packets = if in_order { self.behind.packets + 1 } else { 1 };
            self.behind = Behind { packets, last_ns: time_ns };
            if packets >= STEADY_PACKETS {
                return self.start(stamp_ns, host_ns, true);
            }
            return Resolved { time_ns, restarted: false };
        }
        self.advance(newest.time_ns + ahead_ns as u64, host_ns)
    }

    fn advance(&mut self, time_ns: u64, host_ns: u64) -> Resolved {
        self.newest = Some(Newest { time_ns, host_ns });
        self.behind = Behind::default();
        Resolved { time_ns, restarted: false }
    }

    fn start(&mut self, stamp_ns: i64, host_ns: u64, restarted: bool) -> Resolved {
        let host_ns_signed = i64::try_from(host_ns).unwrap_or(0);
        let hour_ns = host_ns_signed - host_ns_signed.rem_euclid(HOUR_NS);
        let mut time_ns = hour_ns + stamp_ns;
        if host_ns > 0 {
            time_ns += HOUR_NS * div_round(host_ns_signed - time_ns, HOUR_NS);
        }
        let time_ns = if time_ns < 0 { stamp_ns as u64 } else { time_ns as u64 };
        self.newest = Some(Newest { time_ns, host_ns });
        self.behind = Behind::default();
        Resolved { time_ns, restarted }
    }
}

/// The representative of a difference, modulo one hour, that lies within half an hour of zero.
fn wrap_to_half(difference_ns: i64) -> i64 {
    let wrapped = difference_ns.rem_euclid(HOUR_NS);
    if wrapped > HOUR_NS / 2 { wrapped - HOUR_NS } else { wrapped }
}

fn div_round(value: i64, divisor: i64) -> i64 {
    (value + divisor / 2).div_euclid(divisor)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOST_NS: u64 = 1_453_364_282_708_714_000;

    #[test]
    fn the_hour_is_the_hosts() {
        let mut clock = HourClock::default();
        let resolved = clock.resolve(1_082_340_595, HOST_NS);
        assert_eq!(resolved, Resolved { time_ns: 1_453_364_282_340_595_000, restarted: false });
    }

    #[test]
    fn time_rises_across_the_hour() {
        let mut clock = HourClock::default();
        let before = clock.resolve(3_599_999_000, 0).time_ns;
        let after = clock.resolve(327, 0);
        assert_eq!(after.time_ns - before, 1_327_000);
        assert!(!after.restarted);
        assert_eq!(clock.resolve(3_599_999_500, 0).time_ns, before + 500_000, "one that came late");
    }

    #[test]
    fn a_stamp_far_from_the_host_takes_the_nearest_hour() {
        let mut clock = HourClock::default();
        let host_ns = 1_673_400_471_737_763_000;
        let time_ns = clock.resolve(140_554_572 + 3_400_000_000, host_ns).time_ns;
        assert!(time_ns.abs_diff(host_ns) <= HOUR_NS as u64 / 2);
    }

    #[test]
    fn a_pause_the_host_saw_too_is_no_restart() {
        let mut clock = HourClock::default();
        let start = clock.resolve(10, HOST_NS);
        let pause_ns = 2 * HOUR_NS as u64 + 60_000_000_000;
        let after = clock.resolve(60_000_010, HOST_NS + pause_ns);
        assert_eq!((after.time_ns - start.time_ns, after.restarted), (pause_ns, false));
    }

    #[test]
    fn a_clock_that_is_set_back_a_little_restarts() {
        let mut clock = HourClock::default();
        clock.resolve(10_000_000, HOST_NS);
        let mut take = |stamps_us: &mut dyn Iterator<Item = u32>| {
            stamps_us.map(|stamp_us| clock.resolve(stamp_us, HOST_NS).restarted).collect::<Vec<_>>()
        };
        let late = take(&mut (9_500_000..9_500_007).chain([9_500_006, 9_400_000, 10_000_001]));
        assert_eq!(late, [false; 10], "a few that were held up, one of them twice");
        let steady = take(&mut (9_600_000..9_600_009));
        assert_eq!(steady, [false, false, false, false, false, false, false, true, false]);
    }

    #[test]
    fn a_clock_that_is_set_restarts() {
        let mut clock = HourClock::default();
        clock.resolve(1_000_000, HOST_NS);
        assert!(clock.resolve(900_000_000, HOST_NS + 1_000_000).restarted);
        assert!(clock.resolve(100_000_000, HOST_NS + 2_000_000).restarted);
    }
}
