//! Round trips over random frames, every profile.

use std::net::SocketAddr;

use proptest::prelude::*;
use proptest::test_runner::TestRng;

use super::profile::{Bits, ReturnLayout};
use super::*;
use crate::{Decoded, Decoder, Frame, Health, Layer, Packet};

const MODELS: [&str; 4] = ["os1-16", "os1-32", "os0-64", "os2-128"];

fn packet(payload: &[u8]) -> Packet<'_> {
    let source = SocketAddr::from(([192, 0, 2, 7], 7502));
    let destination = SocketAddr::from(([192, 0, 2, 1], 7502));
    Packet { host_time_ns: 5, source, destination, link: Default::default(), payload }
}

fn decode(metadata: &Metadata, payloads: &[Vec<u8>]) -> (Vec<Frame>, crate::DecodeStats) {
    let mut decoder = OusterDecoder::new(metadata.clone());
    let mut frames = Vec::new();
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push(frame.clone());
        }
    };
    for payload in payloads {
        decoder.push(&packet(payload), &mut take).unwrap();
    }
    decoder.finish(&mut take);
    let stats = decoder.stats().clone();
    (frames, stats)
}

/// A frame whose every field is random within what the profile can say.
fn random_frame(metadata: &Metadata, frame_id: u32, start_ns: u64, rng: &mut TestRng) -> Frame {
    let layout = metadata.profile.layout();
    let columns = metadata.columns_per_frame;
    let samples = columns * metadata.pixels_per_column;
    let expected = metadata.packets_per_frame() as u32;
    let mut frame = assembly::blank_frame(metadata);
    let step_ns = 1e9 / metadata.frame_rate_hz / columns as f64;
    frame.frame_id = frame_id;
    frame.column_time_ns = (0..columns).map(|column| start_ns + (column as f64 * step_ns) as u64).collect();
    frame.column_valid = (0..columns).map(|column| metadata.in_window(column)).collect();
    for column in 0..columns {
        if !metadata.expects_slot(column / metadata.columns_per_packet) {
            frame.column_time_ns[column] = 0;
        }
    }
    frame.host_time_ns = [5; 2];
    frame.complete = true;
    frame.packets = expected;
    if metadata.profile.has_packet_header() {
        frame.health = Health {
            alert_flags: rng.next_u32() as u8,
            thermal_countdown_s: rng.next_u32() as u8,
            shot_limiting_countdown_s: rng.next_u32() as u8,
            thermal_shutdown: rng.next_u32() as u8 & 15,
            shot_limiting: rng.next_u32() as u8 & 15,
        };
    }
    let valid: Vec<bool> = (0..samples).map(|at| frame.column_valid[at / frame.channels]).collect();
    fill(&mut frame.first, &layout.first, &valid, rng);
    if let Some(second) = &mut frame.second {
        fill(second, &layout.second, &valid, rng);
    }
    if layout.raw_words {
        match_raw_words(&mut frame, &valid, rng);
    }
    frame
}

fn fill(layer: &mut Layer, layout: &ReturnLayout, valid: &[bool], rng: &mut TestRng) {
    let mut draw = |field: Bits, valid: bool| {
        if valid { (rng.next_u32() & field.mask()) * u32::from(field.scale) } else { 0 }
    };
    for (at, valid) in valid.iter().enumerate() {
        let mut small = |field: Bits, array: &mut Vec<u8>| {
            if field.is_there() {
                array[at] = draw(field, *valid) as u8;
            }
        };
        small(layout.reflectivity, &mut layer.reflectivity);
        small(layout.flags, &mut layer.flags);
        small(layout.window, &mut layer.window);
        let mut wide = |field: Bits, array: &mut Vec<u16>| {
            if field.is_there() {
                array[at] = draw(field, *valid) as u16;
            }
        };
        wide(layout.signal, &mut layer.signal);
        wide(layout.near_ir, &mut layer.near_ir);
        wide(layout.zone_mask, &mut layer.zone_mask);
        if layout.rgb[0].is_there() {
            layer.rgb[at] = layout.rgb.map(|field| draw(field, *valid) as u16);
        }
        layer.range_mm[at] = draw(layout.range, *valid);
    }
}

/// In the raw profile the words say everything, the other fields repeat parts of them.
fn match_raw_words(frame: &mut Frame, valid: &[bool], rng: &mut TestRng) {
    let second = frame.second.as_mut().unwrap();
    for (at, valid) in valid.iter().enumerate() {
        let w: [u32; 5] = std::array::from_fn(|_| if *valid { rng.next_u32() } else { 0 });
        frame.first.raw_words[at] = w;
        for (layer, word) in [(&mut frame.first, w[0]), (&mut *second, w[1])] {
            layer.range_mm[at] = word & 0x7FFFF;
            layer.flags[at] = (word >> 19 & 31) as u8;
            layer.reflectivity[at] = (word >> 24) as u8;
        }
        frame.first.signal[at] = w[2] as u16;
        second.signal[at] = (w[2] >> 16) as u16;
        frame.first.near_ir[at] = w[3] as u16;
    }
}

fn sensors() -> impl Strategy<Value = Metadata> {
    let profiles: Vec<_> = Profile::all().filter(|profile| *profile != Profile::Off).collect();
    let sizes = [(512, 16), (1024, 16), (512, 8), (4096, 16), (2048, 32), (512, 1)];
    (
        prop::sample::select(profiles),
        prop::sample::select(MODELS.to_vec()),
        prop::sample::select(sizes.to_vec()),
        prop::bool::ANY,
        prop::option::of((0.0..1.0, 0.0..1.0)),
    )
        .prop_filter_map(
            "packets of more than 65507 bytes",
            |(profile, model, (columns, per_packet), fusa, window)| {
                let mut wanted = Synthetic::new(model, 122_246_000_293, profile).columns(columns, per_packet);
                if fusa {
                    wanted.header = HeaderKind::Fusa;
                }
                if let Some((first, last)) = window {
                    let column = |share: f64| (share * columns as f64) as usize;
                    wanted.column_window = [column(first), column(last)];
                }
                Metadata::synthetic(&wanted).ok()
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_is_encoded_is_decoded(metadata in sensors(), seed in any::<[u8; 32]>(), first_id in any::<u16>(), start_ns in 1..u64::MAX / 2) {
        let mut rng = TestRng::from_seed(proptest::test_runner::RngAlgorithm::ChaCha, &seed);
        let next_id = (u64::from(first_id) + 1) % metadata.header.frame_ids();
        let ids = [u32::from(first_id), next_id as u32];
        let starts_ns = [start_ns, start_ns + 100_000_000];
        let sent: Vec<_> = ids.iter().zip(starts_ns).map(|(id, start_ns)| random_frame(&metadata, *id, start_ns, &mut rng)).collect();
        let mut encoder = OusterEncoder::new(metadata.clone());
        let mut payloads = Vec::new();
        for frame in &sent {
            encoder.frame(frame, &mut |payload| payloads.push(payload.to_vec()));
        }
        let (frames, stats) = decode(&metadata, &payloads);
        prop_assert_eq!(stats.packets as usize, payloads.len());
        prop_assert_eq!(stats.lost_packets + stats.reordered + stats.late + stats.duplicated, 0, "{:?}", stats);
        prop_assert_eq!(stats.complete_frames, 2);
        prop_assert!(frames == sent, "{} frames, {:?} {:?}", frames.len(), metadata.profile, metadata.column_window);
    }

    #[test]
    fn bytes_of_any_kind_do_no_harm(metadata in sensors(), noise in prop::collection::vec(any::<u8>(), 0..200), at in any::<prop::sample::Index>()) {
        let mut encoder = OusterEncoder::new(metadata.clone());
        let mut rng = TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
        let mut payloads = Vec::new();
        encoder.frame(&random_frame(&metadata, 1, 1, &mut rng), &mut |payload| payloads.push(payload.to_vec()));
        let mut decoder = OusterDecoder::new(metadata);
        let mut pushed = 1;
        for (index, mut payload) in payloads.into_iter().enumerate().take(40) {
            if index % 2 == 1 {
                let start = at.index(payload.len());
                for (byte, noise) in payload[start..].iter_mut().zip(&noise) {
                    *byte = *noise;
                }
            }
            let _ = decoder.push(&packet(&payload), &mut |_| {});
            pushed += 1;
        }
        let _ = decoder.push(&packet(&noise), &mut |_| {});
        decoder.finish(&mut |_| {});
        let stats = decoder.stats();
        prop_assert_eq!(stats.packets + stats.malformed + stats.crc_errors + stats.foreign, pushed, "{:?}", stats);
    }
}

#[test]
fn imu_and_zone_packets_come_back() {
    let mut wanted = Synthetic::new("os0-128", 99, Profile::Off);
    wanted.imu_profile = ImuProfile::Accel32Gyro32Nmea;
    let metadata = Metadata::synthetic(&wanted).unwrap();
    let mut encoder = OusterEncoder::new(metadata.clone());
    let samples: Vec<ImuSample> = (0..8)
        .map(|index| ImuSample {
            time_ns: 1000 + index,
            acceleration_m_s2: [0.5, -0.25, 9.75],
            angular_rate_rad_s: [index as f64, 0.0, -1.0],
        })
        .collect();
    let columns: Vec<u16> = (0..8).collect();
    let imu = encoder.imu(7, &samples, &columns, Some((55, "$GPRMC,1*00"))).to_vec();
    assert_eq!(imu.len(), 452);
    let mut report = ZoneReport { frame_id: 7, time_ns: 12, zone_set_hash: [3; 32], ..ZoneReport::default() };
    report.zones[5] = ZoneState {
        live: true,
        id: 9,
        error_flags: 1,
        trigger_type: 2,
        triggered: true,
        triggered_frames: 4,
        count: 70_000,
        occluded_count: 2,
        invalid_count: 3,
        max_count: 80_000,
        min_range_mm: 1,
        max_range_mm: 524_287,
        mean_range_mm: 77,
    };
    let zones = encoder.zones(&report).to_vec();
    let mut decoder = OusterDecoder::new(metadata);
    let mut got = Vec::new();
    let mut reports = Vec::new();
    let mut frames = Vec::new();
    let mut take = |decoded: Decoded<'_>| match decoded {
        Decoded::Imu(sample) => got.push(sample.clone()),
        Decoded::Zones(report) => reports.push(report.clone()),
        Decoded::Frame(frame) => frames.push((frame.frame_id, frame.valid_columns(), frame.complete)),
        Decoded::Position(position) => panic!("{position:?}"),
    };
    decoder.push(&packet(&imu), &mut take).unwrap();
    decoder.push(&packet(&zones), &mut take).unwrap();
    decoder.finish(&mut take);
    assert_eq!(got, samples);
    assert_eq!(reports, [report]);
    assert_eq!(frames, [(7, 0, false)]);
    assert_eq!(decoder.nmea(), Some((55, "$GPRMC,1*00")));
}

#[test]
fn the_serial_number_settles_the_header() {
    let wanted = Synthetic::new("os1-16", 0x12_3456_7890, Profile::Rng15Rfl8Nir8);
    let specified = Metadata::synthetic(&wanted).unwrap();
    let spoken = Metadata::synthetic(&Synthetic { header: HeaderKind::Fusa, ..wanted }).unwrap();
    let mut rng = TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    let frame = random_frame(&spoken, 70_000, 1, &mut rng);
    let mut payloads = Vec::new();
    OusterEncoder::new(spoken).frame(&frame, &mut |payload| payloads.push(payload.to_vec()));
    assert_eq!(OusterDecoder::new(specified.clone()).claim(&packet(&payloads[0])), Claim::Certain);
    let (frames, _) = decode(&specified, &payloads);
    assert!(frames == [frame]);
}

#[test]
fn a_damaged_packet_is_still_claimed_by_its_serial_number() {
    let metadata = Metadata::synthetic(&Synthetic::new("os1-16", 77, Profile::Rng15Rfl8Nir8)).unwrap();
    let other = Metadata::synthetic(&Synthetic::new("os1-16", 78, Profile::Rng15Rfl8Nir8)).unwrap();
    let mut rng = TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    let mut payloads = Vec::new();
    let frame = random_frame(&metadata, 1, 1, &mut rng);
    OusterEncoder::new(metadata.clone()).frame(&frame, &mut |payload| payloads.push(payload.to_vec()));
    let mut decoder = OusterDecoder::new(metadata);
    let cut = packet(&payloads[0][..500]);
    assert_eq!((decoder.claim(&cut), OusterDecoder::new(other).claim(&cut)), (Claim::Named, Claim::No));
    let refused = decoder.push(&cut, &mut |_| {}).unwrap_err();
    assert!(matches!(refused, crate::Rejected::Malformed { .. }), "{refused}");
    payloads[1][100] ^= 1;
    assert_eq!(decoder.claim(&packet(&payloads[1])), Claim::Certain);
    let refused = decoder.push(&packet(&payloads[1]), &mut |_| {}).unwrap_err();
    assert!(matches!(refused, crate::Rejected::Checksum { .. }), "{refused}");
}

#[test]
fn missing_arrays_are_sent_as_zeros() {
    let mut rng = TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    for profile in Profile::all().filter(|profile| *profile != Profile::Off) {
        let metadata = Metadata::synthetic(&Synthetic::new("os1-16", 5, profile)).unwrap();
        let encode = |frame: &Frame| {
            let mut payloads = Vec::new();
            OusterEncoder::new(metadata.clone()).frame(frame, &mut |payload| payloads.push(payload.to_vec()));
            payloads
        };
        let full = random_frame(&metadata, 3, 1, &mut rng);
        let reduced = |reduce: &dyn Fn(&Layer) -> Layer| Frame {
            first: reduce(&full.first),
            second: full.second.as_ref().map(reduce),
            ..full.clone()
        };
        let ranges_only = reduced(&|layer| Layer { range_mm: layer.range_mm.clone(), ..Layer::default() });
        let ranges_and_zeros = reduced(&|layer| zeros(layer.range_mm.clone()));
        let payloads = encode(&ranges_only);
        assert!(payloads == encode(&ranges_and_zeros), "{profile:?}");
        let (decoded, _) = decode(&metadata, &payloads);
        let ranges = |frame: &Frame| {
            [Some(&frame.first), frame.second.as_ref()].map(|l| l.map(|l| l.range_mm.clone()))
        };
        assert!(ranges(&decoded[0]) == ranges(&full), "{profile:?}");
        let nothing = Frame { first: Layer::default(), second: None, ..full.clone() };
        let only_zeros = reduced(&|layer| zeros(vec![0; layer.range_mm.len()]));
        assert!(encode(&nothing) == encode(&only_zeros), "{profile:?}");
    }
}

/// A layer of zeros but for its ranges, without raw words.
fn zeros(range_mm: Vec<u32>) -> Layer {
    let samples = range_mm.len();
    Layer {
        range_mm,
        reflectivity: vec![0; samples],
        signal: vec![0; samples],
        near_ir: vec![0; samples],
        flags: vec![0; samples],
        window: vec![0; samples],
        zone_mask: vec![0; samples],
        rgb: vec![[0; 3]; samples],
        raw_words: Vec::new(),
    }
}

#[test]
fn a_window_through_column_0_begins_where_it_was_fired_first() {
    let wanted = Synthetic {
        column_window: [384, 127],
        ..Synthetic::new("os1-16", 5, Profile::Rng19Rfl8Sig16Nir16).columns(512, 16)
    };
    let metadata = Metadata::synthetic(&wanted).unwrap();
    let mut frame = assembly::blank_frame(&metadata);
    let in_window = || (384..512).chain(0..128);
    for (order, column) in in_window().enumerate() {
        frame.column_time_ns[column] = 1_000_000_000 + order as u64 * 195_000;
        frame.column_valid[column] = true;
    }
    let mut payloads = Vec::new();
    OusterEncoder::new(metadata.clone()).frame(&frame, &mut |packet| payloads.push(packet.to_vec()));
    let (frames, _) = decode(&metadata, &payloads);
    assert_eq!(frames.len(), 1);
    assert_eq!(frames[0].valid_columns(), in_window().count());
    assert_eq!(frames[0].time_span_ns(), Some([1_000_000_000, 1_000_000_000 + 255 * 195_000]));
}
