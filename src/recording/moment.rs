//! A time as people write it: on the clock, or since the start of a recording.

use std::str::FromStr;

/// Seconds from here on are since 1970: no recording is three years long.
const FIRST_UNIX_S: u64 = 100_000_000;
const SECOND_NS: u64 = 1_000_000_000;

/// A time in a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moment {
    /// Since the first packet, ns.
    SinceStart(u64),
    /// Since 1970, UTC, ns.
    Clock(u64),
    /// The begin of a sensor's revolution, by its number from 0.
    Frame(u64),
}

impl Moment {
    /// On the clock, for a recording that starts then; none of a revolution.
    pub fn time_ns(self, start_ns: u64) -> Option<u64> {
        match self {
            Self::SinceStart(offset_ns) => Some(start_ns.saturating_add(offset_ns)),
            Self::Clock(time_ns) => Some(time_ns),
            Self::Frame(_) => None,
        }
    }

    /// The number of a revolution.
    pub fn frame(self) -> Option<u64> {
        if let Self::Frame(number) = self { Some(number) } else { None }
    }
}

impl FromStr for Moment {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?}: expected seconds since the start (12.5), seconds since 1970 (1700000000.5), a time such as \
                 2023-11-14T22:13:20.5Z, or a revolution (12f)"
            )
        };
        if let Some((day, clock)) = text.split_once(['T', ' ']) {
            let time_ns = date_ns(day).zip(clock_ns(clock.strip_suffix('Z').unwrap_or(clock)));
            let time_ns = time_ns.and_then(|(day_ns, clock_ns)| day_ns.checked_add(clock_ns));
            return time_ns.map(Self::Clock).ok_or_else(wrong);
        }
        if let Some(number) = text.strip_suffix('f') {
            return number.parse().map(Self::Frame).map_err(|_| wrong());
        }
        let ns = decimal_ns(text.strip_suffix('s').unwrap_or(text)).ok_or_else(wrong)?;
        Ok(if ns >= FIRST_UNIX_S * SECOND_NS { Self::Clock(ns) } else { Self::SinceStart(ns) })
    }
}

/// Seconds with up to nine decimals, exactly.
fn decimal_ns(text: &str) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || fraction.len() > 9 || !are_digits(whole) || !are_digits(fraction) {
        return None;
    }
    let fraction_ns: u64 = format!("{fraction:0<9}").parse().ok()?;
    whole.parse::<u64>().ok()?.checked_mul(SECOND_NS)?.checked_add(fraction_ns)
}

/// Of a day: `2023-11-14`.
fn date_ns(text: &str) -> Option<u64> {
    let mut parts = text.split('-').map(|part| part.parse::<u64>().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    if parts.next().is_some()
        || !(1970..2262).contains(&year)
        || !(1..=12).contains(&month)
        || !(1..=31).contains(&day)
    {
        return None;
    }
    // years that begin in March have their leap day at the end
    let year_from_march = if month <= 2 { year - 1 } else { year };
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let days = 365 * year_from_march + year_from_march / 4 - year_from_march / 100
        + year_from_march / 400
        + day_of_year;
    const DAYS_TO_1970: u64 = 719_468;
    (days - DAYS_TO_1970).checked_mul(86_400 * SECOND_NS)
}

/// Of a time of day: `22:13:20.5`.
fn clock_ns(text: &str) -> Option<u64> {
    let mut parts = text.split(':');
    let (hour, minute) = (parts.next()?.parse::<u64>().ok()?, parts.next()?.parse::<u64>().ok()?);
    let second_ns = parts.next().map_or(Some(0), decimal_ns)?;
    let is_time = parts.next().is_none() && hour < 24 && minute < 60 && second_ns < 61 * SECOND_NS;
    is_time.then_some((hour * 3600 + minute * 60) * SECOND_NS + second_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_time() {
        let read = |text: &str| text.parse::<Moment>();
        assert_eq!(read("12.5"), Ok(Moment::SinceStart(12_500_000_000)));
        assert_eq!(
            (read("12f"), read("12s")),
            (Ok(Moment::Frame(12)), Ok(Moment::SinceStart(12_000_000_000)))
        );
        assert_eq!(read("0"), Ok(Moment::SinceStart(0)));
        assert_eq!(read("1700000000.123456789"), Ok(Moment::Clock(1_700_000_000_123_456_789)));
        assert_eq!(read("2023-11-14T22:13:20.5Z"), Ok(Moment::Clock(1_700_000_000_500_000_000)));
        assert_eq!(read("2000-02-29 00:00"), Ok(Moment::Clock(951_782_400_000_000_000)));
        assert_eq!(read("1970-01-01T00:00:00Z"), Ok(Moment::Clock(0)));
        for wrong in ["", "-1", "1.2.3", "1e9", "2023-13-01T00:00Z", "2023-11-14T25:00Z", "x", "f", "1.5f"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
