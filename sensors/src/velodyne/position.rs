//! The position packet, 512 bytes: GPS sentence, state of the pulse per second, time, and what newer firmware and the
//! HDL-32E add. Sources: VLP-16 manual 63-9243 ch. 9.3.6, HDL-32E manual 63-9113 app. C.

use super::nmea::{Fix, NmeaError};
use super::wire::POSITION_PACKET_BYTES;

/// One position packet.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Position {
    /// Host arrival time, ns since 1970; 0 when the host has no clock.
    pub host_time_ns: u64,
    /// Microseconds since the top of the hour, as sent.
    pub stamp_us: u32,
    /// Pulse per second.
    pub pulse: PulseState,
    /// The GPS sentence as it is, without its line end; empty without a receiver.
    pub sentence: String,
    /// Temperatures and their history, zero in older firmware.
    pub thermal: Thermal,
    /// The three inertial units of an HDL-32E; none where nothing is sent.
    pub inertial: Option<[Inertial; 3]>,
}

/// State of the pulse per second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PulseState {
    /// No pulse.
    #[default]
    Absent,
    /// Pulses come, the clock follows.
    Synchronising,
    /// The clock is set by the pulse.
    Locked,
    /// Pulses come and make no sense.
    Error,
    /// A state no manual knows.
    Unknown(u8),
}

/// What newer firmware says about the temperature (VLP-16 3.0.29 and later, VLS-128), degrees Celsius.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Thermal {
    /// Top board.
    pub top_c: u8,
    /// Bottom board.
    pub bottom_c: u8,
    /// When the converters were last calibrated.
    pub at_calibration_c: u8,
    /// Change since then.
    pub change_c: i16,
    /// Seconds since then.
    pub since_calibration_s: u32,
    /// Why they were calibrated: 0 none, 1 power-on, 2 manual, 3 change of temperature, 4 period.
    pub calibration_reason: u8,
    /// Bit 0: calibrating, bit 1: change too large, bit 2: period over.
    pub calibration_flags: u8,
    /// The sensor shut down because of heat.
    pub shut_down: bool,
    /// Temperature at the last shutdown.
    pub at_shutdown_c: u8,
    /// Temperature at the last start.
    pub at_start_c: u8,
}

/// One of the two-axis accelerometers with gyroscope of an HDL-32E.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Inertial {
    /// Angular rate, rad/s.
    pub rate_rad_s: f64,
    /// Temperature, degrees Celsius.
    pub temperature_c: f64,
    /// Acceleration along its two axes, m/s^2.
    pub acceleration_m_s2: [f64; 2],
}

/// Units of the inertial values: 0.09766 deg/s, 0.1453 K from 25 degrees Celsius, 0.001221 g.
const RATE_RAD_S: f64 = 0.09766 * std::f64::consts::PI / 180.0;
const TEMPERATURE_K: f64 = 0.1453;
const TEMPERATURE_ZERO_C: f64 = 25.0;
const ACCELERATION_M_S2: f64 = 0.001_221 * 9.806_65;

const INERTIAL: std::ops::Range<usize> = 14..38;
const TOP: usize = 0xBB;
const STAMP: usize = 0xC6;
const PULSE: usize = 0xCA;
const SENTENCE: std::ops::Range<usize> = 0xCE..0xCE + 128;

impl Position {
    /// Reads a position packet; every packet of this length says something.
    pub fn parse(payload: &[u8; POSITION_PACKET_BYTES], host_time_ns: u64) -> Self {
        let short = |at: usize| u16::from_le_bytes([payload[at], payload[at + 1]]);
        let long = |at: usize| u32::from(short(at)) | u32::from(short(at + 2)) << 16;
        let sentence = &payload[SENTENCE];
        let end = sentence.iter().position(|byte| *byte == 0).unwrap_or(sentence.len());
        let unit = |place: usize| {
            let at = INERTIAL.start + 8 * place;
            let [rate, temperature, x, y] =
                [0, 2, 4, 6].map(|offset| f64::from(signed_12(short(at + offset))));
            Inertial {
                rate_rad_s: rate * RATE_RAD_S,
                temperature_c: temperature * TEMPERATURE_K + TEMPERATURE_ZERO_C,
                acceleration_m_s2: [x * ACCELERATION_M_S2, y * ACCELERATION_M_S2],
            }
        };
        Self {
            host_time_ns,
            stamp_us: long(STAMP),
            pulse: PulseState::from_byte(payload[PULSE]),
            sentence: String::from_utf8_lossy(&sentence[..end]).trim_end().to_owned(),
            thermal: Thermal {
                top_c: payload[TOP],
                bottom_c: payload[TOP + 1],
                at_calibration_c: payload[TOP + 2],
                change_c: short(TOP + 3) as i16,
                since_calibration_s: long(TOP + 5),
                calibration_reason: payload[TOP + 9],
                calibration_flags: payload[TOP + 10],
                shut_down: payload[PULSE + 1] == 1,
                at_shutdown_c: payload[PULSE + 2],
                at_start_c: payload[PULSE + 3],
            },
            inertial: payload[INERTIAL].iter().any(|byte| *byte != 0).then(|| [unit(0), unit(1), unit(2)]),
        }
    }

    /// What the GPS sentence says.
    pub fn fix(&self) -> Result<Fix, NmeaError> {
        Fix::parse(&self.sentence)
    }

    /// UTC at this packet, ns since 1970: the microseconds of the hour, in the hour of the GPS sentence. None while
    /// the clock is not locked to the pulse or the sentence has no date.
    pub fn utc_ns(&self) -> Option<u64> {
        if self.pulse != PulseState::Locked {
            return None;
        }
        let sentence_ns = self.fix().ok()?.utc_ns()?;
        let stamp_ns = u64::from(self.stamp_us) * 1000;
        // the sentence is up to a second old: at the top of the hour it may still name the hour before
        let ahead_ns = stamp_ns as i64 - (sentence_ns % HOUR_NS) as i64;
        let half = HOUR_NS as i64 / 2;
        let hour_ns = sentence_ns - sentence_ns % HOUR_NS;
        Some(match ahead_ns {
            ahead if ahead < -half => hour_ns + HOUR_NS + stamp_ns,
            ahead if ahead > half => (hour_ns + stamp_ns).saturating_sub(HOUR_NS),
            _ => hour_ns + stamp_ns,
        })
    }

    /// The packet. A sentence longer than 126 bytes is cut.
    pub fn encode(&self) -> [u8; POSITION_PACKET_BYTES] {
        let mut payload = [0; POSITION_PACKET_BYTES];
        let mut put = |at: usize, bytes: &[u8]| payload[at..at + bytes.len()].copy_from_slice(bytes);
        for (place, unit) in self.inertial.iter().flatten().enumerate() {
            let values = [
                unit.rate_rad_s / RATE_RAD_S,
                (unit.temperature_c - TEMPERATURE_ZERO_C) / TEMPERATURE_K,
                unit.acceleration_m_s2[0] / ACCELERATION_M_S2,
                unit.acceleration_m_s2[1] / ACCELERATION_M_S2,
            ];
            for (offset, value) in values.into_iter().enumerate() {
                let word = (value.round().clamp(-2048.0, 2047.0) as i16 as u16) & 0xFFF;
                // the upper four bits number the values of a unit
                let word = word | (offset as u16) << 12;
                put(INERTIAL.start + 8 * place + 2 * offset, &word.to_le_bytes());
            }
        }
        let thermal = &self.thermal;
        put(TOP, &[thermal.top_c, thermal.bottom_c, thermal.at_calibration_c]);
        put(TOP + 3, &thermal.change_c.to_le_bytes());
        put(TOP + 5, &thermal.since_calibration_s.to_le_bytes());
        put(TOP + 9, &[thermal.calibration_reason, thermal.calibration_flags]);
        put(STAMP, &self.stamp_us.to_le_bytes());
        put(
            PULSE,
            &[self.pulse.byte(), u8::from(thermal.shut_down), thermal.at_shutdown_c, thermal.at_start_c],
        );
        let sentence = &self.sentence.as_bytes()[..self.sentence.len().min(SENTENCE.len() - 2)];
        put(SENTENCE.start, sentence);
        if !sentence.is_empty() {
            put(SENTENCE.start + sentence.len(), b"\r\n");
        }
        payload
    }
}

impl PulseState {
    fn from_byte(byte: u8) -> Self {
        match byte {
            0 => Self::Absent,
            1 => Self::Synchronising,
            2 => Self::Locked,
            3 => Self::Error,
            other => Self::Unknown(other),
        }
    }

    fn byte(self) -> u8 {
        match self {
            Self::Absent => 0,
            Self::Synchronising => 1,
            Self::Locked => 2,
            Self::Error => 3,
            Self::Unknown(byte) => byte,
        }
    }
}

const HOUR_NS: u64 = 3_600_000_000_000;

fn signed_12(word: u16) -> i16 {
    ((word << 4) as i16) >> 4
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn position() -> Position {
        Position {
            host_time_ns: 5,
            stamp_us: 1_082_340_595,
            pulse: PulseState::Locked,
            sentence: "$GPRMC,081802.50,A,3723.2475,N,12158.3416,W,0.13,309.62,210116,,*20".to_owned(),
            thermal: Thermal { top_c: 40, change_c: -3, since_calibration_s: 77_000, ..Thermal::default() },
            inertial: None,
        }
    }

    #[test]
    fn what_is_encoded_is_read() {
        let sent = position();
        assert_eq!(Position::parse(&sent.encode(), 5), sent);
        assert_eq!(sent.utc_ns(), Some(1_453_364_282_340_595_000));
    }

    #[test]
    fn at_the_top_of_the_hour_the_sentence_lags() {
        let mut late = position();
        late.sentence = "$GPRMC,085959.50,A,3723.2475,N,12158.3416,W,0.13,309.62,210116,,*2B".to_owned();
        late.stamp_us = 200_000;
        let nine = 1_453_366_800_000_000_000;
        assert_eq!(late.utc_ns(), Some(nine + 200_000_000));
        late.pulse = PulseState::Absent;
        assert_eq!(late.utc_ns(), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_and_come_back(bytes in proptest::collection::vec(any::<u8>(), 512)) {
            let payload: [u8; 512] = bytes.try_into().unwrap();
            let position = Position::parse(&payload, 0);
            let _any_answer = position.fix();
            let again = Position::parse(&position.encode(), 0);
            prop_assert_eq!(again.thermal, position.thermal);
            prop_assert_eq!(again.stamp_us, position.stamp_us);
            prop_assert_eq!(again.pulse, position.pulse);
            prop_assert_eq!(again.inertial, position.inertial);
        }
    }
}
