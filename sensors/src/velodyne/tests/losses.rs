//! Packets dropped, swapped, repeated, held up, cut off and damaged on the way: every one is counted, and a revolution
//! is neither doubled nor merged with its neighbour.

use super::*;

const PRODUCT: Product = Product::Vlp16;
/// 0.4 degree a block at 10 Hz: 75 packets are 360 degrees.
const PACKETS_PER_TURN: usize = 75;
const TURNS: usize = 8;

fn stream() -> Vec<(u64, Vec<u8>)> {
    let firings: Vec<_> = (0..TURNS * PACKETS_PER_TURN * 24)
        .map(|number| Firing {
            time_ns: 1_700_000_000_000_000_000 + number as u64 * 55_296,
            azimuth_counts: (20.0 * number as f64 + 1234.0).rem_euclid(36_000.0),
            first: (0..16)
                .map(|channel| (1000 + 2 * (number as u32 % 10_000) + 2 * channel, channel as u8))
                .collect(),
            second: None,
        })
        .collect();
    encode(PRODUCT, ReturnMode::Strongest, &firings)
}

/// A small generator: tests must not depend on another crate's stream.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % limit
    }

    /// Places far from each other and from both ends.
    fn places(&mut self, count: usize) -> Vec<usize> {
        let mut places: Vec<usize> = Vec::new();
        while places.len() < count {
            let place = 40 + self.below(TURNS * PACKETS_PER_TURN - 80);
            if places.iter().all(|other| place.abs_diff(*other) > 24) {
                places.push(place);
            }
        }
        places
    }
}

fn run(packets: &[(u64, Vec<u8>)]) -> Outcome {
    let outcome =
        decode(packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])), Options::default());
    check_frames(&outcome.frames);
    outcome
}

/// No frame is longer than a revolution and a packet, times rise, and no column is in two frames.
fn check_frames(frames: &[Frame]) {
    let mut last_ns = 0;
    for frame in frames {
        let [first_ns, end_ns] = frame.time_span_ns().unwrap();
        assert!(first_ns > last_ns, "frame {} begins before the last one ends", frame.frame_id);
        assert!(frame.column_time_ns.windows(2).all(|pair| pair[0] < pair[1]), "columns in order");
        let turn_ns = (PACKETS_PER_TURN * 24) as u64 * 55_296;
        assert!(end_ns - first_ns < turn_ns + 2 * 24 * 55_296, "frame {} is too long", frame.frame_id);
        last_ns = end_ns;
    }
}

#[test]
fn an_unharmed_stream_counts_nothing() {
    let packets = stream();
    let outcome = run(&packets);
    let stats = outcome.stats;
    assert_eq!(stats.packets as usize, packets.len());
    assert_eq!(stats.lost_packets + stats.duplicated + stats.reordered + stats.late + stats.malformed, 0);
    assert_eq!(stats.complete_frames + 1, stats.frames);
}

#[test]
fn dropped_packets_are_lost() {
    for seed in 0..8 {
        let mut random = Random(seed);
        let count = 1 + random.below(9);
        let mut packets = stream();
        let mut places = random.places(count);
        places.sort_unstable_by(|a, b| b.cmp(a));
        let mut dropped = 0;
        for place in places {
            let run_length = 1 + random.below(4);
            packets.drain(place..place + run_length);
            dropped += run_length;
        }
        let outcome = run(&packets);
        assert_eq!(outcome.stats.lost_packets as usize, dropped, "seed {seed}");
        let incomplete = outcome.frames.iter().filter(|frame| !frame.complete).count();
        assert!(incomplete >= 2 && incomplete <= 2 * count + 1, "seed {seed}: {incomplete}");
    }
}

#[test]
fn long_outages_never_merge_frames() {
    for outage in [30, 74, 75, 76, 150, 151, 200] {
        let mut packets = stream();
        packets.drain(100..100 + outage);
        let outcome = run(&packets);
        assert_eq!(outcome.stats.lost_packets as usize, outage);
    }
}

#[test]
fn repeated_packets_are_dropped() {
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        let mut places = random.places(7);
        places.sort_unstable_by(|a, b| b.cmp(a));
        for place in places {
            let again = packets[place].clone();
            packets.insert(place + 1 + random.below(12), again);
        }
        let outcome = run(&packets);
        assert_eq!((outcome.stats.duplicated, outcome.stats.lost_packets), (7, 0), "seed {seed}");
        assert_eq!(firings(&outcome.frames), firings(&run(&stream()).frames));
    }
}

#[test]
fn swapped_packets_fall_into_place() {
    let whole = firings(&run(&stream()).frames);
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        for place in random.places(7) {
            packets.swap(place, place + 1 + random.below(2));
        }
        let outcome = run(&packets);
        assert_eq!((outcome.stats.lost_packets, outcome.stats.late), (0, 0), "seed {seed}");
        assert!(outcome.stats.reordered >= 7, "seed {seed}: {}", outcome.stats.reordered);
        assert_eq!(firings(&outcome.frames), whole);
    }
}

#[test]
fn packets_held_up_are_used_while_their_frame_is_open() {
    let whole = firings(&run(&stream()).frames);
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        let mut places = random.places(6);
        places.sort_unstable_by(|a, b| b.cmp(a));
        for place in places {
            let held_up = packets.remove(place);
            packets.insert(place + 5 + random.below(15), held_up);
        }
        let outcome = run(&packets);
        let stats = &outcome.stats;
        assert_eq!((stats.lost_packets, stats.reordered + stats.late), (0, 6), "seed {seed}");
        assert_eq!(firings(&outcome.frames).len(), whole.len() - 24 * stats.late as usize);
    }
}

/// A packet that came is never lost: one that is cut off is malformed.
#[test]
fn packets_that_are_cut_off_are_malformed_and_not_lost() {
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        for place in random.places(6) {
            packets[place].1.truncate(600 + random.below(600));
        }
        let outcome = run(&packets);
        assert_eq!((outcome.stats.malformed, outcome.stats.lost_packets), (6, 0), "seed {seed}");
        assert!(outcome.rejected.iter().all(|rejected| matches!(rejected, Rejected::Malformed { .. })));
        assert!(
            outcome.frames.iter().filter(|frame| !frame.complete).count() >= 2,
            "they are missing all the same"
        );
    }
}

#[test]
fn a_bad_block_costs_the_block_and_not_the_packet() {
    let whole = run(&stream());
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        for (number, place) in random.places(6).into_iter().enumerate() {
            let block = 100 * random.below(12);
            match number % 2 {
                0 => packets[place].1[block] ^= 1 << random.below(8),
                _ => packets[place].1[block + 3] |= 0xF0,
            }
        }
        let outcome = run(&packets);
        let stats = &outcome.stats;
        assert_eq!((stats.bad_blocks, stats.malformed, stats.lost_packets), (6, 0, 0), "seed {seed}");
        assert_eq!(stats.packets as usize, packets.len());
        assert_eq!(outcome.frames.len(), whole.frames.len());
        let mut invalid = 0;
        for (frame, expected) in outcome.frames.iter().zip(&whole.frames) {
            assert_eq!(frame.column_time_ns, expected.column_time_ns);
            for column in 0..frame.columns() {
                let samples = frame.index(column, 0)..frame.index(column + 1, 0);
                let off_rad = frame.column_azimuth_rad[column] - expected.column_azimuth_rad[column];
                assert!(off_rad.abs() < 2e-4, "seed {seed}: {off_rad}");
                if frame.column_valid[column] {
                    assert_eq!(frame.first.range_mm[samples.clone()], expected.first.range_mm[samples]);
                } else {
                    assert!(frame.first.range_mm[samples].iter().all(|range_mm| *range_mm == 0));
                    invalid += 1;
                }
            }
        }
        assert_eq!(invalid, 12, "a block of a VLP-16 is two columns");
    }
}

/// 24 of 1 packet in 3 are damaged beyond what says anything.
#[test]
fn a_packet_of_bad_blocks_is_malformed() {
    let mut packets = stream();
    for block in 0..8 {
        packets[100].1[100 * block + 3] = 0xFF;
    }
    let outcome = run(&packets);
    assert_eq!((outcome.stats.malformed, outcome.stats.lost_packets, outcome.stats.bad_blocks), (1, 0, 0));
}

/// As some firmware writes a whole turn; the frames are those of the same packets with zeros there.
#[test]
fn azimuth_36000_is_zero_in_frames_too() {
    let firings: Vec<_> = (0..3 * PACKETS_PER_TURN * 24)
        .map(|number| Firing {
            time_ns: 1_700_000_000_000_000_000 + number as u64 * 55_296,
            azimuth_counts: (20.0 * number as f64).rem_euclid(36_000.0),
            first: vec![(3000, 9); 16],
            second: None,
        })
        .collect();
    let packets = encode(PRODUCT, ReturnMode::Strongest, &firings);
    let mut turned = packets.clone();
    let mut changed = 0;
    for (_, payload) in &mut turned {
        for block in 0..12 {
            let azimuth = &mut payload[100 * block + 2..][..2];
            if azimuth == [0, 0] {
                azimuth.copy_from_slice(&36_000_u16.to_le_bytes());
                changed += 1;
            }
        }
    }
    assert_eq!(changed, 3);
    let (outcome, expected) = (run(&turned), run(&packets));
    assert_eq!(outcome.frames, expected.frames);
    assert_eq!(outcome.stats, expected.stats);
}

/// The rest of the stream stays where it is, and the packet between its neighbours.
#[test]
fn one_odd_stamp_moves_nothing() {
    let whole = run(&stream());
    for (place, odd_us) in
        [(100, 48_000_000), (101, 3_599_999_999), (200, 1_000), (301, 0), (599, 48_000_000)]
    {
        let mut packets = stream();
        packets[place].1[1200..1204].copy_from_slice(&u32::to_le_bytes(odd_us));
        let outcome = run(&packets);
        let stats = &outcome.stats;
        assert_eq!(
            (stats.odd_stamps, stats.lost_packets, stats.late, stats.reordered),
            (1, 0, 0, 0),
            "{place}"
        );
        assert_eq!(outcome.frames.len(), whole.frames.len(), "{place}");
        for (frame, expected) in outcome.frames.iter().zip(&whole.frames) {
            assert_eq!(frame.first, expected.first);
            let off_ns = frame.column_time_ns.iter().zip(&expected.column_time_ns);
            assert!(off_ns.map(|(ours, theirs)| ours.abs_diff(*theirs)).max().unwrap() < 3000);
        }
    }
}

/// The same by a few milliseconds, back or ahead.
#[test]
fn a_stamp_that_is_off_by_little_moves_nothing() {
    let whole = run(&stream());
    for off_us in [-300_000, -5_000, 5_000, 300_000] {
        let mut packets = stream();
        let stamp = &mut packets[150].1[1200..1204];
        let odd_us = u32::from_le_bytes(stamp.try_into().unwrap()).wrapping_add_signed(off_us);
        stamp.copy_from_slice(&odd_us.to_le_bytes());
        let outcome = run(&packets);
        assert_eq!((outcome.stats.odd_stamps, outcome.stats.lost_packets), (1, 0), "{off_us}");
        let rows = |frames: &[Frame]| frames.iter().map(|frame| frame.first.clone()).collect::<Vec<_>>();
        assert_eq!(rows(&outcome.frames), rows(&whole.frames), "{off_us}");
    }
}

/// Two sensors behind one address and one port, whose clocks are 400 s apart.
#[test]
fn packets_of_two_clocks_are_not_one_sensors() {
    let own = stream();
    let mut both = Vec::new();
    for (time_ns, payload) in &own {
        let mut other = payload.clone();
        let stamp_us = u32::from_le_bytes(other[1200..1204].try_into().unwrap());
        other[1200..1204].copy_from_slice(&((stamp_us + 400_000_000) % 3_600_000_000).to_le_bytes());
        both.extend([(*time_ns, payload.clone()), (*time_ns + 600_000, other)]);
    }
    let each = both.iter().map(|(time_ns, payload)| (*time_ns, &payload[..]));
    let outcome = decode(each, Options::default());
    // the first few of the second are not known for what they are
    assert!((own.len() as u64 - 8..own.len() as u64).contains(&outcome.stats.foreign), "{:?}", outcome.stats);
    assert!(outcome.rejected[0].to_string().contains("two sensors"), "{}", outcome.rejected[0]);
}

#[test]
fn another_sensors_packets_are_foreign() {
    let mut packets = stream();
    let mut other = packets[50].1.clone();
    other[1205] = 0x28;
    packets.insert(60, (packets[60].0, other));
    packets.insert(70, (packets[70].0, vec![0xFF; 1212]));
    let outcome = run(&packets);
    assert_eq!((outcome.stats.foreign, outcome.stats.lost_packets), (2, 0));
}

/// Whichever comes first.
#[test]
fn packets_of_other_models_are_foreign() {
    let models = [Product::Vlp16, Product::Vlp32c, Product::Hdl64eS2, Product::Vls128];
    let made_up = |product| crate::made_up::velodyne_columns(product, 2000);
    for product in models {
        let own = made_up(product);
        for other in models.into_iter().filter(|other| *other != product) {
            let others = made_up(other);
            let (before, behind) = own.split_at(30);
            let all = before.iter().chain(&others[..20]).chain(behind).map(|payload| (1_000, &payload[..]));
            let outcome = decode(all, Options::default());
            let stats = &outcome.stats;
            assert_eq!((outcome.product, stats.foreign, stats.malformed), (Some(product), 20, 0), "{other}");
            let reason = outcome.rejected[0].to_string();
            let words = [format!("are of a {product}"), format!("a {other}").replace("-s2", "")];
            assert!(words.iter().all(|words| reason.contains(words)), "{reason}");
        }
    }
}

#[test]
fn a_clock_that_is_set_ends_the_frame() {
    let mut packets = stream();
    for (_, payload) in &mut packets[200..] {
        let stamp_us = u32::from_le_bytes(payload[1200..1204].try_into().unwrap());
        let set_us = (stamp_us + 1_234_567_890) % 3_600_000_000;
        payload[1200..1204].copy_from_slice(&set_us.to_le_bytes());
    }
    let outcome =
        decode(packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])), Options::default());
    assert_eq!(outcome.stats.lost_packets, 0);
    assert_eq!(firings(&outcome.frames).len(), packets.len() * 24);
}

/// Its frames end all the same, and hold every column once.
#[test]
fn a_sensor_that_stands_still_fills_no_memory() {
    let firings: Vec<_> = (0..100_000_u64)
        .map(|number| Firing {
            time_ns: 1_700_000_000_000_000_000 + number * 55_296,
            azimuth_counts: 12_345.0,
            first: vec![(3000, 9); 16],
            second: None,
        })
        .collect();
    let packets = encode(PRODUCT, ReturnMode::Strongest, &firings);
    for cut in [Cut::Packets, Cut::Azimuth(0.0)] {
        let each = packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..]));
        let outcome = decode(each, Options { cut, ..Options::default() });
        let longest = outcome.frames.iter().map(Frame::columns).max().unwrap();
        assert!((32_768..32_768 + 24).contains(&longest), "{longest}");
        assert!(outcome.frames.iter().all(|frame| !frame.complete));
        let columns: usize = outcome.frames.iter().map(Frame::columns).sum();
        assert_eq!(columns, 24 * packets.len());
        assert_eq!(outcome.stats.lost_packets, 0);
    }
}
