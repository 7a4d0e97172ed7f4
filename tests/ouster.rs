//! Ouster: captures against the digests of ouster-sdk, byte-exact encoding, losses counted as they were made,
//! metadata of every age, several sensors on one port.

mod captures;

use std::path::PathBuf;

use sensors::capture::CaptureReader;
use sensors::ouster::{ImuSample, Metadata, OusterDecoder, ZoneReport};
use sensors::{DecodeStats, Decoded, Decoder, Frame, Packet};

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] =
    &[with_shared("captures_match_their_digests", captures::captures_match_their_digests)];

/// A datagram that owns its bytes.
#[derive(Clone, Debug, PartialEq)]
struct Datagram {
    host_time_ns: u64,
    source: std::net::SocketAddr,
    destination: std::net::SocketAddr,
    payload: Vec<u8>,
}

impl Datagram {
    fn packet(&self) -> Packet<'_> {
        let Self { host_time_ns, source, destination, payload } = self;
        Packet { host_time_ns: *host_time_ns, source: *source, destination: *destination, payload }
    }
}

/// Everything a decoder made of a list of datagrams.
#[derive(Default)]
struct Decoding {
    frames: Vec<Frame>,
    imu: Vec<ImuSample>,
    zones: Vec<ZoneReport>,
    stats: DecodeStats,
}

fn datagrams(path: &PathBuf) -> Vec<Datagram> {
    let mut reader = CaptureReader::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(packet) = reader.next().unwrap() {
        all.push(Datagram {
            host_time_ns: packet.host_time_ns,
            source: packet.source,
            destination: packet.destination,
            payload: packet.payload.to_vec(),
        });
    }
    all
}

fn metadata(path: &str) -> Metadata {
    let text = std::fs::read_to_string(shared(path)).unwrap();
    Metadata::parse(&text, path).unwrap()
}

fn decode<'a>(metadata: &Metadata, datagrams: impl IntoIterator<Item = &'a Datagram>) -> Decoding {
    let mut decoder = OusterDecoder::new(metadata.clone());
    let mut decoding = Decoding::default();
    let mut take = |decoded: Decoded<'_>| match decoded {
        Decoded::Frame(frame) => decoding.frames.push(frame.clone()),
        Decoded::Imu(sample) => decoding.imu.push(sample.clone()),
        Decoded::Zones(report) => decoding.zones.push(report.clone()),
        other => panic!("{other:?} from an Ouster"),
    };
    for datagram in datagrams {
        let _ = decoder.push(&datagram.packet(), &mut take); // refusals are counted, and the counters compared
    }
    decoder.finish(&mut take);
    decoding.stats = decoder.stats().clone();
    decoding
}
