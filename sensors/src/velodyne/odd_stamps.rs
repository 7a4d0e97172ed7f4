//! Counts of packets with time stamps that contradict those before them.

use super::blocks::BadBlocks;
use super::clock::{HourClock, Stamp};
use super::wire::DATA_PACKET_BYTES;

/// So many odd stamps that go on from each other, while others come between them, are another clock's.
const SECOND_CLOCK: u32 = 4;

/// A packet that waits until it is clear when it was sent.
#[derive(Debug)]
pub(super) struct Doubted {
    pub stamp: Stamp,
    pub bad: BadBlocks,
    pub payload: Box<[u8; DATA_PACKET_BYTES]>,
}

/// Whether odd stamps are those of a second sensor.
#[derive(Debug, Default)]
pub(super) struct SecondClock {
    last: Option<Stamp>,
    packets: u32,
}

impl SecondClock {
    pub(crate) fn is_certain(&self) -> bool {
        self.packets >= SECOND_CLOCK
    }

    /// Takes an odd stamp that came between others; whether it is of the second clock.
    pub(crate) fn take(&mut self, stamp: Stamp) -> bool {
        let goes_on =
            self.last.is_some_and(|last| HourClock::goes_on(last, Stamp { is_next: false, ..stamp }));
        if goes_on {
            self.packets += 1;
        } else if !self.is_certain() {
            self.packets = 0;
        }
        if goes_on || !self.is_certain() {
            self.last = Some(stamp);
        }
        goes_on && self.is_certain()
    }
}
