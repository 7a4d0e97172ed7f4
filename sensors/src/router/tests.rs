//! Packets of made-up sensors find their decoder.

use super::*;
use crate::ouster::{OusterEncoder, Profile, Synthetic};
use crate::velodyne::{Column, Product, ReturnMode, VelodyneEncoder};
use crate::{Frame, Layer};

fn packet<'a>(sender: u8, port: u16, payload: &'a [u8]) -> Packet<'a> {
    Packet {
        host_time_ns: 1_700_000_000_000_000_000,
        source: std::net::SocketAddr::from(([10, 0, 0, sender], 50_000)),
        destination: std::net::SocketAddr::from(([10, 0, 0, 9], port)),
        payload,
    }
}

fn metadata(model: &str, serial: u64, profile: Profile) -> Metadata {
    Metadata::synthetic(&Synthetic::new(model, serial, profile).columns(512, 16)).unwrap()
}

/// Lidar packets of one revolution.
fn ouster_packets(metadata: &Metadata) -> Vec<Vec<u8>> {
    ouster_revolution(metadata, 7)
}

fn ouster_revolution(metadata: &Metadata, frame_id: u32) -> Vec<Vec<u8>> {
    let start_ns = 5_000_000_000 + u64::from(frame_id) * 100_000_000;
    let (columns, channels) = (metadata.columns_per_frame, metadata.pixels_per_column);
    let frame = Frame {
        frame_id,
        channels,
        column_time_ns: (0..columns as u64).map(|column| start_ns + column * 190_000).collect(),
        column_azimuth_rad: vec![0.0; columns],
        column_valid: vec![true; columns],
        first: Layer {
            range_mm: vec![4000; columns * channels],
            reflectivity: vec![5; columns * channels],
            ..Layer::default()
        },
        ..Frame::default()
    };
    let mut packets = Vec::new();
    OusterEncoder::new(metadata.clone()).frame(&frame, &mut |packet| packets.push(packet.to_vec()));
    packets
}

fn velodyne_packets(product: Product, columns: u64) -> Vec<Vec<u8>> {
    let mut encoder = VelodyneEncoder::new(product, ReturnMode::Strongest);
    let (ranges, levels) = (vec![500; product.lasers()], vec![9; product.lasers()]);
    let mut packets = Vec::new();
    for column in 0..columns {
        let column = Column {
            time_ns: 1_000_000_000 + column * product.cycle_ns() as u64,
            azimuth_rad: column as f64 * 0.003,
            range_mm: &ranges,
            reflectivity: &levels,
            second: None,
        };
        encoder.push_column(column, &mut |_, packet| packets.push(packet.to_vec()));
    }
    packets
}

fn ignore(_: usize, _: &Sensor, _: Decoded<'_>) {}

#[test]
fn velodynes_are_found_by_sender_and_port() {
    let mut router = Router::new();
    let payloads = velodyne_packets(Product::Vlp16, 1000);
    for payload in &payloads {
        for (sender, port) in [(1, 2368), (2, 2368), (2, 2369)] {
            router.push(&packet(sender, port, payload), &mut ignore);
        }
    }
    router.finish(&mut ignore);
    let packets: Vec<u64> = router.sensors().iter().map(|sensor| sensor.stats().packets).collect();
    assert_eq!(packets, [payloads.len() as u64; 3]);
    assert!(router.sensors().iter().all(|sensor| sensor.product() == "vlp-16"));
    assert_eq!(router.unclaimed().count(), 0);
}

#[test]
fn sensors_of_one_format_are_told_apart_by_serial_number() {
    let mut router = Router::new();
    let ours: Vec<Metadata> =
        [11, 22].map(|serial| metadata("os1-64", serial, Profile::Rng15Rfl8Nir8)).into();
    for (at, metadata) in ours.iter().enumerate() {
        router.add_ouster(metadata.clone(), format!("{at}.json"));
    }
    let stranger = metadata("os1-64", 33, Profile::Rng15Rfl8Nir8);
    let reconfigured = metadata("os1-64", 22, Profile::Rng15Rfl8Nir8Dual);
    // all from one address, as a recording sent again
    for (at, sender) in ours.iter().chain([&stranger, &reconfigured]).enumerate() {
        for payload in ouster_packets(sender) {
            let routed = router.push(&packet(1, 7502, &payload), &mut ignore);
            match at {
                0 | 1 => assert_eq!(routed, Routed::Taken(at)),
                _ => assert_ne!(routed, Routed::Taken(at), "{at}"),
            }
        }
    }
    let reasons: Vec<&str> = router.unclaimed().map(|entry| entry.reason.as_str()).collect();
    assert!(reasons.iter().any(|reason| reason.contains("sensor 33") && reason.contains("add that of 33")));
    assert!(router.sensors().iter().all(|sensor| sensor.stats().packets == 32));
}

#[test]
fn packets_without_a_serial_number_go_by_their_sender() {
    let mut router = Router::new();
    let ours =
        [("os1-64", 11), ("os0-128", 22)].map(|(model, serial)| metadata(model, serial, Profile::Legacy));
    for metadata in &ours {
        router.add_ouster(metadata.clone(), "one");
    }
    let imu = [1_u64, 1, 1].map(u64::to_le_bytes).as_flattened().to_vec();
    let imu: Vec<u8> = imu.into_iter().chain([0; 24]).collect();
    let lidar = ours.each_ref().map(ouster_packets);
    // the senders are learned from lidar packets, whose lengths differ
    assert!(!router.learn(&packet(1, 7503, &imu)));
    assert!(!router.learn(&packet(1, 7502, &lidar[0][0])));
    assert!(router.learn(&packet(2, 7502, &lidar[1][0])));
    assert_eq!(router.push(&packet(2, 7503, &imu), &mut ignore), Routed::Taken(1));
    assert_eq!(router.push(&packet(1, 7503, &imu), &mut ignore), Routed::Taken(0));
    assert_eq!(router.push(&packet(3, 7503, &imu), &mut ignore), Routed::Unclaimed);
}

#[test]
fn damage_is_counted_by_the_sensor_it_comes_from() {
    let mut router = Router::new();
    let metadata = metadata("os1-64", 11, Profile::Rng15Rfl8Nir8);
    router.add_ouster(metadata.clone(), "one");
    let mut payloads = ouster_packets(&metadata);
    let last = payloads.last_mut().unwrap();
    last[500] ^= 1;
    for payload in &payloads {
        router.push(&packet(1, 7502, payload), &mut ignore);
    }
    assert_eq!(router.sensors()[0].stats().crc_errors, 1);
    assert_eq!(router.unclaimed().count(), 0);
}

#[test]
fn frames_are_lent_not_copied() {
    let metadata = metadata("os1-16", 5, Profile::Legacy);
    let mut router = Router::new();
    router.add_ouster(metadata.clone(), "sensor.json");
    let (mut ouster, mut velodyne) = (Vec::new(), Vec::new());
    let mut note = |_: usize, sensor: &Sensor, decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            let seen = if sensor.vendor() == "Ouster" { &mut ouster } else { &mut velodyne };
            seen.push((frame.frame_id, frame.first.range_mm.as_ptr(), frame.column_time_ns.as_ptr()));
        }
    };
    for frame_id in 0..5 {
        for payload in ouster_revolution(&metadata, frame_id) {
            router.push(&packet(1, 7502, &payload), &mut note);
        }
    }
    let packets: Vec<_> = velodyne_packets(Product::Vlp16, 12_000);
    for payload in &packets {
        router.push(&packet(2, 2368, payload), &mut note);
    }
    router.finish(&mut note);
    assert_eq!(ouster.iter().map(|(frame_id, ..)| *frame_id).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    assert!(ouster.iter().all(|(_, ranges, times)| (*ranges, *times) == (ouster[0].1, ouster[0].2)));
    // frames of a Velodyne grow to the revolution's size, and so do their buffers, until they fit
    assert!(velodyne.len() > 4, "{velodyne:?}");
    let settled = &velodyne[2..];
    assert!(settled.iter().all(|(_, ranges, times)| (*ranges, *times) == (settled[0].1, settled[0].2)));
}
