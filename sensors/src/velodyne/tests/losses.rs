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

#[test]
fn damaged_packets_are_refused() {
    for seed in 0..8 {
        let mut random = Random(seed);
        let mut packets = stream();
        for (number, place) in random.places(6).into_iter().enumerate() {
            let payload = &mut packets[place].1;
            let block = 100 * random.below(12);
            match number % 3 {
                0 => payload.truncate(600 + random.below(600)),
                1 => payload[block] ^= 1 << random.below(8),
                _ => payload[block + 3] |= 0xF0,
            }
        }
        let outcome = run(&packets);
        assert_eq!((outcome.stats.malformed, outcome.stats.lost_packets), (6, 6), "seed {seed}");
        assert!(outcome.rejected.iter().all(|rejected| matches!(rejected, Rejected::Malformed { .. })));
    }
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
