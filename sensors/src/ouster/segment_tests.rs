//! A sensor that is set to another mode while it is recorded: each part is decoded in its own.

use std::net::SocketAddr;

use super::*;
use crate::{DecodeStats, Decoded, Decoder, Packet};

const MODES: [(usize, f64); 6] =
    [(512, 10.0), (512, 20.0), (1024, 10.0), (1024, 20.0), (2048, 10.0), (4096, 5.0)];
const FRAMES: u32 = 4;

/// Some revolutions in one mode.
struct Part {
    mode: (usize, f64),
    init_id: u32,
    first_id: u32,
    start_ns: u64,
    /// Column that was fired first.
    from_column: usize,
}

impl Part {
    fn metadata(&self, profile: Profile) -> Metadata {
        let wanted = Synthetic {
            init_id: self.init_id,
            frame_rate_hz: self.mode.1,
            ..Synthetic::new("os1-16", 5, profile).columns(self.mode.0, 16)
        };
        Metadata::synthetic(&wanted).unwrap()
    }

    fn step_ns(&self) -> f64 {
        1e9 / self.mode.1 / self.mode.0 as f64
    }

    fn end_ns(&self) -> u64 {
        let columns = FRAMES as usize * self.mode.0 - self.from_column;
        self.start_ns + (columns as f64 * self.step_ns()) as u64
    }

    fn payloads(&self, profile: Profile) -> Vec<(u64, Vec<u8>)> {
        let metadata = self.metadata(profile);
        let mut encoder = OusterEncoder::new(metadata.clone());
        let mut payloads = Vec::new();
        for revolution in 0..FRAMES {
            let mut frame = assembly::blank_frame(&metadata);
            frame.frame_id = self.first_id + revolution;
            for column in 0..metadata.columns_per_frame {
                let fired = revolution as usize * metadata.columns_per_frame + column;
                let Some(after) = fired.checked_sub(self.from_column) else { continue };
                frame.column_time_ns[column] = self.start_ns + (after as f64 * self.step_ns()) as u64;
                frame.column_valid[column] = true;
            }
            let times = frame.column_time_ns.clone();
            let mut slots = (0..metadata.packet_slots()).filter(|slot| times[slot * 16] > 0);
            encoder.frame(&frame, &mut |packet| {
                payloads.push((times[slots.next().unwrap() * 16], packet.to_vec()));
            });
        }
        payloads
    }
}

fn decode(
    metadata: &Metadata,
    payloads: &[(u64, Vec<u8>)],
    learned: usize,
) -> (Vec<(usize, usize)>, DecodeStats, Vec<Correction>) {
    let mut decoder = OusterDecoder::new(metadata.clone());
    for (_, payload) in payloads.iter().take(learned) {
        decoder.learn(payload);
    }
    if learned > 0 {
        decoder.end_learning();
    }
    let mut frames = Vec::new();
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push((frame.columns(), frame.valid_columns()));
        }
    };
    let address = SocketAddr::from(([192, 0, 2, 7], 7502));
    for (host_time_ns, payload) in payloads {
        let (source, destination, link) = (address, address, Default::default());
        let packet = Packet { host_time_ns: *host_time_ns, source, destination, link, payload };
        decoder.push(&packet, &mut take).unwrap();
    }
    decoder.finish(&mut take);
    let (stats, corrections) = (decoder.stats().clone(), decoder.corrections().to_vec());
    (frames, stats, corrections)
}

fn check(profile: Profile, parts: &[Part; 2], stated: &Metadata, learned: usize) {
    let payloads: Vec<_> = parts.iter().flat_map(|part| part.payloads(profile)).collect();
    let (frames, stats, corrections) = decode(stated, &payloads, learned);
    let wanted: Vec<_> = parts
        .iter()
        .flat_map(|part| {
            (0..FRAMES).map(|revolution| {
                let columns = part.mode.0;
                (columns, if revolution == 0 { columns - part.from_column } else { columns })
            })
        })
        .collect();
    let what = format!("{profile:?} {:?} to {:?}", parts[0].mode, parts[1].mode);
    assert_eq!(frames, wanted, "{what}");
    let refused = (stats.lost_packets, stats.malformed, stats.late, stats.duplicated, stats.crc_errors);
    assert_eq!(refused, (0, 0, 0, 0, 0), "{what}");
    let modes: Vec<_> = corrections.iter().filter(|found| found.setting == "lidar_mode").collect();
    let name = |part: &Part| format!("{}x{}", part.mode.0, part.mode.1);
    let mut expected = Vec::new();
    if stated.mode() != name(&parts[0]) {
        expected.push((stated.mode(), name(&parts[0])));
    }
    expected.push((name(&parts[0]), name(&parts[1])));
    let found: Vec<_> = modes.iter().map(|one| (one.stated.clone(), one.found.clone())).collect();
    assert_eq!(found, expected, "{what}");
    // where nothing but the pace changes, it shows with the second packet
    let since_ns = modes.last().unwrap().since_ns.unwrap() - parts[1].start_ns;
    assert!(since_ns as f64 <= 16.0 * parts[1].step_ns(), "{what}: {since_ns} ns late");
}

fn parts(from: (usize, f64), to: (usize, f64), gap_ns: u64, restarts: bool, from_column: usize) -> [Part; 2] {
    let first = Part { mode: from, init_id: 7, first_id: 100, start_ns: 5_000_000_000, from_column: 0 };
    let start_ns = first.end_ns() + gap_ns;
    let (init_id, first_id) = if restarts { (8, 1) } else { (7, 100 + FRAMES) };
    [first, Part { mode: to, init_id, first_id, start_ns, from_column }]
}

/// Every change of mode, after a pause in which the sensor was initialised again.
#[test]
fn a_mode_that_changes_begins_a_segment() {
    for from in MODES {
        for to in MODES.into_iter().filter(|to| *to != from) {
            for profile in [Profile::Legacy, Profile::Rng19Rfl8Sig16Nir16] {
                for (restarts, from_column) in [(true, 0), (false, 0), (true, 160), (false, 160)] {
                    let parts = parts(from, to, 3_000_000_000, restarts, from_column);
                    check(profile, &parts, &parts[0].metadata(profile), 200);
                }
            }
        }
    }
}

/// A live decoder learns nothing ahead; a sensor is back after half a second.
#[test]
fn a_mode_that_changes_live_begins_a_segment() {
    for from in MODES {
        for to in MODES.into_iter().filter(|to| *to != from) {
            let profile = Profile::Rng19Rfl8Sig16Nir16;
            for from_column in [0, to.0 / 2, to.0 - 32] {
                let parts = parts(from, to, 500_000_000, true, from_column);
                check(profile, &parts, &parts[0].metadata(profile), 0);
            }
        }
    }
}

/// Without a pause the pace of columns tells, and an initialization id where packets have one.
#[test]
fn a_mode_that_changes_at_once_begins_a_segment() {
    for from in MODES {
        for to in MODES.into_iter().filter(|to| to.0 as f64 * to.1 != from.0 as f64 * from.1) {
            for profile in [Profile::Legacy, Profile::Rng19Rfl8Sig16Nir16] {
                let parts = parts(from, to, 20_000, false, 0);
                check(profile, &parts, &parts[0].metadata(profile), 200);
            }
        }
    }
}

/// Metadata of a third mode are corrected first, then again.
#[test]
fn a_segment_is_held_against_the_mode_before_it() {
    for profile in [Profile::Legacy, Profile::Rng19Rfl8Sig16Nir16] {
        let parts = parts((512, 10.0), (1024, 10.0), 3_000_000_000, true, 0);
        let stated = Part { mode: (2048, 10.0), ..parts[0] };
        check(profile, &parts, &stated.metadata(profile), 200);
    }
}
