//! Packets of any bytes: the first byte picks the sensor, the rest is cut into payloads and mixed with real ones.
//! Frames come out whole in shape, and every packet is accounted for.
#![no_main]

use std::net::SocketAddr;

use libfuzzer_sys::fuzz_target;
use sensors::ouster::{ImuProfile, Metadata, OusterDecoder, OusterEncoder, Profile, Synthetic};
use sensors::{Decoded, Decoder, Frame, Packet};

fuzz_target!(|data: &[u8]| {
    let Some((pick, mut data)) = data.split_first() else { return };
    let profiles: Vec<_> = Profile::all().collect();
    let profile = profiles[usize::from(*pick) % profiles.len()];
    let mut wanted = Synthetic::new("os1-16", 7, profile).columns(64, 8);
    if *pick > 127 && profile != Profile::Legacy {
        wanted.imu_profile = ImuProfile::Accel32Gyro32Nmea;
        wanted.column_window = [40, 20];
    }
    let metadata = Metadata::synthetic(&wanted).expect("a plain sensor");
    let address = SocketAddr::from(([127, 0, 0, 1], 7502));
    let bytes = metadata.packet_format().packet_bytes();
    let samples = metadata.columns_per_frame * metadata.pixels_per_column;
    let mut decoder = OusterDecoder::new(metadata.clone());
    let mut encoder = OusterEncoder::new(metadata.clone());
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            assert_eq!(frame.first.range_mm.len(), samples);
        }
    };
    let mut pushed = 0;
    let mut frame_id = 0u32;
    while let Some((how, rest)) = data.split_first() {
        // patches of (place, byte) over a real packet, or raw bytes
        let length = rest.len().min(usize::from(*how % 16));
        let (patch, rest) = rest.split_at(length);
        data = rest;
        frame_id += u32::from(*how & 1);
        let mut payloads = Vec::new();
        if *how < 192 {
            let frame = real_frame(&metadata, frame_id);
            encoder.frame(&frame, &mut |payload| payloads.push(payload.to_vec()));
            let keep = usize::from(*how >> 1) % payloads.len().max(1);
            payloads = payloads.into_iter().skip(keep).take(2).collect();
            for payload in &mut payloads {
                for pair in patch.chunks_exact(2) {
                    let place = usize::from(pair[0]) % payload.len();
                    payload[place] ^= pair[1];
                }
            }
        } else {
            let mut payload = patch.to_vec();
            payload.resize(if *how < 224 { bytes } else { patch.len() }, *how);
            payloads.push(payload);
        }
        for payload in payloads {
            let packet = Packet { host_time_ns: 0, source: address, destination: address, payload: &payload };
            let _ = decoder.claim(&packet);
            let _ = decoder.push(&packet, &mut take);
            pushed += 1;
        }
    }
    decoder.finish(&mut take);
    let stats = decoder.stats();
    assert_eq!(stats.packets + stats.malformed + stats.crc_errors + stats.foreign, pushed);
    assert!(stats.frames >= stats.complete_frames);
});

fn real_frame(metadata: &Metadata, frame_id: u32) -> Frame {
    let columns = metadata.columns_per_frame;
    let step_ns = (1e9 / metadata.frame_rate_hz) as u64 / columns as u64;
    let mut frame = Frame {
        frame_id: frame_id % 65_536,
        channels: metadata.pixels_per_column,
        column_time_ns: (0..columns as u64)
            .map(|column| 1 + (u64::from(frame_id) * columns as u64 + column) * step_ns)
            .collect(),
        column_valid: (0..columns).map(|column| metadata.in_window(column)).collect(),
        ..Frame::default()
    };
    let samples = columns * metadata.pixels_per_column;
    frame.first.range_mm = vec![8000; samples];
    frame.first.raw_words = vec![[8000; 5]; if metadata.profile == Profile::FiveWordPixel { samples } else { 0 }];
    frame
}
