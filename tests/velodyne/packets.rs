//! Position packets, foreign packets, claims, and recordings encoded again.

use sensors::ouster::Claim;
use sensors::velodyne::{Options, Product, PulseState, ReturnMode, VelodyneDecoder, VelodyneEncoder};
use sensors::{Decoded, Decoder, Rejected};

use super::{Datagram, datagrams, decode, decode_capture};

/// Of packets that turn far (a VLP-16's) and hardly at all (a VLS-128's), one by one and in every rhythm.
pub fn every_packet_that_is_missing_is_counted() {
    for name in ["nebula_vlp16", "nebula_vlp32", "nebula_vls128"] {
        let all: Vec<Datagram> = datagrams(&format!("captures/velodyne/{name}.pcap"))
            .into_iter()
            .filter(|datagram| datagram.payload.len() == 1206)
            .collect();
        let lost = |is_missing: &dyn Fn(usize) -> bool| {
            let mut decoder = VelodyneDecoder::new(Options::default());
            for (_, datagram) in all.iter().enumerate().filter(|(at, _)| !is_missing(*at)) {
                decoder.push(&datagram.packet(), &mut |_| ()).unwrap();
            }
            decoder.finish(&mut |_| ());
            decoder.stats().lost_packets
        };
        assert_eq!(lost(&|_| false), 0, "{name}");
        for every in [5, 9, 10, 20] {
            let removed = (0..all.len() - 1).filter(|at| at % every == every - 1).count() as u64;
            let counted = lost(&|at| at + 1 < all.len() && at % every == every - 1);
            assert_eq!(counted, removed, "{name}, every {every}th");
        }
        for single in 300..312 {
            assert_eq!(lost(&|at| at == single), 1, "{name}, number {single}");
        }
    }
}

/// The GPS sentence and the pulse of a VLP-16 whose clock is locked, and of an HDL-32E with its inertial units.
pub fn position_packets() {
    let positions = |name: &str| {
        let mut decoder = VelodyneDecoder::new(Options::default());
        let mut positions = Vec::new();
        for datagram in datagrams(&format!("captures/velodyne/{name}.pcap")) {
            let mut take = |decoded: Decoded<'_>| {
                if let Decoded::Position(position) = decoded {
                    positions.push(position.clone());
                }
            };
            decoder.push(&datagram.packet(), &mut take).unwrap();
            if datagram.payload.len() == 512 {
                let again = positions.last().unwrap().encode();
                let sent = &datagram.payload;
                assert_eq!((&again[14..38], &again[0xBB..0xCE]), (&sent[14..38], &sent[0xBB..0xCE]));
                let text = positions.last().unwrap().sentence.len();
                assert_eq!(again[0xCE..0xCE + text], sent[0xCE..0xCE + text]);
            }
        }
        positions
    };
    let locked = positions("mrpt_vlp16_gps");
    assert_eq!(locked.len(), 57);
    for position in &locked {
        assert_eq!(position.pulse, PulseState::Locked);
        let fix = position.fix().unwrap();
        assert_eq!(fix.date, Some((2016, 1, 21)));
        assert!(fix.valid);
        let utc_ns = position.utc_ns().unwrap();
        assert!(utc_ns.abs_diff(fix.utc_ns().unwrap()) < 2_000_000_000);
        assert!(utc_ns.abs_diff(position.host_time_ns) < 1_000_000_000);
    }
    assert!(locked.windows(2).all(|pair| pair[0].stamp_us < pair[1].stamp_us));
    let hdl_32e = positions("rustlidar_hdl32e_named_vlp32");
    assert_eq!(hdl_32e.len(), 9);
    for position in &hdl_32e {
        for unit in position.inertial.unwrap() {
            assert!((20.0..60.0).contains(&unit.temperature_c), "{unit:?}");
            assert!(unit.rate_rad_s.abs() < 1.0, "{unit:?}");
        }
    }
    assert_eq!(positions("rustlidar_vlp16").len(), 16);
}

/// A look-alike with block flags and six more bytes.
pub fn vli_16_is_refused() {
    let datagrams = datagrams("captures/ouster/VLI-16-one-packet.pcap");
    assert_eq!(datagrams.len(), 1);
    let mut decoder = VelodyneDecoder::new(Options::default());
    assert_eq!(decoder.claim(&datagrams[0].packet()), Claim::No);
    let rejected = decoder.push(&datagrams[0].packet(), &mut |_| panic!("nothing comes of it")).unwrap_err();
    assert!(matches!(&rejected, Rejected::Foreign { reason } if reason.contains("1212")), "{rejected}");
    decoder.finish(&mut |_| panic!("nothing comes of it"));
    assert_eq!(decoder.stats().foreign, 1);
}

/// Every packet of a capture is claimed, before and after the first, and no other sensor's is.
pub fn claims() {
    let vlp_16 = datagrams("captures/velodyne/mrpt_vlp16_gps.pcap");
    let hdl_32e = datagrams("captures/velodyne/rustlidar_hdl32e_named_vlp32.pcap");
    let ouster = datagrams("captures/ouster/OS-2-32-U0_v2.0.0_1024x10.pcap");
    let mut decoder = VelodyneDecoder::new(Options::default());
    assert!(vlp_16.iter().all(|datagram| decoder.claim(&datagram.packet()) >= Claim::Possible));
    assert!(ouster.iter().all(|datagram| decoder.claim(&datagram.packet()) == Claim::No));
    for datagram in &vlp_16 {
        decoder.push(&datagram.packet(), &mut |_| {}).unwrap();
        assert_eq!(decoder.claim(&datagram.packet()), Claim::Familiar);
    }
    let data = |datagram: &&Datagram| datagram.payload.len() == 1206;
    assert!(hdl_32e.iter().filter(data).all(|datagram| decoder.claim(&datagram.packet()) == Claim::No));
}

/// Frames that were decoded are encoded and decoded again: the same frames.
pub fn recordings_are_encoded_again() {
    for (name, mode) in [
        ("mrpt_vlp16_gps", ReturnMode::Strongest),
        ("nebula_vlp16", ReturnMode::Dual),
        ("nebula_vls128", ReturnMode::Strongest),
        ("rustlidar_hdl32e_named_vlp32", ReturnMode::Strongest),
        ("synthetic/syn_vlp32c_dual", ReturnMode::Dual),
    ] {
        let decoding = decode_capture(name);
        let product = Product::from_name(&decoding.model.name).unwrap();
        let mut encoder = VelodyneEncoder::new(product, mode);
        let mut again = Vec::new();
        let original = datagrams(&format!("captures/velodyne/{name}.pcap"));
        let mut take = |_: u64, payload: &[u8; 1206]| {
            again.push(Datagram { payload: payload.to_vec(), ..original[again.len()].clone() });
        };
        for frame in &decoding.frames {
            encoder.push_frame(frame, &mut take);
        }
        encoder.finish(&mut take);
        let second = decode(&again, Options::default());
        assert_eq!(second.frames.len(), decoding.frames.len(), "{name}");
        for (frame, expected) in second.frames.iter().zip(&decoding.frames) {
            assert_eq!((&frame.first, &frame.second), (&expected.first, &expected.second), "{name}");
            for column in 0..frame.columns() {
                let off_rad = frame.column_azimuth_rad[column] - expected.column_azimuth_rad[column];
                assert!(off_rad.abs() < 1e-5, "{name}: column {column} is {off_rad} rad off");
                let off_ns = frame.column_time_ns[column].abs_diff(expected.column_time_ns[column]);
                // stamps are whole microseconds
                assert!(off_ns <= 2000, "{name}: column {column} is {off_ns} ns off");
            }
        }
    }
}
