//! Packets that wait to be decoded.

use std::net::SocketAddr;

use crate::{Link, Packet};

/// Packets in the order they came.
#[derive(Default)]
pub(super) struct Held {
    packets: Vec<HeldPacket>,
}

struct HeldPacket {
    host_time_ns: u64,
    source: SocketAddr,
    destination: SocketAddr,
    link: Link,
    payload: Box<[u8]>,
}

impl Held {
    pub(super) fn is_empty(&self) -> bool {
        self.packets.is_empty()
    }

    pub(super) fn len(&self) -> usize {
        self.packets.len()
    }

    pub(super) fn push(&mut self, packet: &Packet<'_>) {
        self.packets.push(HeldPacket::of(packet));
    }

    pub(super) fn packets(&self) -> impl Iterator<Item = Packet<'_>> {
        self.packets.iter().map(HeldPacket::packet)
    }
}

impl HeldPacket {
    fn of(packet: &Packet<'_>) -> Self {
        let Packet { host_time_ns, source, destination, link, payload } = *packet;
        Self { host_time_ns, source, destination, link, payload: payload.into() }
    }

    fn packet(&self) -> Packet<'_> {
        let Self { host_time_ns, source, destination, link, ref payload } = *self;
        Packet { host_time_ns, source, destination, link, payload }
    }
}
