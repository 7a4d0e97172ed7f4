//! Times as files write them: seconds, or whole milli-, micro- or nanoseconds, to nanoseconds without the rounding of f64,
//! which is 0.2 µs at today's Unix times.

/// What a time counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TimeUnit {
    Second,
    Millisecond,
    Microsecond,
    Nanosecond,
}

impl TimeUnit {
    /// As headers name it.
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        match name {
            "s" | "sec" | "secs" | "seconds" => Some(Self::Second),
            "ms" | "msec" | "milliseconds" => Some(Self::Millisecond),
            "us" | "usec" | "microseconds" => Some(Self::Microsecond),
            "ns" | "nsec" | "nanoseconds" => Some(Self::Nanosecond),
            _ => None,
        }
    }

    /// In words.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Second => "seconds",
            Self::Millisecond => "milliseconds",
            Self::Microsecond => "microseconds",
            Self::Nanosecond => "nanoseconds",
        }
    }

    /// The one in which a time is of this century: 1e11 s are 3,000 years, 1e11 ms three.
    pub(crate) fn of_size(stamp: &str) -> Self {
        match stamp.parse::<f64>().unwrap_or(0.0) {
            seconds if seconds < 1e11 => Self::Second,
            milliseconds if milliseconds < 1e14 => Self::Millisecond,
            microseconds if microseconds < 1e17 => Self::Microsecond,
            _ => Self::Nanosecond,
        }
    }

    fn digits(self) -> i32 {
        match self {
            Self::Second => 9,
            Self::Millisecond => 6,
            Self::Microsecond => 3,
            Self::Nanosecond => 0,
        }
    }

    /// A time in nanoseconds; none where it is no number, negative or beyond 584 years.
    pub(crate) fn nanoseconds(self, stamp: &str) -> Option<u64> {
        let stamp = stamp.strip_prefix('+').unwrap_or(stamp);
        let (mantissa, power) = match stamp.split_once(['e', 'E']) {
            Some((mantissa, power)) => (mantissa, power.parse::<i32>().ok()?),
            None => (stamp, 0),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let is_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        if whole.len() + fraction.len() == 0 || !is_digits(whole) || !is_digits(fraction) {
            return None;
        }
        // 38 digits fit; what comes after the thirtieth is below any nanosecond
        let fraction = &fraction[..fraction.len().min(30_usize.saturating_sub(whole.len()))];
        let digits: u128 = format!("0{whole}{fraction}").parse().ok()?;
        let shift = power.checked_sub(fraction.len() as i32)?.checked_add(self.digits())?;
        let scale = 10_u128.checked_pow(shift.unsigned_abs());
        let nanoseconds = match (shift >= 0, scale) {
            (true, Some(scale)) => digits.checked_mul(scale)?,
            (true, None) if digits > 0 => return None,
            (false, Some(scale)) => digits / scale + u128::from(digits % scale * 2 >= scale),
            (_, None) => 0,
        };
        u64::try_from(nanoseconds).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_nanosecond_is_lost() {
        let seconds = |text| TimeUnit::Second.nanoseconds(text);
        assert_eq!(seconds("1700000000.123456789"), Some(1_700_000_000_123_456_789));
        assert_eq!(seconds("0.0000000005"), Some(1));
        assert_eq!(seconds("1.5e1"), Some(15_000_000_000));
        assert_eq!(seconds("1.700000000123456789e+09"), Some(1_700_000_000_123_456_789));
        assert_eq!(seconds("7"), Some(7_000_000_000));
        assert_eq!(seconds("7."), Some(7_000_000_000));
        assert_eq!(seconds("1e-30"), Some(0));
        for none in ["inf", "nan", "-1", "", ".", "1e", "99999999999999999999", "1e40", "1.2.3", "0x1"] {
            assert_eq!(seconds(none), None, "{none}");
        }
        assert_eq!(TimeUnit::Nanosecond.nanoseconds("1403636580838555648"), Some(1_403_636_580_838_555_648));
        assert_eq!(TimeUnit::Microsecond.nanoseconds("1403636580838555"), Some(1_403_636_580_838_555_000));
        assert_eq!(TimeUnit::Millisecond.nanoseconds("1403636580838.5"), Some(1_403_636_580_838_500_000));
    }

    #[test]
    fn the_size_of_a_time_says_its_unit() {
        for (stamp, unit) in [
            ("0", TimeUnit::Second),
            ("1403636580.838", TimeUnit::Second),
            ("1403636580838", TimeUnit::Millisecond),
            ("1403636580838555", TimeUnit::Microsecond),
            ("1403636580838555648", TimeUnit::Nanosecond),
            ("1.403636580838555648e+18", TimeUnit::Nanosecond),
        ] {
            assert_eq!(TimeUnit::of_size(stamp), unit, "{stamp}");
        }
    }
}
