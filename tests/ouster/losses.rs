//! A bad line: packets dropped, doubled, swapped, held up, cut and damaged, by seed; counters say exactly that.

use std::collections::BTreeSet;

use rand_core::Rng;
use rand_pcg::Pcg64;
use sensors::ouster::{HeaderKind, Metadata, OusterEncoder, Profile, Synthetic};
use sensors::{DecodeStats, Frame};

use super::{Datagram, Decoding, datagrams, decode, metadata};
use crate::support::shared;

const FRAMES: u64 = 10;
const PACKETS_PER_FRAME: usize = 128;

/// Ten complete frames of a sensor that writes checksums.
fn recording() -> (Metadata, Vec<Datagram>) {
    let folder = "captures/ouster/synthetic";
    let metadata = metadata(&format!("{folder}/osf2pcap_osf_fw_3.2_10scans_0.json"));
    (metadata, datagrams(&shared(&format!("{folder}/osf2pcap_osf_fw_3.2_10scans.pcap"))))
}

fn seeded(seed: u64) -> Pcg64 {
    Pcg64::new(u128::from(seed), 0xa02b_dbf7_bb3c_0a7a)
}

fn below(rng: &mut Pcg64, bound: usize) -> usize {
    (rng.next_u64() % bound as u64) as usize
}

/// Places to disturb: not the first and the last packet (nobody can know that more was sent), and `apart` from one
/// another so that disturbances do not mix.
fn places(rng: &mut Pcg64, length: usize, count: usize, apart: usize) -> Vec<usize> {
    let mut places = BTreeSet::new();
    while places.len() < count {
        let place = 1 + below(rng, length - 2 - apart);
        if places.range(place.saturating_sub(apart)..=place + apart).next().is_none() {
            places.insert(place);
        }
    }
    places.into_iter().collect()
}

fn counts(stats: &DecodeStats) -> [u64; 7] {
    [
        stats.lost_packets,
        stats.duplicated,
        stats.reordered,
        stats.late,
        stats.malformed,
        stats.crc_errors,
        stats.foreign,
    ]
}

pub fn every_loss_is_counted_once() {
    let (metadata, clean) = recording();
    let undisturbed = decode(&metadata, &clean);
    assert_eq!(counts(&undisturbed.stats), [0; 7]);
    assert_eq!((undisturbed.stats.frames, undisturbed.stats.complete_frames), (FRAMES, FRAMES));
    for seed in 0..8 {
        let mut rng = seeded(seed);
        let check = |what: &str, line: Vec<Datagram>, expected: [u64; 7], whole: bool| {
            let decoding = decode(&metadata, &line);
            assert_eq!(counts(&decoding.stats), expected, "{what}, seed {seed}: {:?}", decoding.stats);
            compare_frames(what, &decoding, &undisturbed.frames, whole);
        };
        let n = 40;

        let dropped: BTreeSet<_> = places(&mut rng, clean.len(), n, 0).into_iter().collect();
        let line = clean.iter().enumerate().filter(|(at, _)| !dropped.contains(at)).map(|(_, d)| d.clone());
        check("drop", line.collect(), [n as u64, 0, 0, 0, 0, 0, 0], false);

        let mut line = clean.clone();
        for place in places(&mut rng, clean.len(), n, 0).into_iter().rev() {
            let copy_at = (place + 1 + below(&mut rng, 300)).min(line.len());
            line.insert(copy_at, line[place].clone());
        }
        check("duplicate", line, [0, n as u64, 0, 0, 0, 0, 0], true);

        let mut line = clean.clone();
        for place in places(&mut rng, clean.len(), n, 2) {
            line.swap(place, place + 1);
        }
        check("swap", line, [0, 0, n as u64, 0, 0, 0, 0], true);

        let mut line = clean.clone();
        let within_reach = clean.len() - 3 * PACKETS_PER_FRAME;
        for place in places(&mut rng, within_reach, 10, 5).into_iter().rev() {
            let delayed = line.remove(place);
            line.insert(place + PACKETS_PER_FRAME + 40, delayed);
        }
        check("delay", line, [0, 0, 0, 10, 0, 0, 0], false);

        let mut line = clean.clone();
        for place in places(&mut rng, clean.len(), n, 0) {
            let keep = below(&mut rng, line[place].payload.len());
            line[place].payload.truncate(keep);
        }
        check("truncate", line, [0, 0, 0, 0, n as u64, 0, 0], false);

        let mut line = clean.clone();
        for place in places(&mut rng, clean.len(), n, 0) {
            let at = below(&mut rng, line[place].payload.len());
            line[place].payload[at] ^= 1 << below(&mut rng, 8);
        }
        check("corrupt", line, [0, 0, 0, 0, 0, n as u64, 0], false);
    }
}

/// Frames come once, in order, and hold nothing but their own columns.
fn compare_frames(what: &str, decoding: &Decoding, clean: &[Frame], whole: bool) {
    let ids: Vec<_> = decoding.frames.iter().map(|frame| frame.frame_id).collect();
    let expected: Vec<_> = clean.iter().map(|frame| frame.frame_id).collect();
    assert_eq!(ids, expected, "{what}");
    for (frame, clean) in decoding.frames.iter().zip(clean) {
        if whole {
            assert!(frame.complete && frame.first == clean.first, "{what}: frame {}", frame.frame_id);
        }
        for column in 0..frame.columns() {
            let samples = frame.index(column, 0)..frame.index(column + 1, 0);
            let ranges = &frame.first.range_mm[samples.clone()];
            if frame.column_valid[column] {
                assert_eq!(
                    ranges, &clean.first.range_mm[samples],
                    "{what}: frame {}, {column}",
                    frame.frame_id
                );
            } else {
                assert!(ranges.iter().all(|range| *range == 0), "{what}: frame {}, {column}", frame.frame_id);
            }
        }
    }
}

/// Everything at once, with damaged checksums removed so that damage gets through to the frame logic.
pub fn a_bad_line_never_splits_or_merges_frames() {
    let (metadata, clean) = recording();
    let undisturbed = decode(&metadata, &clean).frames;
    let ids: BTreeSet<_> = undisturbed.iter().map(|frame| frame.frame_id).collect();
    for seed in 100..130 {
        let mut rng = seeded(seed);
        let mut line = Vec::new();
        for datagram in &clean {
            let mut datagram = datagram.clone();
            let length = datagram.payload.len();
            datagram.payload[length - 8..].fill(0);
            match below(&mut rng, 40) {
                0 => continue,
                1 => line.push(datagram.clone()),
                2 => datagram.payload[2..7][below(&mut rng, 5)] ^= 1 << below(&mut rng, 8), // counter or init id
                3 => datagram.payload.truncate(length / 2),
                _ => {}
            }
            line.push(datagram);
            let last = line.len() - 1;
            if below(&mut rng, 40) == 0 {
                line.swap(last, last.saturating_sub(1 + below(&mut rng, 3)));
            }
        }
        let decoding = decode(&metadata, &line);
        let got: Vec<_> = decoding.frames.iter().map(|frame| frame.frame_id).collect();
        let once: BTreeSet<_> = got.iter().copied().collect();
        assert_eq!(once.len(), got.len(), "seed {seed}: a frame came twice: {got:?}");
        assert!(ids.is_subset(&once), "seed {seed}: {got:?}");
        assert_eq!(decoding.stats.init_id_changes, 0, "seed {seed}");
    }
}

pub fn whole_frames_that_are_missing_are_lost() {
    let (metadata, clean) = recording();
    for (first, last) in [(3, 4), (2, 7), (1, 8)] {
        let gap = first * PACKETS_PER_FRAME..last * PACKETS_PER_FRAME;
        let line: Vec<_> =
            clean.iter().enumerate().filter(|(at, _)| !gap.contains(at)).map(|(_, d)| d.clone()).collect();
        let decoding = decode(&metadata, &line);
        assert_eq!(counts(&decoding.stats), [gap.len() as u64, 0, 0, 0, 0, 0, 0]);
        assert_eq!(decoding.stats.complete_frames, FRAMES - (last - first) as u64);
    }
    // also where the metadata is wrong about the rate, so that clock and counter disagree over the gap
    let mistaken = Metadata { frame_rate_hz: 2.0 * metadata.frame_rate_hz, ..metadata.clone() };
    let line = [&clean[..2 * PACKETS_PER_FRAME], &clean[8 * PACKETS_PER_FRAME..]].concat();
    let decoding = decode(&mistaken, &line);
    assert_eq!(counts(&decoding.stats), [6 * PACKETS_PER_FRAME as u64, 0, 0, 0, 0, 0, 0]);
    assert_eq!((decoding.stats.complete_frames, decoding.stats.init_id_changes), (4, 0));
    // a recording that begins and ends inside a frame has lost nothing
    let decoding = decode(&metadata, &clean[50..1000]);
    assert_eq!(counts(&decoding.stats), [0; 7]);
    assert_eq!(decoding.stats.complete_frames, 6);
}

pub fn a_restarted_sensor_goes_on() {
    let (metadata, clean) = recording();
    let frames = decode(&metadata, &clean).frames;
    let mut restarted = metadata.clone();
    restarted.init_id += 1;
    let mut line = clean[..300].to_vec();
    let mut encoder = OusterEncoder::new(restarted);
    for (id, frame) in frames[..2].iter().enumerate() {
        let frame = Frame { frame_id: id as u32, ..frame.clone() };
        encoder.frame(&frame, &mut |payload| {
            line.push(Datagram { payload: payload.to_vec(), ..clean[0].clone() })
        });
    }
    let decoding = decode(&metadata, &line);
    let ids: Vec<_> = decoding.frames.iter().map(|frame| (frame.frame_id, frame.complete)).collect();
    assert_eq!(ids, [(58684, true), (58685, true), (58686, false), (0, true), (1, true)]);
    assert_eq!(decoding.stats.init_id_changes, 1);
    assert_eq!(counts(&decoding.stats), [0; 7]);

    // LEGACY packets name no initialization: the frame counter starts over
    let wanted = Synthetic::new("os1-16", 7, Profile::Legacy);
    let metadata = Metadata::synthetic(&wanted).unwrap();
    let line = encode(&metadata, &[500, 501, 502, 0, 1]);
    let decoding = decode(&metadata, &line);
    let ids: Vec<_> = decoding.frames.iter().map(|frame| (frame.frame_id, frame.complete)).collect();
    assert_eq!(ids, [(500, true), (501, true), (502, true), (0, true), (1, true)]);
    assert_eq!(counts(&decoding.stats), [0; 7]);
    // and a short recording played in a loop
    let decoding = decode(&metadata, &encode(&metadata, &[500, 501, 500, 501]));
    assert_eq!(decoding.stats.complete_frames, 4, "{:?}", decoding.stats);
}

/// Frames of a flat world at the given counters, as datagrams.
fn encode(metadata: &Metadata, ids: &[u32]) -> Vec<Datagram> {
    let address = std::net::SocketAddr::from(([192, 0, 2, 1], 7502));
    let mut encoder = OusterEncoder::new(metadata.clone());
    let mut line = Vec::new();
    let columns = metadata.columns_per_frame;
    for (turn, id) in ids.iter().enumerate() {
        let samples = columns * metadata.pixels_per_column;
        let period_ns = (1e9 / metadata.frame_rate_hz) as u64;
        let mut frame = Frame {
            frame_id: *id,
            channels: metadata.pixels_per_column,
            column_time_ns: (0..columns)
                .map(|column| 1 + turn as u64 * period_ns + column as u64 * period_ns / columns as u64)
                .collect(),
            column_valid: (0..columns).map(|column| metadata.in_window(column)).collect(),
            ..Frame::default()
        };
        for column in 0..columns {
            if !metadata.expects_slot(column / metadata.columns_per_packet) {
                frame.column_time_ns[column] = 0;
            }
        }
        frame.first.range_mm = vec![800 * (1 + turn as u32); samples];
        encoder.frame(&frame, &mut |payload| {
            line.push(Datagram {
                host_time_ns: line.len() as u64,
                source: address,
                destination: address,
                payload: payload.to_vec(),
            });
        });
    }
    line
}

pub fn the_frame_counter_wraps() {
    for (profile, header, ids) in [
        (Profile::Legacy, HeaderKind::Standard, [65_534, 65_535, 0, 1]),
        (Profile::Rng15Rfl8Nir8, HeaderKind::Standard, [65_534, 65_535, 0, 1]),
        (Profile::Rng15Rfl8Nir8, HeaderKind::Fusa, [u32::MAX - 1, u32::MAX, 0, 1]),
        (Profile::Rng15Rfl8Nir8, HeaderKind::Fusa, [65_534, 65_535, 65_536, 65_537]),
    ] {
        let wanted = Synthetic { header, ..Synthetic::new("os1-16", 7, profile) };
        let metadata = Metadata::synthetic(&wanted).unwrap();
        let mut line = encode(&metadata, &ids);
        line.swap(2 * 64 - 1, 2 * 64); // across the wrap
        line.remove(70);
        let decoding = decode(&metadata, &line);
        let got: Vec<_> = decoding.frames.iter().map(|frame| frame.frame_id).collect();
        assert_eq!(got, ids, "{profile:?}");
        assert_eq!(counts(&decoding.stats), [1, 0, 1, 0, 0, 0, 0], "{profile:?}");
    }
}

pub fn a_window_through_column_zero() {
    let wanted = Synthetic {
        column_window: [400, 100],
        ..Synthetic::new("os1-16", 7, Profile::Rng15Rfl8Nir8).columns(512, 16)
    };
    let metadata = Metadata::synthetic(&wanted).unwrap();
    assert_eq!(metadata.packets_per_frame(), 14);
    let clean = encode(&metadata, &[1, 2, 3]);
    assert_eq!(clean.len(), 42);
    let decoding = decode(&metadata, &clean);
    assert_eq!(decoding.stats.complete_frames, 3);
    assert_eq!(counts(&decoding.stats), [0; 7]);
    assert_eq!(decoding.frames[1].valid_columns(), 213);
    let mut line = clean.clone();
    line.swap(16, 17);
    line.remove(20);
    let decoding = decode(&metadata, &line);
    assert_eq!(counts(&decoding.stats), [1, 0, 1, 0, 0, 0, 0]);
}
