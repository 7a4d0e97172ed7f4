//! Velodyne captures against the digests of velodyne_decoder, scans of another driver, and themselves.

use sensors::velodyne::{Options, VelodyneDecoder};
use sensors::{DecodeStats, Decoded, Decoder, Frame, SensorModel};

use crate::support::datagram::{self, Datagram};
use crate::support::{Case, shared, with_shared};

mod digests;
mod packets;
mod scans;

pub const CASES: &[Case] = &[
    with_shared("mrpt_vlp16_gps", digests::mrpt_vlp16_gps),
    with_shared("nebula_vlp16", digests::nebula_vlp16),
    with_shared("nebula_vlp32", digests::nebula_vlp32),
    with_shared("nebula_vls128", digests::nebula_vls128),
    with_shared("rustlidar_vlp16", digests::rustlidar_vlp16),
    with_shared("rustlidar_hdl32e", digests::rustlidar_hdl32e),
    with_shared("synthetic_hdl32e_dual", digests::synthetic_hdl32e_dual),
    with_shared("synthetic_vlp32c_dual", digests::synthetic_vlp32c_dual),
    with_shared("synthetic_hdl64e_s2", digests::synthetic_hdl64e_s2),
    with_shared("nebula_vlp32_scan", scans::nebula_vlp32_scan),
    with_shared("nebula_vlp16_scan", scans::nebula_vlp16_scan),
    with_shared("field_of_view_gap", scans::field_of_view_gap),
    with_shared("position_packets", packets::position_packets),
    with_shared("every_packet_that_is_missing_is_counted", packets::every_packet_that_is_missing_is_counted),
    with_shared("vli_16_is_refused", packets::vli_16_is_refused),
    with_shared("claims", packets::claims),
    with_shared("recordings_are_encoded_again", packets::recordings_are_encoded_again),
];

/// Datagrams of a capture in the shared folder.
fn datagrams(path: &str) -> Vec<Datagram> {
    datagram::datagrams(&shared(path))
}

struct Decoding {
    frames: Vec<Frame>,
    model: SensorModel,
    stats: DecodeStats,
}

fn decode(datagrams: &[Datagram], options: Options) -> Decoding {
    let mut decoder = VelodyneDecoder::new(options);
    let mut frames = Vec::new();
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push(frame.clone());
        }
    };
    for datagram in datagrams {
        decoder.push(&datagram.packet(), &mut take).unwrap();
    }
    decoder.finish(&mut take);
    Decoding { frames, model: decoder.model().unwrap().clone(), stats: decoder.stats().clone() }
}

fn decode_capture(name: &str) -> Decoding {
    decode(&datagrams(&format!("captures/velodyne/{name}.pcap")), Options::default())
}
