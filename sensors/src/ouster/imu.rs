//! Inertial packets, both formats, in SI units.
//!
//! Source: Ouster firmware user manual, "IMU data format"; checked on captured packets of both formats (gravity reads
//! 1.0 in LEGACY and 9.8 in ACCEL32).

use super::wire::{FOOTER_BYTES, HEADER_BYTES, u32_at, u64_at};

/// Bytes of a LEGACY packet.
pub const LEGACY_BYTES: usize = 48;

const STANDARD_GRAVITY_M_S2: f64 = 9.806_65; // BIPM, SI brochure, conventional value
const NMEA_BLOCK_BYTES: usize = 100;
const NMEA_TEXT: std::ops::Range<usize> = HEADER_BYTES + 8..HEADER_BYTES + 93;
const SAMPLE_BYTES: usize = 36;

/// One inertial sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Device time, ns.
    pub time_ns: u64,
    /// Acceleration, m/s^2, sensor frame.
    pub acceleration_m_s2: [f64; 3],
    /// Angular rate, rad/s, sensor frame.
    pub angular_rate_rad_s: [f64; 3],
}

/// Bytes of an ACCEL32_GYRO32_NMEA packet.
pub(crate) fn accel32_bytes(samples_per_packet: usize) -> usize {
    HEADER_BYTES + NMEA_BLOCK_BYTES + samples_per_packet * SAMPLE_BYTES + FOOTER_BYTES
}

/// Reads a LEGACY packet. Its first time stamp counts from power-on whatever the clock; the gyroscope's is in the
/// clock of the columns.
pub(crate) fn read_legacy(packet: &[u8; LEGACY_BYTES]) -> ImuSample {
    let values = |at: usize, unit: f64| [0, 4, 8].map(|axis| f64::from(f32_at(packet, at + axis)) * unit);
    ImuSample {
        time_ns: u64_at(packet, 16),
        acceleration_m_s2: values(24, STANDARD_GRAVITY_M_S2),
        angular_rate_rad_s: values(36, 1f64.to_radians()),
    }
}

/// Writes a LEGACY packet; all three time stamps are the sample's.
pub(crate) fn write_legacy(sample: &ImuSample) -> [u8; LEGACY_BYTES] {
    let mut packet = [0; LEGACY_BYTES];
    for stamp in packet[..24].chunks_exact_mut(8) {
        stamp.copy_from_slice(&sample.time_ns.to_le_bytes());
    }
    for axis in 0..3 {
        let acceleration_g = (sample.acceleration_m_s2[axis] / STANDARD_GRAVITY_M_S2) as f32;
        let rate_deg_s = sample.angular_rate_rad_s[axis].to_degrees() as f32;
        packet[24 + 4 * axis..][..4].copy_from_slice(&acceleration_g.to_le_bytes());
        packet[36 + 4 * axis..][..4].copy_from_slice(&rate_deg_s.to_le_bytes());
    }
    packet
}

/// Reads the valid samples of an ACCEL32_GYRO32_NMEA packet.
pub(crate) fn read_accel32(packet: &[u8]) -> impl Iterator<Item = ImuSample> + '_ {
    let samples = packet.get(HEADER_BYTES + NMEA_BLOCK_BYTES..packet.len().saturating_sub(FOOTER_BYTES));
    samples.unwrap_or_default().chunks_exact(SAMPLE_BYTES).filter(|sample| sample[10] & 1 == 1).map(
        |sample| {
            let values = |at: usize| [0, 4, 8].map(|axis| f64::from(f32_at(sample, at + axis)));
            ImuSample {
                time_ns: u64_at(sample, 0),
                acceleration_m_s2: values(12),
                angular_rate_rad_s: values(24),
            }
        },
    )
}

/// The GPS sentence of an ACCEL32_GYRO32_NMEA packet and when it came, ns; `None` when there is none.
pub(crate) fn read_nmea(packet: &[u8]) -> Option<(u64, &str)> {
    let text = packet.get(NMEA_TEXT)?;
    let length = text.iter().position(|byte| *byte == 0).unwrap_or(text.len());
    let text = std::str::from_utf8(&text[..length]).ok()?.trim_end();
    (!text.is_empty()).then(|| (u64_at(packet, HEADER_BYTES), text))
}

/// Writes samples and a GPS sentence into an ACCEL32_GYRO32_NMEA packet between header and footer. `columns` are the
/// encoder positions of the samples.
pub(super) fn write_accel32(
    packet: &mut [u8],
    samples: &[ImuSample],
    columns: &[u16],
    nmea: Option<(u64, &str)>,
) {
    if let Some((time_ns, text)) = nmea {
        packet[HEADER_BYTES..HEADER_BYTES + 8].copy_from_slice(&time_ns.to_le_bytes());
        for (byte, letter) in packet[NMEA_TEXT].iter_mut().zip(text.bytes()) {
            *byte = letter;
        }
    }
    let blocks = packet[HEADER_BYTES + NMEA_BLOCK_BYTES..].chunks_exact_mut(SAMPLE_BYTES);
    for ((block, sample), column) in blocks.zip(samples).zip(columns) {
        block[..8].copy_from_slice(&sample.time_ns.to_le_bytes());
        block[8..10].copy_from_slice(&column.to_le_bytes());
        block[10..12].copy_from_slice(&1u16.to_le_bytes());
        let values = sample.acceleration_m_s2.iter().chain(&sample.angular_rate_rad_s);
        for (place, value) in block[12..].chunks_exact_mut(4).zip(values) {
            place.copy_from_slice(&(*value as f32).to_le_bytes());
        }
    }
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legacy_units_are_g_and_degrees() {
        let mut packet = [0; LEGACY_BYTES];
        packet[16] = 7;
        packet[32..36].copy_from_slice(&1f32.to_le_bytes());
        packet[36..40].copy_from_slice(&180f32.to_le_bytes());
        let sample = read_legacy(&packet);
        assert_eq!(sample.time_ns, 7);
        assert_eq!(sample.acceleration_m_s2, [0.0, 0.0, 9.806_65]);
        assert!((sample.angular_rate_rad_s[0] - std::f64::consts::PI).abs() < 1e-12);
        let again = write_legacy(&sample);
        assert_eq!(again[16..], packet[16..]);
    }
}
