//! By which ways the packets of a Velodyne come: several with one factory address, on several network cards or VLANs or behind
//! several source ports, are several sensors.

use std::collections::VecDeque;
use std::net::SocketAddr;

use crate::{Link, Packet};

/// A sensor that sent nothing for so long may be back by another path, ns.
const GONE_NS: u64 = 100_000_000;
/// Packets that are remembered, to know one again that comes by two ways (a bridge, a mirrored port).
const REMEMBERED: usize = 16;
/// Ways that bring a sensor's packets a second time.
const MOST_COPIES: usize = 4;

/// One path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Path {
    pub source: SocketAddr,
    pub link: Link,
}

impl Path {
    pub(crate) fn of(packet: &Packet<'_>) -> Self {
        Self { source: packet.source, link: packet.link }
    }
}

/// Those of one sensor.
#[derive(Default)]
pub(super) struct Paths {
    current: Option<Path>,
    copies: Vec<Path>,
    last_ns: u64,
    recent: VecDeque<[u8; 22]>,
    /// Where its position packets come by.
    pub auxiliary: Option<Link>,
}

impl Paths {
    /// The path of its data packets.
    pub(crate) fn current(&self) -> Option<Path> {
        self.current
    }

    /// Whether a data packet comes by one of its ways.
    pub(crate) fn has(&self, packet: &Packet<'_>) -> bool {
        let path = Path::of(packet);
        self.current == Some(path) || self.copies.contains(&path)
    }

    /// Whether none of its data packets was seen, and its position packets, if any, came by this link.
    pub(crate) fn is_open_to(&self, packet: &Packet<'_>) -> bool {
        self.current.is_none() && self.auxiliary.is_none_or(|link| link == packet.link)
    }

    /// Whether this very packet was there just now.
    pub(crate) fn knows(&self, packet: &Packet<'_>) -> bool {
        glance(packet).is_some_and(|glance| self.recent.contains(&glance))
    }

    /// Whether nothing came any more by the path that its packets took.
    pub(crate) fn is_gone(&self, packet: &Packet<'_>) -> bool {
        packet.host_time_ns > 0 && packet.host_time_ns.abs_diff(self.last_ns) >= GONE_NS
    }

    /// A path that brings its packets again.
    pub(crate) fn note_copy(&mut self, packet: &Packet<'_>) {
        if self.copies.len() < MOST_COPIES {
            self.copies.push(Path::of(packet));
        }
    }

    /// One of its data packets.
    pub(crate) fn note(&mut self, packet: &Packet<'_>) {
        let path = Path::of(packet);
        if !self.copies.contains(&path) {
            self.current = Some(path);
            self.last_ns = packet.host_time_ns;
        }
        if let Some(glance) = glance(packet) {
            if self.recent.len() == REMEMBERED {
                self.recent.pop_front();
            }
            self.recent.push_back(glance);
        }
    }
}

/// What tells one data packet from another: its first measurements and its time.
fn glance(packet: &Packet<'_>) -> Option<[u8; 22]> {
    let mut glance = [0; 22];
    glance[..16].copy_from_slice(packet.payload.first_chunk::<16>()?);
    glance[16..].copy_from_slice(packet.payload.last_chunk::<6>()?);
    Some(glance)
}
