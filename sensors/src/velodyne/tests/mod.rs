//! What is encoded is decoded; losses are counted as they were made.

mod changes;
mod losses;
mod round_trip;

use std::net::SocketAddr;

use super::{Column, Cut, Options, Product, ReturnMode, VelodyneDecoder, VelodyneEncoder};
use crate::{DecodeStats, Decoded, Decoder, Frame, Packet, Rejected};

/// One firing sequence with its samples.
#[derive(Clone, Debug, PartialEq)]
struct Firing {
    time_ns: u64,
    azimuth_counts: f64,
    first: Vec<(u32, u8)>,
    second: Option<Vec<(u32, u8)>>,
}

/// Packets with the time of their first firing.
fn encode(product: Product, mode: ReturnMode, firings: &[Firing]) -> Vec<(u64, Vec<u8>)> {
    let mut encoder = VelodyneEncoder::new(product, mode);
    let mut packets = Vec::new();
    let mut take = |time_ns: u64, payload: &[u8; 1206]| packets.push((time_ns, payload.to_vec()));
    for firing in firings {
        let (ranges, levels): (Vec<u32>, Vec<u8>) = firing.first.iter().copied().unzip();
        let second: Option<(Vec<u32>, Vec<u8>)> =
            firing.second.as_ref().map(|second| second.iter().copied().unzip());
        encoder.push_column(
            Column {
                time_ns: firing.time_ns,
                azimuth_rad: (firing.azimuth_counts / 100.0).to_radians(),
                range_mm: &ranges,
                reflectivity: &levels,
                second: second.as_ref().map(|(ranges, levels)| (&ranges[..], &levels[..])),
            },
            &mut take,
        );
    }
    encoder.finish(&mut take);
    packets
}

fn packet(payload: &[u8], host_time_ns: u64) -> Packet<'_> {
    let source = SocketAddr::from(([192, 168, 1, 201], 2368));
    let destination = SocketAddr::from(([255, 255, 255, 255], 2368));
    Packet { host_time_ns, source, destination, link: Default::default(), payload }
}

struct Outcome {
    frames: Vec<Frame>,
    stats: DecodeStats,
    rejected: Vec<Rejected>,
    product: Option<Product>,
}

fn decode<'a>(packets: impl IntoIterator<Item = (u64, &'a [u8])>, options: Options) -> Outcome {
    let mut decoder = VelodyneDecoder::new(options);
    let mut frames = Vec::new();
    let mut rejected = Vec::new();
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push(frame.clone());
        }
    };
    for (host_time_ns, payload) in packets {
        rejected.extend(decoder.push(&packet(payload, host_time_ns), &mut take).err());
    }
    decoder.finish(&mut take);
    let product = decoder.identity().map(|identity| identity.product);
    Outcome { stats: decoder.stats().clone(), product, rejected, frames }
}

/// Columns of all frames, one after the other.
fn firings(frames: &[Frame]) -> Vec<Firing> {
    let mut firings = Vec::new();
    for frame in frames {
        for column in 0..frame.columns() {
            let samples = column * frame.channels..(column + 1) * frame.channels;
            let zip = |layer: &crate::Layer| {
                let ranges = layer.range_mm[samples.clone()].iter().copied();
                ranges.zip(layer.reflectivity[samples.clone()].iter().copied()).collect()
            };
            firings.push(Firing {
                time_ns: frame.column_time_ns[column],
                azimuth_counts: frame.column_azimuth_rad[column].to_degrees() * 100.0,
                first: zip(&frame.first),
                second: frame.second.as_ref().map(zip),
            });
        }
    }
    firings
}
