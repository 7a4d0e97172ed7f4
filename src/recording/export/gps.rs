//! GPS time, as survey formats count it: seconds since 1980 without the leap seconds of UTC.

use super::TimeScale;

const SECOND_NS: i64 = 1_000_000_000;
/// 1980-01-06 in s since 1970.
const EPOCH_S: u64 = 315_964_800;
/// From when on (s since 1970) GPS time is so many seconds ahead of UTC, newest first. Source: IERS Bulletin C; none was
/// announced after 2017. Stamps before 2000 are no dates.
const AHEAD_S: [(u64, u64); 6] = [
    (1_483_228_800, 18),
    (1_435_708_800, 17),
    (1_341_100_800, 16),
    (1_230_768_000, 15),
    (1_136_073_600, 14),
    (0, 13),
];

/// GPS time is behind TAI by this, ns.
const BEHIND_TAI_NS: i64 = 19 * SECOND_NS;

/// GPS time of a moment (ns since 1970), ns since the GPS epoch.
pub(super) fn gps_ns(time_ns: u64, scale: TimeScale) -> i64 {
    match scale {
        TimeScale::Tai => {
            i64::try_from(time_ns).unwrap_or(i64::MAX) - EPOCH_S as i64 * SECOND_NS - BEHIND_TAI_NS
        }
        TimeScale::Utc | TimeScale::Host => of_utc_ns(time_ns),
    }
}

fn of_utc_ns(utc_ns: u64) -> i64 {
    let utc_s = utc_ns / SECOND_NS as u64;
    let ahead_s = AHEAD_S.iter().find(|(from_s, _)| utc_s >= *from_s).map_or(0, |(_, ahead_s)| *ahead_s);
    i64::try_from(utc_ns).unwrap_or(i64::MAX) - (EPOCH_S as i64 - ahead_s as i64) * SECOND_NS
}

/// Year and day of the year in UTC, from 1, of a moment (ns since 1970).
pub(super) fn year_and_day(time_ns: u64, scale: TimeScale) -> (u16, u16) {
    let ahead_ns = if scale == TimeScale::Tai { 37 * SECOND_NS as u64 } else { 0 };
    let utc_ns = time_ns.saturating_sub(ahead_ns);
    const DAY_NS: u64 = 86_400_000_000_000;
    let (mut year, mut day) = (1970_u16, utc_ns / DAY_NS);
    loop {
        let is_leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
        let days = 365 + u64::from(is_leap);
        if day < days {
            return (year, day as u16 + 1);
        }
        (year, day) = (year + 1, day - days);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leap_seconds_begin_when_they_did() {
        let gps_s = |utc_s: u64| gps_ns(utc_s * 1_000_000_000, TimeScale::Utc) / SECOND_NS;
        // the second of GPS time 1167264018 is the first of 2017
        assert_eq!(gps_s(1_483_228_800), 1_167_264_018);
        assert_eq!(gps_s(1_483_228_799), 1_167_264_016);
        assert_eq!(gps_s(1_673_398_940), 1_357_434_158);
        assert_eq!(gps_s(946_684_800), 630_720_013);
        assert_eq!(of_utc_ns(u64::MAX / 2), of_utc_ns(u64::MAX / 2 - 1) + 1);
        let tai_s = 1_700_000_037;
        assert_eq!(gps_ns(tai_s * 1_000_000_000, TimeScale::Tai) / SECOND_NS, gps_s(tai_s - 37));
    }

    #[test]
    fn days_of_the_year() {
        let at = |utc_s: u64| year_and_day(utc_s * 1_000_000_000, TimeScale::Utc);
        assert_eq!((at(0), at(951_782_400), at(1_700_000_000)), ((1970, 1), (2000, 60), (2023, 318)));
        assert_eq!((at(1_735_603_200), at(1_735_689_600)), ((2024, 366), (2025, 1)));
    }
}
