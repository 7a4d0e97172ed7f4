//! A few packets held back, in order of device time: swapped ones fall into place, and each is decoded with its
//! successor in sight.

use std::collections::VecDeque;

use super::blocks::BadBlocks;
use super::heads::Start;
use super::wire::{DATA_PACKET_BYTES, DataPacket};

/// A packet with its resolved device time.
#[derive(Clone, Debug)]
pub(crate) struct Held {
    /// Device time of the stamp, ns.
    pub time_ns: u64,
    pub host_ns: u64,
    /// Blocks that could not be used; they are empty in the payload.
    pub bad: BadBlocks,
    pub payload: Box<[u8; DATA_PACKET_BYTES]>,
}

impl Held {
    /// When and where the packet starts.
    pub(crate) fn start(&self) -> Start {
        Start { time_ns: self.time_ns, azimuth_counts: DataPacket::of(&self.payload).azimuth(0) }
    }
}

/// Where a packet fell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// After all others.
    Last,
    /// Between others: it came after a later one.
    Between,
    /// It is here already.
    Duplicate,
}

#[derive(Debug, Default)]
pub(crate) struct Window {
    held: VecDeque<Held>,
    spare: Vec<Held>,
}

impl Window {
    pub(crate) fn len(&self) -> usize {
        self.held.len()
    }

    /// Copies a packet in.
    pub(crate) fn insert(
        &mut self,
        time_ns: u64,
        host_ns: u64,
        payload: &[u8; DATA_PACKET_BYTES],
        bad: BadBlocks,
    ) -> Place {
        let at = self.held.partition_point(|held| held.time_ns <= time_ns);
        let mut same_time = self.held.range(..at).rev().take_while(|held| held.time_ns == time_ns);
        if same_time.any(|held| *held.payload == *payload) {
            return Place::Duplicate;
        }
        let place = if at == self.held.len() { Place::Last } else { Place::Between };
        let mut held = match self.spare.pop() {
            Some(spare) => Held { time_ns, host_ns, bad, ..spare },
            None => Held { time_ns, host_ns, bad, payload: Box::new([0; DATA_PACKET_BYTES]) },
        };
        held.payload.copy_from_slice(payload);
        self.held.insert(at, held);
        place
    }

    pub(crate) fn pop(&mut self) -> Option<Held> {
        self.held.pop_front()
    }

    /// The packet that comes next.
    pub(crate) fn front(&self) -> Option<&Held> {
        self.held.front()
    }

    /// The packet that came in last, in order of time.
    pub(crate) fn back(&self) -> Option<&Held> {
        self.held.back()
    }

    /// Takes a buffer back for later packets.
    pub(crate) fn recycle(&mut self, held: Held) {
        self.spare.push(held);
    }
}
