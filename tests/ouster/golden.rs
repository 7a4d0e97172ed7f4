//! Decoded captures encode to the captured bytes.

use sensors::ouster::wire::NO_CRC;
use sensors::ouster::{Checksum, Metadata, OusterEncoder, Profile};

use super::{datagrams, decode, metadata};
use crate::support::shared;

const GOLDEN: [(&str, &str); 14] = [
    ("OS-0-128-U1_v2.3.0_1024x10", "OS-0-128-U1_v2.3.0_1024x10"),
    ("OS-0-32-U1_v2.2.0_1024x10", "OS-0-32-U1_v2.2.0_1024x10"),
    ("OS-1-128_767798045_1024x10_20230712_120049", "OS-1-128_767798045_1024x10_20230712_120049"),
    ("OS-1-128_v2.3.0_1024x10_lb_n3", "OS-1-128_v2.3.0_1024x10"),
    ("OS-1-64_1024x10_fw20", "OS-1-64_sensor_config_reduced"),
    ("OS-2-32-U0_v2.0.0_1024x10", "OS-2-32-U0_v2.0.0_1024x10"),
    ("crc_test", "crc_test"),
    ("duplicate_id", "duplicate_id"),
    ("ouster_example", "ouster_example"),
    ("windowed_frame1", "windowed_frame1_0"),
    ("synthetic/syn_RNG15_RFL8_WIN8", "synthetic/syn_RNG15_RFL8_WIN8"),
    ("synthetic/syn_RNG19_RFL8_SIG16_NIR16_ZONE16", "synthetic/syn_RNG19_RFL8_SIG16_NIR16_ZONE16"),
    ("synthetic/syn_RNG19_RFL8_SIG16_NIR16_RGB16_DUAL", "synthetic/syn_RNG19_RFL8_SIG16_NIR16_RGB16_DUAL"),
    ("synthetic/osf2pcap_osf_fw_3.2_10scans", "synthetic/osf2pcap_osf_fw_3.2_10scans_0"),
];

/// Bits of a LEGACY pixel that no field carries: 20 to 27 beside the range, and the upper half of reflectivity.
const LEGACY_UNCARRIED: [u8; 12] = [0, 0, 0xF0, 0x0F, 0, 0xFF, 0, 0, 0, 0, 0, 0];

pub fn encoding_gives_the_captured_bytes() {
    for (capture, description) in GOLDEN {
        let metadata = metadata(&format!("captures/ouster/{description}.json"));
        let bytes = metadata.packet_format().packet_bytes();
        let all = datagrams(&shared(&format!("captures/ouster/{capture}.pcap")));
        let captured: Vec<_> = all
            .iter()
            .filter(|datagram| datagram.payload.len() == bytes)
            .map(|datagram| &datagram.payload)
            .collect();
        let mut encoder = OusterEncoder::new(metadata.clone()).with_checksum(checksum_of(captured[0]));
        let mut encoded = Vec::new();
        for frame in decode(&metadata, &all).frames {
            encoder.frame(&frame, &mut |payload| encoded.push(payload.to_vec()));
        }
        assert_eq!(encoded.len(), captured.len(), "{capture}");
        for (index, (encoded, captured)) in encoded.iter().zip(captured).enumerate() {
            let mut captured = captured.clone();
            drop_uncarried_bits(&metadata, &mut captured);
            assert!(*encoded == captured, "{capture}: packet {index}: {:?}", difference(encoded, &captured));
        }
    }
}

pub fn imu_packets_are_in_si_units() {
    for (capture, description, samples) in [
        ("OS-1-128_v2.3.0_1024x10_lb_n3", "OS-1-128_v2.3.0_1024x10", 30),
        ("crc_test", "crc_test", 10),
        ("imu_zm_no_lidar", "imu_zm_no_lidar_0", 64),
    ] {
        let metadata = metadata(&format!("captures/ouster/{description}.json"));
        let decoding = decode(&metadata, &datagrams(&shared(&format!("captures/ouster/{capture}.pcap"))));
        assert_eq!(decoding.imu.len(), samples, "{capture}");
        for sample in &decoding.imu {
            let gravity_m_s2 = glam::DVec3::from(sample.acceleration_m_s2).length();
            assert!((8.0..12.0).contains(&gravity_m_s2), "{capture}: {sample:?}");
            let rate_rad_s = glam::DVec3::from(sample.angular_rate_rad_s).length();
            assert!(rate_rad_s < 1.0, "{capture}: {sample:?}");
        }
        assert!(decoding.imu.windows(2).all(|pair| pair[0].time_ns < pair[1].time_ns), "{capture}");
    }
}

pub fn imu_and_zone_packets_come_back_to_the_byte() {
    let metadata = metadata("captures/ouster/imu_zm_no_lidar_0.json");
    let all = datagrams(&shared("captures/ouster/imu_zm_no_lidar.pcap"));
    let decoding = decode(&metadata, &all);
    assert_eq!(decoding.stats.packets, 9);
    assert_eq!((decoding.frames.len(), decoding.zones.len()), (1, 1));
    assert_eq!(decoding.zones[0].frame_id, 30002);
    let mut encoder = OusterEncoder::new(metadata);
    encoder.health = decoding.frames[0].health;
    let zone = all.iter().find(|datagram| datagram.payload.len() == 680).unwrap();
    let encoded = encoder.zones(&decoding.zones[0]);
    assert_eq!(difference(encoded, &zone.payload), None);
    let packets = all.iter().filter(|datagram| datagram.payload.len() == 452);
    for (datagram, samples) in packets.zip(decoding.imu.chunks(8)) {
        let columns: Vec<u16> = datagram.payload[132..420]
            .chunks(36)
            .map(|sample| u16::from_le_bytes([sample[8], sample[9]]))
            .collect();
        let encoded = encoder.imu(30002, samples, &columns, None);
        assert_eq!(difference(encoded, &datagram.payload), None);
    }
}

fn checksum_of(packet: &[u8]) -> Checksum {
    match packet.last_chunk().map(|bytes| u64::from_le_bytes(*bytes)) {
        Some(0) => Checksum::Zero,
        Some(NO_CRC) => Checksum::Constant,
        _ => Checksum::Crc64,
    }
}

fn drop_uncarried_bits(metadata: &Metadata, packet: &mut [u8]) {
    if metadata.profile != Profile::Legacy {
        return;
    }
    let format = metadata.packet_format();
    for column in 0..format.columns_per_packet {
        let column = format.column_mut(packet, column);
        for pixel in format.blocks_mut(column).chunks_exact_mut(LEGACY_UNCARRIED.len()) {
            for (byte, uncarried) in pixel.iter_mut().zip(LEGACY_UNCARRIED) {
                *byte &= !uncarried;
            }
        }
    }
}

/// First byte that differs: where, ours, theirs.
fn difference(ours: &[u8], theirs: &[u8]) -> Option<(usize, u8, u8)> {
    assert_eq!(ours.len(), theirs.len());
    let at = ours.iter().zip(theirs).position(|(ours, theirs)| ours != theirs)?;
    Some((at, ours[at], theirs[at]))
}
