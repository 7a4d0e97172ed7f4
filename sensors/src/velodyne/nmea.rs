//! The two GPS sentences that a Velodyne passes on: RMC and GGA. Source: NMEA 0183; VLP-16 manual 63-9243 ch. 8.

const DAY_NS: u64 = 86_400_000_000_000;

/// What a sentence says.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Fix {
    /// Time of day, UTC, ns.
    pub time_of_day_ns: u64,
    /// Year, month, day; only RMC has them.
    pub date: Option<(u16, u8, u8)>,
    /// The receiver calls its position valid.
    pub valid: bool,
    /// Latitude, degrees, north positive; none where the receiver leaves it empty.
    pub latitude_deg: Option<f64>,
    /// Longitude, degrees, east positive.
    pub longitude_deg: Option<f64>,
    /// Height above mean sea level, m; only GGA has it.
    pub altitude_m: Option<f64>,
}

/// Why a sentence says nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("GPS sentence: {reason}")]
pub struct NmeaError {
    /// What was found and what was expected.
    pub reason: String,
}

impl Fix {
    /// Reads a `$..RMC` or `$..GGA` sentence with its checksum.
    pub fn parse(sentence: &str) -> Result<Self, NmeaError> {
        let sentence = sentence.trim_end();
        let body = sentence.strip_prefix('$').ok_or_else(|| error("does not begin with $"))?;
        let (body, stated) = body.split_once('*').ok_or_else(|| error("no checksum"))?;
        let computed = body.bytes().fold(0, |sum, byte| sum ^ byte);
        if u8::from_str_radix(stated, 16).ok() != Some(computed) {
            return Err(error(format!("checksum {stated}, its bytes give {computed:02X}")));
        }
        let fields: Vec<&str> = body.split(',').collect();
        let kind = fields[0].get(2..).unwrap_or_default();
        let field = |place: usize| fields.get(place).copied().unwrap_or_default();
        match kind {
            "RMC" => Ok(Self {
                time_of_day_ns: time_of_day_ns(field(1))?,
                date: date(field(9))?,
                valid: field(2) == "A",
                latitude_deg: angle_deg(field(3), field(4))?,
                longitude_deg: angle_deg(field(5), field(6))?,
                altitude_m: None,
            }),
            "GGA" => Ok(Self {
                time_of_day_ns: time_of_day_ns(field(1))?,
                date: None,
                valid: !matches!(field(6), "" | "0"),
                latitude_deg: angle_deg(field(2), field(3))?,
                longitude_deg: angle_deg(field(4), field(5))?,
                altitude_m: optional(field(9))?,
            }),
            _ => Err(error(format!("{:?} is neither RMC nor GGA", fields[0]))),
        }
    }

    /// UTC, ns since 1970, where the sentence has a date.
    pub fn utc_ns(&self) -> Option<u64> {
        let (year, month, day) = self.date?;
        let days = days_since_1970(i64::from(year), i64::from(month), i64::from(day));
        Some(u64::try_from(days).ok()? * DAY_NS + self.time_of_day_ns)
    }
}

/// An RMC sentence of a receiver that stands at latitude and longitude 0, without its line end.
pub fn rmc_sentence(utc_ns: u64) -> String {
    let (days, of_day_ns) = (utc_ns / DAY_NS, utc_ns % DAY_NS);
    let (year, month, day) = date_of_day(days as i64);
    let seconds = of_day_ns / 1_000_000_000;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    let hundredths = of_day_ns / 10_000_000 % 100;
    let body = format!(
        "GPRMC,{hours:02}{minutes:02}{seconds:02}.{hundredths:02},A,0000.0000,N,00000.0000,E,0.0,0.0,{day:02}{month:02}{:02},,,A",
        year % 100
    );
    let checksum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("${body}*{checksum:02X}")
}

fn error(reason: impl Into<String>) -> NmeaError {
    NmeaError { reason: reason.into() }
}

fn number(text: &str) -> Result<f64, NmeaError> {
    let plain = text.bytes().all(|byte| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+'));
    text.parse().ok().filter(|_| plain).ok_or_else(|| error(format!("{text:?} is no number")))
}

fn optional(text: &str) -> Result<Option<f64>, NmeaError> {
    if text.is_empty() { Ok(None) } else { number(text).map(Some) }
}

/// Digits `from..to` of a field.
fn digits(text: &str, from: usize, to: usize) -> Result<u8, NmeaError> {
    let part = text.get(from..to).filter(|part| part.bytes().all(|byte| byte.is_ascii_digit()));
    part.and_then(|part| part.parse().ok())
        .ok_or_else(|| error(format!("{text:?} has no digits {from} to {to}")))
}

fn time_of_day_ns(text: &str) -> Result<u64, NmeaError> {
    let (hours, minutes) = (u64::from(digits(text, 0, 2)?), u64::from(digits(text, 2, 4)?));
    let seconds = number(text.get(4..).unwrap_or_default())?;
    if hours > 23 || minutes > 59 || !(0.0..61.0).contains(&seconds) {
        return Err(error(format!("{text:?} is no time of day")));
    }
    Ok((hours * 60 + minutes) * 60_000_000_000 + (seconds * 1e9).round() as u64)
}

fn date(text: &str) -> Result<Option<(u16, u8, u8)>, NmeaError> {
    if text.is_empty() {
        return Ok(None);
    }
    let (day, month, year) = (digits(text, 0, 2)?, digits(text, 2, 4)?, digits(text, 4, 6)?);
    if !(1..=31).contains(&day) || !(1..=12).contains(&month) {
        return Err(error(format!("{text:?} is no date")));
    }
    Ok(Some((2000 + u16::from(year), month, day)))
}

/// `ddmm.mmm` or `dddmm.mmm` and its hemisphere.
fn angle_deg(text: &str, hemisphere: &str) -> Result<Option<f64>, NmeaError> {
    let Some(value) = optional(text)? else { return Ok(None) };
    let degrees = (value / 100.0).trunc();
    let angle_deg = degrees + (value - degrees * 100.0) / 60.0;
    match hemisphere {
        "N" | "E" => Ok(Some(angle_deg)),
        "S" | "W" => Ok(Some(-angle_deg)),
        _ => Err(error(format!("hemisphere {hemisphere:?}"))),
    }
}

/// Days from 1970-01-01 in the Gregorian calendar. Source: H. Hinnant, "chrono-compatible low-level date algorithms".
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let year_of_era = year - era * 400;
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// Year, month and day: the inverse of [`days_since_1970`].
fn date_of_day(days: i64) -> (i64, i64, i64) {
    let mut year = 1970 + days / 366;
    while days_since_1970(year + 1, 1, 1) <= days {
        year += 1;
    }
    let month = (1..=12).rev().find(|month| days_since_1970(year, *month, 1) <= days).unwrap_or(1);
    (year, month, days - days_since_1970(year, month, 1) + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rmc_gives_date_time_and_place() {
        let fix =
            Fix::parse("$GPRMC,081802.50,A,3723.2475,N,12158.3416,W,0.13,309.62,210116,,*20\r\n").unwrap();
        assert_eq!(fix.date, Some((2016, 1, 21)));
        assert_eq!(fix.utc_ns(), Some(1_453_364_282_500_000_000));
        assert!((fix.latitude_deg.unwrap() - 37.387_458_333).abs() < 1e-8);
        assert!((fix.longitude_deg.unwrap() + 121.972_36).abs() < 1e-8);
    }

    #[test]
    fn gga_gives_height_and_no_date() {
        let fix = Fix::parse(
            "$GPGGA,172814.0,3723.46587704,N,12202.26957864,W,2,6,1.2,18.893,M,-25.669,M,2.0,0031*4F",
        );
        let fix = fix.unwrap();
        assert_eq!((fix.altitude_m, fix.utc_ns(), fix.valid), (Some(18.893), None, true));
    }

    #[test]
    fn a_written_sentence_is_read_back() {
        // the last second of a leap day, the last of a century's year, and a plain one
        for utc_ns in [1_709_251_199_000_000_000, 978_307_199_000_000_000, 1_700_000_000_250_000_000] {
            let fix = Fix::parse(&rmc_sentence(utc_ns)).unwrap();
            assert_eq!((fix.utc_ns(), fix.valid, fix.latitude_deg), (Some(utc_ns), true, Some(0.0)));
        }
    }

    #[test]
    fn damage_is_reported() {
        for (sentence, word) in [
            ("GPRMC", "begin"),
            ("$GPRMC,1", "checksum"),
            ("$GPRMC,081802*00", "checksum 00"),
            ("$GPZDA*48", "neither"),
            ("$*00", "neither"),
        ] {
            let reason = Fix::parse(sentence).unwrap_err().to_string();
            assert!(reason.contains(word), "{sentence}: {reason}");
        }
    }
}
