//! Packets of made-up sensors find their decoder.

use super::*;
use crate::made_up::{ouster_revolution, velodyne_columns};
use crate::ouster::{Profile, Synthetic};
use crate::velodyne::Product;

fn packet<'a>(sender: u8, port: u16, payload: &'a [u8]) -> Packet<'a> {
    Packet {
        host_time_ns: 1_700_000_000_000_000_000,
        source: std::net::SocketAddr::from(([10, 0, 0, sender], 50_000)),
        destination: std::net::SocketAddr::from(([10, 0, 0, 9], port)),
        link: Default::default(),
        payload,
    }
}

fn metadata(model: &str, serial: u64, profile: Profile) -> Metadata {
    Metadata::synthetic(&Synthetic::new(model, serial, profile).columns(512, 16)).unwrap()
}

/// Lidar packets of one revolution.
fn ouster_packets(metadata: &Metadata) -> Vec<Vec<u8>> {
    ouster_revolution(metadata, 7, 5_000_000_000)
}

fn ignore(_: usize, _: &Sensor, _: Decoded<'_>) {}

#[test]
fn velodynes_are_found_by_sender_and_port() {
    let mut router = Router::new();
    let payloads = velodyne_columns(Product::Vlp16, 1000);
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
fn sensors_of_one_format_are_separated_by_serial_number() {
    let mut router = Router::new();
    let ours: Vec<Metadata> =
        [11, 22].map(|serial| metadata("os1-64", serial, Profile::Rng15Rfl8Nir8)).into();
    for (at, metadata) in ours.iter().enumerate() {
        router.add_ouster(metadata.clone(), format!("{at}.json"));
    }
    let unknown_source = metadata("os1-64", 33, Profile::Rng15Rfl8Nir8);
    let reconfigured = metadata("os1-64", 22, Profile::Rng15Rfl8Nir8Dual);
    // all from one address, as a recording sent again
    for (at, sender) in ours.iter().chain([&unknown_source, &reconfigured]).enumerate() {
        for payload in ouster_packets(sender) {
            let routed = router.push(&packet(1, 7502, &payload), &mut ignore);
            match at {
                0 | 1 => assert_eq!(routed, Routed::Assigned(at)),
                _ => assert_ne!(routed, Routed::Assigned(at), "{at}"),
            }
        }
    }
    let reasons: Vec<&str> = router.unclaimed().map(|entry| entry.reason.as_str()).collect();
    assert!(reasons.iter().any(|reason| reason.contains("sensor 33") && reason.contains("add that of 33")));
    assert!(router.sensors().iter().all(|sensor| sensor.stats().packets == 32));
}

#[test]
fn a_sensor_without_lidar_packets_leaves_those_of_others_alone() {
    let mut router = Router::new();
    router.add_ouster(metadata("os1-64", 11, Profile::Off), "off.json");
    let other = metadata("os1-64", 22, Profile::Rng15Rfl8Nir8);
    for payload in ouster_packets(&other) {
        assert_eq!(router.push(&packet(1, 7502, &payload), &mut ignore), Routed::Unclaimed);
    }
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
    assert_eq!(router.push(&packet(2, 7503, &imu), &mut ignore), Routed::Assigned(1));
    assert_eq!(router.push(&packet(1, 7503, &imu), &mut ignore), Routed::Assigned(0));
    assert_eq!(router.push(&packet(3, 7503, &imu), &mut ignore), Routed::Unclaimed);
}

/// Two units of one model, whose packets do not say of which they are: by sender, by port, and by neither.
#[test]
fn units_without_a_serial_number_are_assigned_by_source() {
    let ours = [11, 22].map(|serial| metadata("os1-64", serial, Profile::Legacy));
    let payloads = ouster_packets(&ours[0]);
    let routed = |ties: [Option<SourceFilter>; 2], sender: [u8; 4], port: u16| {
        let mut router = Router::new();
        for (metadata, source_filter) in ours.iter().zip(ties) {
            router.add_ouster_from(metadata.clone(), "one", source_filter);
        }
        let of = |sender: [u8; 4], port, payload| Packet {
            source: (sender, 50_000).into(),
            ..packet(1, port, payload)
        };
        // the first of them has sent already, from the same socket where both are of this host
        router.push(&of([127, 0, 0, 1], 7502, &payloads[0]), &mut ignore);
        router.push(&of(sender, port, &payloads[1]), &mut ignore)
    };
    let ports = [Some(SourceFilter::Port(7502)), Some(SourceFilter::Port(7504))];
    assert_eq!(routed(ports, [127, 0, 0, 1], 7502), Routed::Assigned(0));
    assert_eq!(routed(ports, [127, 0, 0, 1], 7504), Routed::Assigned(1));
    assert_eq!(routed(ports, [127, 0, 0, 1], 7506), Routed::Unclaimed);
    let senders = ["127.0.0.1", "127.0.0.2"].map(|text| SourceFilter::from_text(text).unwrap().ok());
    assert_eq!(routed(senders, [127, 0, 0, 2], 7502), Routed::Assigned(1));
    assert_eq!(routed(senders, [127, 0, 0, 3], 7502), Routed::Unclaimed);
    let both = ["127.0.0.1:7502", "127.0.0.1:7504"].map(|text| SourceFilter::from_text(text).unwrap().ok());
    assert_eq!(routed(both, [127, 0, 0, 1], 7504), Routed::Assigned(1));
    assert_eq!(routed(both, [127, 0, 0, 2], 7504), Routed::Unclaimed);
    assert_eq!(routed([None, None], [127, 0, 0, 1], 7502), Routed::Unclaimed);
}

const IMU: [u8; 48] = [1; 48];

/// Metadata of an OS1-64 of the LEGACY profile whose inertial packets go to a port.
fn sends_imu_to(serial: u64, port: u16) -> Metadata {
    Metadata { imu_port: Some(port), ..metadata("os1-64", serial, Profile::Rng15Rfl8Nir8) }
}

#[test]
fn inertial_packets_of_one_sender_go_by_their_port() {
    let ours = [sends_imu_to(11, 7503), sends_imu_to(22, 7505)];
    let mut router = Router::new();
    for metadata in &ours {
        router.add_ouster(metadata.clone(), "one");
    }
    for (metadata, port) in ours.iter().zip([7502, 7504]) {
        router.learn(&packet(1, port, &ouster_packets(metadata)[0]));
    }
    router.end_learning();
    let mut routed = |port| router.push(&packet(1, port, &IMU), &mut ignore);
    assert_eq!([7503, 7505].map(&mut routed), [Routed::Assigned(0), Routed::Assigned(1)]);
    assert_eq!(routed(7507), Routed::Unclaimed);
}

/// One unit sends from one address to one port.
#[test]
fn inertial_packets_of_two_senders_are_not_merged() {
    let routed = |streams: &[(u8, u16)], has_looked: bool| -> (Vec<Routed>, String) {
        let mut router = Router::new();
        router.add_ouster(sends_imu_to(11, 7503), "one.json");
        let streams: Vec<Packet<'_>> =
            streams.iter().map(|(sender, port)| packet(*sender, *port, &IMU)).collect();
        if has_looked {
            for packet in &streams {
                router.learn(packet);
            }
            router.end_learning();
        }
        let routed = streams.iter().map(|packet| router.push(packet, &mut ignore)).collect();
        (routed, router.unclaimed().map(|entry| entry.reason.clone()).collect())
    };
    let (unclaimed, ours) = (Routed::Unclaimed, Routed::Assigned(0));
    let (accepted, reason) = routed(&[(1, 7503), (2, 7503)], true);
    assert_eq!(accepted, [unclaimed; 2]);
    assert!(reason.contains("of 2 sensors") && reason.contains("--meta ADDRESS=one.json"), "{reason}");
    assert_eq!(routed(&[(1, 7505), (2, 7503)], true).0, [unclaimed, ours], "the metadata know the port");
    assert_eq!(routed(&[(1, 7503), (2, 7503)], false).0, [ours, unclaimed], "the first counts");
}

/// Packets of two units fit the metadata of one of them: neither is assigned to it.
#[test]
fn of_two_units_without_a_serial_number_none_is_picked() {
    let metadata = metadata("os1-64", 11, Profile::Legacy);
    let lidar = ouster_packets(&metadata);
    for streams in [[(1, 7502), (2, 7502)], [(1, 7502), (1, 7504)]] {
        let routed = |source_filter: Option<SourceFilter>| {
            let mut router = Router::new();
            router.add_ouster_from(metadata.clone(), "one.json", source_filter);
            let streams = streams.map(|(sender, port)| packet(sender, port, &lidar[0]));
            for packet in &streams {
                router.learn(packet);
            }
            router.end_learning();
            let routed = streams.each_ref().map(|packet| router.push(packet, &mut ignore));
            assert_eq!(
                router.push(&packet(1, 7503, &IMU), &mut ignore) == Routed::Unclaimed,
                source_filter.is_none()
            );
            (routed, router.unclaimed().map(|entry| entry.reason.clone()).collect::<String>())
        };
        let (accepted, reason) = routed(None);
        assert_eq!(accepted, [Routed::Unclaimed; 2], "{streams:?}");
        assert!(reason.contains("several sensors") && reason.contains("--meta :PORT=one.json"), "{reason}");
        let source_filter = if streams[0].0 == streams[1].0 {
            SourceFilter::Port(7502)
        } else {
            SourceFilter::Sender([10, 0, 0, 1].into())
        };
        assert_eq!(routed(Some(source_filter)).0, [Routed::Assigned(0), Routed::Unclaimed], "{streams:?}");
    }
}

#[test]
fn position_packets_of_several_units_behind_one_address_go_by_who_recorded_them() {
    let position = crate::velodyne::Position::default().encode();
    let routed = |names: Vec<Named>, sender: u8| {
        let mut router = Router::new();
        router.set_names(names);
        let data = velodyne_columns(Product::Vlp16, 200);
        let data: Vec<Packet<'_>> =
            [(1, 2368), (1, 2369), (2, 2368)].map(|(sender, port)| packet(sender, port, &data[0])).into();
        for packet in &data {
            router.learn(packet);
        }
        router.end_learning();
        // a position packet may be the first to come
        let routed = router.push(&packet(sender, 8310, &position), &mut ignore);
        for packet in &data {
            router.push(packet, &mut ignore);
        }
        let reason = router.unclaimed().map(|entry| entry.reason.clone()).collect::<String>();
        (routed, router.sensors()[0].data_port(), reason)
    };
    let named = |name: &str, port, auxiliary_port| Named {
        name: name.into(),
        metadata: None,
        source: None,
        port: Some(port),
        auxiliary_port,
    };
    let names = vec![named("left", 2368, None), named("right", 2369, Some(8310))];
    let (accepted, port, ..) = routed(names, 1);
    assert_eq!((accepted, port), (Routed::Assigned(0), Some(2369)));
    let (accepted, _, reason) = routed(Vec::new(), 1);
    assert_eq!(accepted, Routed::Unclaimed);
    assert!(reason.contains("10.0.0.1 to port 2368, 10.0.0.1 to port 2369"), "{reason}");
    assert_eq!(routed(Vec::new(), 2).0, Routed::Assigned(0), "the only one of its address");
}

/// Where metadata of a unit are given that is not there, inertial packets go to the one that is.
#[test]
fn inertial_packets_go_to_who_is_met() {
    let mut router = Router::new();
    for (model, serial) in [("os0-128", 22), ("os1-64", 11)] {
        router.add_ouster(metadata(model, serial, Profile::Legacy), model);
    }
    let lidar = ouster_packets(&metadata("os1-64", 11, Profile::Legacy));
    let local = |port, payload| Packet { source: ([127, 0, 0, 1], 9).into(), ..packet(1, port, payload) };
    let imu = [1; 48];
    router.learn(&local(7502, &lidar[0]));
    assert_eq!(router.push(&local(7503, &imu), &mut ignore), Routed::Unclaimed, "the other may come yet");
    router.end_learning();
    assert_eq!(router.push(&local(7503, &imu), &mut ignore), Routed::Assigned(1));

    let mut router = Router::new();
    router.add_ouster(metadata("os0-128", 22, Profile::Legacy), "of another unit");
    router.learn(&local(7502, &lidar[0]));
    router.end_learning();
    assert_eq!(router.push(&local(7503, &imu), &mut ignore), Routed::Unclaimed);
    let elsewhere = packet(1, 7503, &imu);
    assert_eq!(
        router.push(&elsewhere, &mut ignore),
        Routed::Assigned(0),
        "no unknown source sends from there"
    );
}

#[test]
fn sensors_are_called_as_somebody_says() {
    let mut router = Router::new();
    let named = |name: &str, metadata: Option<&str>, port| Named {
        name: name.into(),
        metadata: metadata.map(str::to_owned),
        source: None,
        port: Some(port),
        auxiliary_port: None,
    };
    router.set_names(vec![
        named("front", Some("a.json"), 7502),
        named("left", None, 2368),
        named("right", None, 2369),
    ]);
    router.add_ouster(metadata("os1-64", 11, Profile::Legacy), "a.json");
    for payload in velodyne_columns(Product::Vlp16, 200) {
        for port in [2369, 2368, 2370] {
            router.push(&packet(1, port, &payload), &mut ignore);
        }
    }
    let names: Vec<Option<&str>> = router.sensors().iter().map(|sensor| sensor.name.as_deref()).collect();
    assert_eq!(names, [Some("front"), Some("right"), Some("left"), None]);
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
        let start_ns = 5_000_000_000 + u64::from(frame_id) * 100_000_000;
        for payload in ouster_revolution(&metadata, frame_id, start_ns) {
            router.push(&packet(1, 7502, &payload), &mut note);
        }
    }
    let packets: Vec<_> = velodyne_columns(Product::Vlp16, 12_000);
    for payload in &packets {
        router.push(&packet(2, 2368, payload), &mut note);
    }
    router.finish(&mut note);
    assert_eq!(ouster.iter().map(|(frame_id, ..)| *frame_id).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    // the first waits for the next to begin: two go round
    let buffers: std::collections::BTreeSet<_> =
        ouster.iter().map(|(_, ranges, times)| (*ranges, *times)).collect();
    assert!(buffers.len() <= 2, "{buffers:?}");
    // frames of a Velodyne grow to the revolution's size, and so do their buffers, until they fit
    assert!(velodyne.len() > 4, "{velodyne:?}");
    let settled = &velodyne[2..];
    assert!(settled.iter().all(|(_, ranges, times)| (*ranges, *times) == (settled[0].1, settled[0].2)));
}

/// What each of two sources sends, one turn of a sensor after the other.
fn from_two(turns: &[(u16, u64)]) -> (Router, usize) {
    let one = metadata("os1-64", 11, Profile::Rng15Rfl8Nir8);
    let mut router = Router::new();
    router.add_ouster(one.clone(), "one.json");
    let mut per_turn = 0;
    for (turn, (port, begun_ns)) in turns.iter().enumerate() {
        let payloads = ouster_revolution(&one, turn as u32, begun_ns % 1_000_000_000_000);
        per_turn = payloads.len();
        for (at, payload) in (0..).zip(&payloads) {
            let source = std::net::SocketAddr::from(([10, 0, 0, 1], *port));
            let host_time_ns = begun_ns + at * 3_000_000;
            router.push(&Packet { source, host_time_ns, ..packet(1, 7502, payload) }, &mut ignore);
        }
    }
    router.finish(&mut ignore);
    (router, per_turn)
}

#[test]
fn two_units_of_one_serial_number_are_named_and_not_merged() {
    let one = metadata("os1-64", 11, Profile::Rng15Rfl8Nir8);
    let mut router = Router::new();
    router.add_ouster(one.clone(), "one.json");
    for turn in 0..4 {
        let payloads = [0, 4000].map(|ahead| {
            ouster_revolution(&one, turn + ahead, 5_000_000_000 + u64::from(turn) * 100_000_000)
        });
        for (first, second) in payloads[0].iter().zip(&payloads[1]) {
            router.push(&packet(1, 7502, first), &mut ignore);
            router.push(&packet(2, 7502, second), &mut ignore);
        }
    }
    router.finish(&mut ignore);
    let [sensor] = router.sensors() else { panic!("one sensor") };
    let (stats, rival) = (sensor.stats(), sensor.rival().unwrap());
    assert_eq!((stats.packets, stats.lost_packets, stats.complete_frames), (128, 0, 4), "{stats:?}");
    assert_eq!((rival.packets, router.unclaimed().map(|entry| entry.packets).sum()), (128, 128));
    let words = sensor.two_sources().unwrap();
    assert!(words.starts_with("two sources with serial 11: 10.0.0.1:50000 and 10.0.0.2:50000"), "{words}");
}

#[test]
fn a_unit_that_comes_back_from_another_port_is_the_same() {
    let ms = 1_000_000;
    let begun_ns = 1_700_000_000_000 * ms;
    let turns: Vec<(u16, u64)> = [(50_000, 0), (50_000, 100), (50_001, 1_900)]
        .map(|(port, at_ms)| (port, begun_ns + at_ms * ms))
        .into();
    let (router, per_turn) = from_two(&turns);
    assert_eq!(router.sensors()[0].stats().packets, 3 * per_turn as u64);
    assert_eq!(router.sensors()[0].rival(), None);
    // a burst of another is not its return
    let burst = |turn: u16| (50_000 + turn.min(1), begun_ns + u64::from(turn) * 40 * ms);
    let (router, per_turn) = from_two(&(0..12).map(burst).collect::<Vec<_>>());
    assert_eq!(router.sensors()[0].stats().packets, per_turn as u64);
    assert_eq!(router.sensors()[0].rival().unwrap().packets, 11 * per_turn as u64);
}
