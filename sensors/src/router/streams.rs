//! Packets that name no sensor, by source and destination: one unit sends its lidar packets from one
//! address to one port, and its inertial packets too.

use std::net::IpAddr;

use crate::Packet;

/// Most streams of one sensor that are counted separately.
const MOST_STREAMS: usize = 16;

/// Sender and destination port.
pub(super) type Stream = (IpAddr, u16);

pub(super) fn stream_of(packet: &Packet<'_>) -> Stream {
    (packet.source.ip(), packet.destination.port())
}

/// What of a recording could be one sensor's without saying so.
#[derive(Default)]
pub(super) struct Streams {
    /// Lidar packets that were the first to fit.
    lidar: Option<Stream>,
    /// Other lidar packets that fit as well and that no other sensor takes.
    rivals: Vec<Stream>,
    imu: Vec<Stream>,
}

impl Streams {
    pub(crate) fn note_lidar(&mut self, packet: &Packet<'_>) {
        self.lidar.get_or_insert(stream_of(packet));
    }

    pub(crate) fn note_rival(&mut self, packet: &Packet<'_>) {
        note(&mut self.rivals, packet);
    }

    pub(crate) fn note_imu(&mut self, packet: &Packet<'_>) {
        note(&mut self.imu, packet);
    }

    /// Whether lidar packets that fit are of another stream than the first.
    pub(crate) fn is_other_lidar(&self, packet: &Packet<'_>) -> bool {
        self.lidar.is_some_and(|own| own != stream_of(packet))
    }

    /// All that its lidar packets could be, where that is more than one.
    pub(crate) fn of_several(&self) -> Option<Vec<Stream>> {
        let all = self.lidar.iter().chain(&self.rivals).copied();
        (!self.rivals.is_empty()).then(|| all.collect())
    }

    /// The inertial packets that could be its own: those from these addresses, where any is known, and of several those to
    /// this port.
    pub(crate) fn imu(&self, sources: &[IpAddr], port: Option<u16>) -> Vec<Stream> {
        let from_there = |stream: &&Stream| sources.is_empty() || sources.contains(&stream.0);
        let all: Vec<Stream> = self.imu.iter().filter(from_there).copied().collect();
        match all.iter().filter(|(_, to)| Some(*to) == port).collect::<Vec<_>>()[..] {
            [only] => vec![*only],
            _ => all,
        }
    }
}

fn note(streams: &mut Vec<Stream>, packet: &Packet<'_>) {
    let stream = stream_of(packet);
    if streams.len() < MOST_STREAMS && !streams.contains(&stream) {
        streams.push(stream);
    }
}

/// Streams in words.
pub(super) fn listed(streams: &[Stream]) -> String {
    let words = |(address, port): &Stream| format!("{address} to port {port}");
    streams.iter().map(words).collect::<Vec<_>>().join(", ")
}
