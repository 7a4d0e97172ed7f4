//! Device time from microseconds of the hour.

/// The sensor's clock counts microseconds since the top of the UTC hour (or since power-on, modulo one hour; some count on
/// past 3600 s). This resolves the hour: the first stamp takes the hour that lies nearest to the host's clock (within 30
/// minutes), later ones continue from it, so device time rises across the hour; at every pause the host's clock says how
/// many hours it took. The stamp in a packet is always `time_ns / 1000` modulo one hour.
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

/// What a packet says of its time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stamp {
    /// Microseconds of the hour.
    pub stamp_us: u32,
    /// Arrival by the host's clock, ns since 1970 or 0.
    pub host_ns: u64,
    /// Its azimuth goes on where the packet before ended: it is the next one that the sensor sent, whatever its stamp says.
    pub is_next: bool,
    /// Time from one packet to the next, ns.
    pub period_ns: i64,
}

/// A stamp with its hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Resolved {
    /// Device time, ns; counts from 1970 when the host has a clock.
    pub time_ns: u64,
    /// How it follows on what came before.
    pub follows: Follows,
}

/// How a packet follows on those before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Follows {
    /// In the course of time, or late.
    On,
    /// After a pause that the host's clock saw too: nothing is known to have been sent meanwhile.
    Pause,
    /// The device's clock was set or started again: times before and after do not compare.
    Restart,
}

const HOUR_NS: i64 = 3_600_000_000_000;
/// A step back by more than this is no packet that was held up.
const MOST_LATE_NS: i64 = 1_000_000_000;
/// So many packets behind the newest, in order among themselves, were not held up: the clock was set back.
const STEADY_PACKETS: u32 = 8;
/// A step ahead by more than this, without a pause that the host saw, is not believed of a single stamp.
const MOST_AHEAD_NS: i64 = 20_000_000;
/// The same where the azimuth says that no packet is missing.
const NEXT_TOLERANCE_NS: i64 = 1_000_000;
/// A step ahead that several packets agree on is no restart up to this, where the host has no clock.
const LONG_NS: i64 = 10_000_000_000;
/// From this on the host's clock is asked how long a pause was.
const PAUSE_NS: i64 = 1_000_000_000;
/// A pause this long is one of the recording (it was stopped, or several were joined), no loss.
const REST_NS: i64 = 5_000_000_000;
/// How far host and device may disagree about the length of a pause.
const PAUSE_TOLERANCE_NS: i64 = 5_000_000_000;

impl HourClock {
    /// Device time of a packet; none where its stamp alone is not to be believed: what follows says what it is.
    pub(crate) fn resolve(&mut self, stamp: Stamp) -> Option<Resolved> {
        let Some(newest) = self.newest else { return Some(self.start(stamp, Follows::On)) };
        if let Some(resolved) = self.after_pause(stamp, newest) {
            return Some(resolved);
        }
        let ahead_ns = self.ahead_ns(stamp, newest);
        let host_explains = host_pause_ns(stamp, newest)
            .is_some_and(|pause_ns| pause_ns > MOST_AHEAD_NS && (pause_ns - ahead_ns).abs() < pause_ns / 2);
        let is_in_time = match stamp.is_next {
            true => (ahead_ns - stamp.period_ns).abs() <= NEXT_TOLERANCE_NS.max(stamp.period_ns / 2),
            false => (-MOST_LATE_NS..=MOST_AHEAD_NS).contains(&ahead_ns),
        };
        (is_in_time || (ahead_ns > 0 && host_explains)).then(|| self.step(stamp, newest, ahead_ns))
    }

    /// The same of a packet that several after it agree with.
    pub(crate) fn believe(&mut self, stamp: Stamp) -> Resolved {
        let Some(newest) = self.newest else { return self.start(stamp, Follows::On) };
        if let Some(resolved) = self.after_pause(stamp, newest) {
            return resolved;
        }
        let ahead_ns = self.ahead_ns(stamp, newest);
        if (0..=LONG_NS).contains(&ahead_ns) {
            return self.advance(newest.time_ns + ahead_ns as u64, stamp.host_ns, Follows::On);
        }
        self.start(stamp, Follows::Restart)
    }

    /// Whether a packet goes on where another one's stamp stands.
    pub(crate) fn goes_on(from: Stamp, to: Stamp) -> bool {
        let ahead_ns = wrap_to_half((i64::from(to.stamp_us) - i64::from(from.stamp_us)) * 1000);
        match to.is_next {
            true => (ahead_ns - to.period_ns).abs() <= NEXT_TOLERANCE_NS.max(to.period_ns / 2),
            false => (1..=MOST_AHEAD_NS).contains(&ahead_ns),
        }
    }

    /// How far a stamp is ahead of a time, microseconds, within half an hour.
    pub(crate) fn us_ahead(time_ns: u64, stamp: Stamp) -> i64 {
        wrap_to_half(i64::from(stamp.stamp_us) * 1000 - time_ns as i64) / 1000
    }

    /// Time of the newest packet, ns.
    pub(crate) fn newest_ns(&self) -> Option<u64> {
        self.newest.map(|newest| newest.time_ns)
    }

    /// A packet without a stamp of its own stands here: those after it go on from here.
    pub(crate) fn pass(&mut self, time_ns: u64, host_ns: u64) {
        if self.newest.is_none_or(|newest| newest.time_ns < time_ns) {
            self.newest = Some(Newest { time_ns, host_ns });
        }
    }

    fn ahead_ns(&self, stamp: Stamp, newest: Newest) -> i64 {
        wrap_to_half(i64::from(stamp.stamp_us) * 1000 - newest.time_ns as i64)
    }

    /// The host's clock is asked at every pause: it knows the hours that the sensor's does not count.
    fn after_pause(&mut self, stamp: Stamp, newest: Newest) -> Option<Resolved> {
        let host_pause_ns = host_pause_ns(stamp, newest)?;
        if host_pause_ns.abs() < PAUSE_NS {
            return None;
        }
        let ahead_ns = self.ahead_ns(stamp, newest);
        let pause_ns = ahead_ns + HOUR_NS * div_round(host_pause_ns - ahead_ns, HOUR_NS);
        // the device's clock goes on: the host's was set, or held packets up
        let is_steady = (-MOST_LATE_NS..MOST_AHEAD_NS).contains(&ahead_ns);
        if (pause_ns - host_pause_ns).abs() > PAUSE_TOLERANCE_NS || (is_steady && pause_ns == ahead_ns) {
            return None;
        }
        if pause_ns < 0 {
            // what was recorded earlier comes later in the file
            return Some(self.start(stamp, Follows::Restart));
        }
        let follows = if pause_ns >= REST_NS { Follows::Pause } else { Follows::On };
        Some(self.advance(newest.time_ns + pause_ns as u64, stamp.host_ns, follows))
    }

    fn step(&mut self, stamp: Stamp, newest: Newest, ahead_ns: i64) -> Resolved {
        if ahead_ns >= 0 {
            return self.advance(newest.time_ns + ahead_ns as u64, stamp.host_ns, Follows::On);
        }
        let time_ns = newest.time_ns.saturating_sub(ahead_ns.unsigned_abs());
        let in_order = time_ns > self.behind.last_ns;
        let packets = if in_order { self.behind.packets + 1 } else { 1 };
        self.behind = Behind { packets, last_ns: time_ns };
        if packets >= STEADY_PACKETS {
            return self.start(stamp, Follows::Restart);
        }
        Resolved { time_ns, follows: Follows::On }
    }

    fn advance(&mut self, time_ns: u64, host_ns: u64, follows: Follows) -> Resolved {
        self.newest = Some(Newest { time_ns, host_ns });
        self.behind = Behind::default();
        Resolved { time_ns, follows }
    }

    fn start(&mut self, stamp: Stamp, follows: Follows) -> Resolved {
        let (stamp_ns, host_ns) = (i64::from(stamp.stamp_us) * 1000, stamp.host_ns);
        let host_ns_signed = i64::try_from(host_ns).unwrap_or(0);
        let hour_ns = host_ns_signed - host_ns_signed.rem_euclid(HOUR_NS);
        let mut time_ns = hour_ns + stamp_ns;
        if host_ns > 0 {
            time_ns += HOUR_NS * div_round(host_ns_signed - time_ns, HOUR_NS);
        }
        let time_ns = if time_ns < 0 { stamp_ns as u64 } else { time_ns as u64 };
        self.advance(time_ns, host_ns, follows)
    }
}

/// How long the host says that nothing came, ns; none where it has no clock.
fn host_pause_ns(stamp: Stamp, newest: Newest) -> Option<i64> {
    (stamp.host_ns > 0 && newest.host_ns > 0).then(|| stamp.host_ns as i64 - newest.host_ns as i64)
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
    const SECOND_NS: u64 = 1_000_000_000;

    fn stamp(stamp_us: u32, host_ns: u64) -> Stamp {
        Stamp { stamp_us, host_ns, is_next: false, period_ns: 1_327_104 }
    }

    #[test]
    fn the_hour_is_the_hosts() {
        let mut clock = HourClock::default();
        let resolved = clock.resolve(stamp(1_082_340_595, HOST_NS));
        let expected = Resolved { time_ns: 1_453_364_282_340_595_000, follows: Follows::On };
        assert_eq!(resolved, Some(expected));
    }

    #[test]
    fn time_rises_across_the_hour() {
        let mut clock = HourClock::default();
        let before_ns = clock.resolve(stamp(3_599_999_000, 0)).unwrap().time_ns;
        let after = clock.resolve(stamp(327, 0)).unwrap();
        assert_eq!((after.time_ns - before_ns, after.follows), (1_327_000, Follows::On));
        let late_ns = clock.resolve(stamp(3_599_999_500, 0)).unwrap().time_ns;
        assert_eq!(late_ns, before_ns + 500_000, "one that came late");
        // a clock that counts on past the hour
        assert_eq!(clock.resolve(stamp(3_600_001_654, 0)).unwrap().time_ns, before_ns + 2_654_000);
    }

    #[test]
    fn a_stamp_far_from_the_host_takes_the_nearest_hour() {
        let mut clock = HourClock::default();
        let host_ns = 1_673_400_471_737_763_000;
        let time_ns = clock.resolve(stamp(140_554_572 + 3_400_000_000, host_ns)).unwrap().time_ns;
        assert!(time_ns.abs_diff(host_ns) <= HOUR_NS as u64 / 2);
    }

    /// Joined recordings: the sensor's clock says what it says every hour.
    #[test]
    fn the_host_says_how_many_hours_a_pause_took() {
        for hours in [1, 2, 24, 24 * 365] {
            for more_ns in [0, SECOND_NS / 2, 60 * SECOND_NS, 3599 * SECOND_NS] {
                let mut clock = HourClock::default();
                let start = clock.resolve(stamp(10, HOST_NS)).unwrap();
                let pause_ns = hours * HOUR_NS as u64 + more_ns;
                let after = clock.resolve(stamp(10 + (more_ns / 1000) as u32, HOST_NS + pause_ns)).unwrap();
                assert_eq!((after.time_ns - start.time_ns, after.follows), (pause_ns, Follows::Pause));
            }
        }
        let mut clock = HourClock::default();
        let start = clock.resolve(stamp(10, HOST_NS)).unwrap();
        let before = clock.resolve(stamp(500_010, HOST_NS - HOUR_NS as u64 + SECOND_NS / 2)).unwrap();
        assert_eq!(start.time_ns - before.time_ns, HOUR_NS as u64 - SECOND_NS / 2);
        assert_eq!(before.follows, Follows::Restart, "what was recorded earlier comes later");
    }

    #[test]
    fn setting_the_host_s_clock_moves_nothing() {
        let mut clock = HourClock::default();
        let start = clock.resolve(stamp(1_000_000, HOST_NS)).unwrap();
        for (at, host_ns) in [(1, HOST_NS + 100 * SECOND_NS), (2, HOST_NS - 7 * SECOND_NS)] {
            let after = clock.resolve(stamp(1_000_000 + at * 1327, host_ns)).unwrap();
            assert_eq!(
                (after.time_ns - start.time_ns, after.follows),
                (u64::from(at) * 1_327_000, Follows::On)
            );
        }
    }

    #[test]
    fn a_clock_that_is_set_back_a_little_restarts() {
        let mut clock = HourClock::default();
        clock.resolve(stamp(10_000_000, HOST_NS));
        let mut take = |stamps_us: &mut dyn Iterator<Item = u32>| {
            let follows = |stamp_us| clock.resolve(stamp(stamp_us, HOST_NS)).unwrap().follows;
            stamps_us.map(follows).map(|follows| follows == Follows::Restart).collect::<Vec<_>>()
        };
        let late = take(&mut (9_500_000..9_500_007).chain([9_500_006, 9_400_000, 10_000_001]));
        assert_eq!(late, [false; 10], "a few that were held up, one of them twice");
        let steady = take(&mut (9_600_000..9_600_009));
        assert_eq!(steady, [false, false, false, false, false, false, false, true, false]);
    }

    #[test]
    fn one_odd_stamp_is_not_believed_and_several_are() {
        let mut clock = HourClock::default();
        clock.resolve(stamp(1_000_000, HOST_NS));
        for odd_us in [900_000_000, 4_000_000, 1_100_000] {
            assert_eq!(clock.resolve(stamp(odd_us, HOST_NS + 1_000_000)), None, "{odd_us}");
        }
        let next = Stamp { is_next: true, ..stamp(900_000, HOST_NS + 1_000_000) };
        assert_eq!(clock.resolve(next), None, "behind, and yet the next one by its azimuth");
        assert_eq!(clock.resolve(Stamp { stamp_us: 1_001_327, ..next }).unwrap().follows, Follows::On);
        assert_eq!(clock.believe(stamp(900_000_000, HOST_NS + 2_000_000)).follows, Follows::Restart);
        assert_eq!(clock.believe(stamp(903_000_000, HOST_NS + 3_000_000)).follows, Follows::On);
    }
}
