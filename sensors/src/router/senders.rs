//! Two units that claim to be one: packets of both, assigned to one, would count as thousands lost.

use std::net::SocketAddr;

use crate::Packet;

/// A unit that sent nothing for so long may be back from elsewhere, ns; with two known senders, much longer: on a busy
/// host packets come in bursts.
const GONE_NS: u64 = 1_000_000_000;
const GONE_WITH_RIVAL_NS: u64 = 10_000_000_000;
/// The same in packets in a row that came from elsewhere, where a recording has no times.
const GONE_PACKETS: u32 = 256;
/// Lengths of packets that are watched: lidar, inertial and zone packets, which need not leave from one port.
const MOST_LENGTHS: usize = 8;

/// Where the packets of one unit come from.
#[derive(Default)]
pub(super) struct Senders {
    /// By length.
    current: Vec<(usize, Sender)>,
    rival: Option<Rival>,
}

struct Sender {
    source: SocketAddr,
    last_ns: u64,
    /// Packets from elsewhere since.
    others: u32,
}

/// Another source of packets that claim to be this sensor's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rival {
    /// The sender that is accepted.
    pub accepted: SocketAddr,
    /// The first other.
    pub other: SocketAddr,
    /// Packets of others, which were left out.
    pub packets: u64,
}

impl Senders {
    /// Whether a packet comes from where this unit's come from, which may change when nothing comes from there any more.
    pub(crate) fn admit(&mut self, packet: &Packet<'_>) -> bool {
        let length = packet.payload.len();
        let Some((_, known)) = self.current.iter_mut().find(|(of, _)| *of == length) else {
            if self.current.len() < MOST_LENGTHS {
                self.current.push((length, Sender::of(packet)));
            }
            return true;
        };
        known.others = if known.source == packet.source { 0 } else { known.others + 1 };
        let gone_ns = if self.rival.is_some() { GONE_WITH_RIVAL_NS } else { GONE_NS };
        let is_gone = match packet.host_time_ns {
            0 => known.others > GONE_PACKETS,
            time_ns => known.last_ns.abs_diff(time_ns) >= gone_ns,
        };
        if known.others == 0 || is_gone {
            *known = Sender::of(packet);
            return true;
        }
        let (accepted, other) = (known.source, packet.source);
        self.rival.get_or_insert(Rival { accepted, other, packets: 0 }).packets += 1;
        false
    }

    pub(crate) fn rival(&self) -> Option<&Rival> {
        self.rival.as_ref()
    }
}

impl Sender {
    fn of(packet: &Packet<'_>) -> Self {
        Self { source: packet.source, last_ns: packet.host_time_ns, others: 0 }
    }
}
