//! What a sensor's clock shows, judged against the host's.

use serde::Serialize;

/// 2000-01-01 in ns since 1970: a clock that shows less counts from power-on.
const FIRST_DATE_NS: u64 = 946_684_800_000_000_000;
/// TAI is ahead of UTC by this since 2017 (IERS Bulletin C).
const TAI_AHEAD_S: f64 = 37.0;
/// Hosts without a time source are off by less than this.
const SAME_S: f64 = 1.0;
/// A change of the difference from one frame to the next that no network makes.
const JUMP_S: f64 = 0.25;
/// Shorter recordings do not show drift above the jitter of hosts.
const DRIFT_NEEDS_S: f64 = 10.0;

/// Pairs of host and device time, one per frame.
#[derive(Default)]
pub struct ClockWatch {
    first: Option<[u64; 2]>,
    last: Option<[u64; 2]>,
    least_offset_ns: Option<i128>,
    greatest_offset_ns: Option<i128>,
    steps_back: u64,
    jumps: u64,
    last_jump_s: Option<f64>,
    /// Device time ran backwards since `first`.
    stepped: bool,
}

/// What is said about a clock.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClockReport {
    /// `since_power_on`, `utc`, `tai` or `unsynchronised`; `unknown` without host times.
    pub state: &'static str,
    /// Host minus device at the first frame, s.
    pub host_minus_device_s: f64,
    /// How much that varies from frame to frame: jitter of the network and the host, s.
    pub variation_s: f64,
    /// How fast the device's clock loses against the host's, parts per million; from 10 s on.
    pub drift_ppm: Option<f64>,
    /// Times that device time ran backwards.
    pub steps_back: u64,
    /// Times that one of the clocks jumped: the numbers above are those since the last time.
    pub jumps: u64,
    /// How far host minus device moved in the last of them, s.
    pub last_jump_s: Option<f64>,
}

impl ClockWatch {
    /// Takes the arrival and the device time of one frame's start.
    pub fn add(&mut self, host_ns: u64, device_ns: u64) {
        let offset_ns = i128::from(host_ns) - i128::from(device_ns);
        if let Some([last_host_ns, last_device_ns]) = self.last {
            let moved_ns = offset_ns - (i128::from(last_host_ns) - i128::from(last_device_ns));
            let stepped = device_ns < last_device_ns;
            self.steps_back += u64::from(stepped);
            self.stepped |= stepped;
            if moved_ns.unsigned_abs() as f64 * 1e-9 > JUMP_S && host_ns > 0 {
                self.jumps += 1;
                self.last_jump_s = Some(moved_ns as f64 * 1e-9);
                (self.first, self.least_offset_ns, self.greatest_offset_ns) = (None, None, None);
                self.stepped = false;
            }
        }
        self.first.get_or_insert([host_ns, device_ns]);
        self.last = Some([host_ns, device_ns]);
        self.least_offset_ns = Some(self.least_offset_ns.map_or(offset_ns, |least| least.min(offset_ns)));
        self.greatest_offset_ns = Some(self.greatest_offset_ns.map_or(offset_ns, |most| most.max(offset_ns)));
    }

    /// Says what the clock shows; nothing without frames.
    pub fn report(&self) -> Option<ClockReport> {
        let ([host_ns, device_ns], [last_host_ns, last_device_ns]) = (self.first?, self.last?);
        let host_minus_device_s = (i128::from(host_ns) - i128::from(device_ns)) as f64 * 1e-9;
        let host_span_s = last_host_ns.saturating_sub(host_ns) as f64 * 1e-9;
        let device_span_s = last_device_ns.saturating_sub(device_ns) as f64 * 1e-9;
        let state = if host_ns == 0 {
            "unknown"
        } else if device_ns < FIRST_DATE_NS {
            "since_power_on"
        } else if host_minus_device_s.abs() < SAME_S {
            "utc"
        } else if (host_minus_device_s + TAI_AHEAD_S).abs() < SAME_S {
            "tai"
        } else {
            "unsynchronised"
        };
        let drift_ppm = (host_span_s >= DRIFT_NEEDS_S && !self.stepped)
            .then(|| (host_span_s - device_span_s) / host_span_s * 1e6);
        let variation_s = (self.greatest_offset_ns? - self.least_offset_ns?) as f64 * 1e-9;
        Some(ClockReport {
            state,
            host_minus_device_s,
            variation_s,
            drift_ppm,
            steps_back: self.steps_back,
            jumps: self.jumps,
            last_jump_s: self.last_jump_s,
        })
    }
}

impl ClockReport {
    /// In words.
    pub fn text(&self) -> String {
        let offset_s = self.host_minus_device_s;
        let mut text = match self.state {
            "since_power_on" => "counts from power-on; not synchronised".to_owned(),
            "utc" => format!("shows UTC ({:.3} ms behind the host)", offset_s * 1e3),
            "tai" => {
                format!("shows TAI by PTP ({:.3} s ahead of the host): subtract 37 s for UTC", -offset_s)
            }
            "unknown" => "the recording has no host times to compare with".to_owned(),
            _ => format!(
                "is {:.3} s {} the host",
                offset_s.abs(),
                if offset_s > 0.0 { "behind" } else { "ahead of" }
            ),
        };
        if let Some(drift_ppm) = self.drift_ppm {
            text.push_str(&format!("; drifts by {drift_ppm:.1} ppm"));
        }
        if self.steps_back > 0 {
            text.push_str(&format!("; ran backwards {} times", self.steps_back));
        }
        if self.jumps > 0 {
            text.push_str(&format!("; jumped {} times", self.jumps));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOST_NS: u64 = 1_700_000_000_000_000_000;

    fn state(device_ns: u64) -> &'static str {
        let mut watch = ClockWatch::default();
        watch.add(HOST_NS, device_ns);
        watch.report().unwrap().state
    }

    #[test]
    fn clocks_are_named_by_what_they_show() {
        assert_eq!(state(991_587_364_520), "since_power_on");
        assert_eq!(state(HOST_NS - 3_000_000), "utc");
        assert_eq!(state(HOST_NS + 37_000_000_000), "tai");
        assert_eq!(state(HOST_NS - 25 * 60_000_000_000), "unsynchronised");
    }

    #[test]
    fn a_jump_is_counted_and_begins_anew() {
        let mut watch = ClockWatch::default();
        for frame in 0..300_u64 {
            let jumped_ns = if frame >= 150 { 90_000_000_000 } else { 0 };
            watch.add(HOST_NS + frame * 100_010_000, 500_000_000_000 - jumped_ns + frame * 100_000_000);
        }
        let report = watch.report().unwrap();
        assert_eq!((report.jumps, report.steps_back), (1, 1));
        assert!((report.last_jump_s.unwrap() - 90.0).abs() < 1e-3 && report.variation_s < 0.1, "{report:?}");
        assert!((report.drift_ppm.unwrap() - 100.0).abs() < 0.1, "{report:?}");
    }

    #[test]
    fn drift_needs_time() {
        let mut watch = ClockWatch::default();
        for frame in 0..200_u64 {
            watch.add(HOST_NS + frame * 100_010_000, 5_000_000_000 + frame * 100_000_000);
            let drift_ppm = watch.report().unwrap().drift_ppm;
            assert_eq!(drift_ppm.is_some(), frame >= 100, "{frame}");
        }
        let drift_ppm = watch.report().unwrap().drift_ppm.unwrap();
        assert!((drift_ppm - 100.0).abs() < 0.1, "{drift_ppm}");
    }
}
