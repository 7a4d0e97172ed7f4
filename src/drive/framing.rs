//! How frames lie on a serial line.

use firmware_protocol::{Frame, LinkCounters, Receiver as FrameReceiver};

use super::slcan::{self, SlcanReceiver};

/// How frames lie on the line.
pub(crate) enum Framing {
    /// The rig's own link layer.
    Stuffed(FrameReceiver),
    /// A CAN adapter's lines of text.
    Slcan(SlcanReceiver),
}

impl Framing {
    /// The bytes of a frame on such a line.
    pub(crate) fn encode(&self, frame: &Frame) -> Vec<u8> {
        match self {
            Self::Stuffed(_) => frame.encode().bytes().to_vec(),
            Self::Slcan(_) => slcan::encode(frame),
        }
    }

    /// Takes one byte; a frame when it was the last of one.
    pub(crate) fn push(&mut self, byte: u8) -> Option<Frame> {
        match self {
            Self::Stuffed(receiver) => receiver.push(byte),
            Self::Slcan(receiver) => receiver.push_frame(byte),
        }
    }

    /// What was seen so far.
    pub(crate) fn counters(&self) -> LinkCounters {
        match self {
            Self::Stuffed(receiver) => receiver.counters(),
            Self::Slcan(receiver) => receiver.counters(),
        }
    }
}
