//! Velodyne captures against the digests of velodyne_decoder.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use sensors::velodyne::{Options, VelodyneDecoder};
use sensors::{DecodeStats, Decoded, Decoder, Frame, Packet, SensorModel};

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[with_shared("mrpt_vlp16_gps", mrpt_vlp16_gps)];

struct Datagram {
    host_time_ns: u64,
    source: SocketAddr,
    destination: SocketAddr,
    payload: Vec<u8>,
}

impl Datagram {
    fn packet(&self) -> Packet<'_> {
        Packet {
            host_time_ns: self.host_time_ns,
            source: self.source,
            destination: self.destination,
            payload: &self.payload,
        }
    }
}

/// UDP datagrams of a classic pcap file over Ethernet and IPv4.
fn datagrams(path: &str) -> Vec<Datagram> {
    let bytes = std::fs::read(shared(path)).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((word(0), word(20)), (0xa1b2_c3d4, 1), "{path}: classic pcap, us, Ethernet");
    let mut all = Vec::new();
    let mut at = 24;
    while at + 16 <= bytes.len() {
        let length = word(at + 8) as usize;
        let frame = &bytes[at + 16..at + 16 + length];
        let address = |ip: usize, port: usize| {
            let octets: [u8; 4] = frame[ip..ip + 4].try_into().unwrap();
            SocketAddr::new(
                IpAddr::V4(Ipv4Addr::from(octets)),
                u16::from_be_bytes([frame[port], frame[port + 1]]),
            )
        };
        let udp = 14 + usize::from(frame[14] & 15) * 4;
        let udp_length = usize::from(u16::from_be_bytes([frame[udp + 4], frame[udp + 5]]));
        all.push(Datagram {
            host_time_ns: u64::from(word(at)) * 1_000_000_000 + u64::from(word(at + 4)) * 1000,
            source: address(26, udp),
            destination: address(30, udp + 2),
            payload: frame[udp + 8..udp + udp_length].to_vec(),
        });
        at += 16 + length;
    }
    all
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

fn mrpt_vlp16_gps() {
    let decoding = decode(&datagrams("captures/velodyne/mrpt_vlp16_gps.pcap"), Options::default());
    let points: Vec<_> = decoding.frames.iter().map(|frame| frame.first.points()).collect();
    assert_eq!(points, [18790, 18701, 18678, 17317]);
    println!("{:?} {:?}", decoding.stats, decoding.model.name);
}
