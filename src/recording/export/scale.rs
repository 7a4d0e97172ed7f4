//! The time scale of a sensor's stamps: by its configuration, checked against the host's clock.

use std::fmt;

use sensors::ouster::TimestampMode;

/// Stamps before this are no dates: 2000-01-01 in ns since 1970. A sensor without a time source counts from power-on.
pub(crate) const FIRST_DATE_NS: u64 = 946_684_800_000_000_000;
/// TAI is ahead of UTC by this since 2017 (IERS Bulletin C).
const TAI_AHEAD_S: f64 = 37.0;
/// Hosts without a time source are off by less than this.
const SAME_S: f64 = 1.0;

/// The time that stamps are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeScale {
    /// UTC, the sensor's own.
    #[default]
    Utc,
    /// International atomic time, as PTP brings it.
    Tai,
    /// The sensor keeps no date: the host's time of arrival stands in for it.
    Host,
}

impl TimeScale {
    /// That of a sensor in this mode, by the stamps of sensor and host at one moment, ns since 1970; no host time is 0.
    pub fn of(mode: Option<TimestampMode>, device_ns: u64, host_ns: u64) -> Self {
        if device_ns < FIRST_DATE_NS {
            return Self::Host;
        }
        let ahead_s = (host_ns > 0).then(|| (i128::from(device_ns) - i128::from(host_ns)) as f64 * 1e-9);
        let is_tai = match (mode, ahead_s) {
            // a master may distribute UTC; hosts are off by less than half of what lies between the two
            (Some(TimestampMode::Ptp1588), Some(ahead_s)) => ahead_s.abs() > TAI_AHEAD_S / 2.0,
            (Some(TimestampMode::Ptp1588), None) => true,
            (Some(_), Some(ahead_s)) => (ahead_s - TAI_AHEAD_S).abs() < SAME_S,
            _ => false,
        };
        if is_tai { Self::Tai } else { Self::Utc }
    }
}

impl fmt::Display for TimeScale {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Utc => "UTC",
            Self::Tai => "TAI by PTP, 37 s ahead of UTC; GPS time in LAS and E57 is 19 s behind it",
            Self::Host => "since power-on; LAS and E57 have the host's time of arrival",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ptp_is_tai_unless_the_master_distributes_utc() {
        let (ptp, utc_ns) = (Some(TimestampMode::Ptp1588), 1_700_000_000_000_000_000);
        let of = |mode, ahead_s: i64, host_ns: u64| {
            TimeScale::of(mode, (utc_ns as i64 + ahead_s * 1_000_000_000) as u64, host_ns)
        };
        assert_eq!(of(ptp, 37, utc_ns), TimeScale::Tai);
        assert_eq!(of(ptp, 33, utc_ns), TimeScale::Tai, "a host that is 4 s ahead");
        assert_eq!((of(ptp, 0, utc_ns), of(ptp, 0, 0)), (TimeScale::Utc, TimeScale::Tai));
        let pulse = Some(TimestampMode::SyncPulseIn);
        assert_eq!((of(pulse, 0, utc_ns), of(pulse, 37, utc_ns)), (TimeScale::Utc, TimeScale::Tai));
        assert_eq!((of(pulse, 30, utc_ns), of(None, 37, utc_ns)), (TimeScale::Utc, TimeScale::Utc));
        assert_eq!(TimeScale::of(ptp, 5_000_000_000, utc_ns), TimeScale::Host);
    }
}
