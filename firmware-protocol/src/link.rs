//! The serial link layer: `COBS( version u8 | sequence u8 | identifier u32 | data 0..=64 | CRC-32C u32 ) 00`.
//!
//! A receiver starts again at every zero byte, drops whatever is damaged and counts why.

use crate::can::{Direction, MessageId};
use crate::cobs;
use crate::command::Command;
use crate::crc::crc32c;
use crate::payload::{MAX_PAYLOAD, Payload};
use crate::report::Report;

/// Version of this layout.
pub const LINK_VERSION: u8 = 1;

/// The most data a frame of this layout may carry.
pub const MAX_DATA: usize = 64;

const HEADER: usize = 6;
const CHECKSUM: usize = 4;
/// Header, data, checksum, one byte of stuffing, the closing zero.
pub const MAX_WIRE: usize = HEADER + MAX_DATA + CHECKSUM + 2;

/// One whole frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Counts the sender's frames, wrapping.
    pub sequence: u8,
    /// What it is.
    pub id: MessageId,
    data: [u8; MAX_DATA],
    length: usize,
}

/// The bytes of one frame on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    bytes: [u8; MAX_WIRE],
    length: usize,
}

impl Wire {
    /// The bytes, closing zero included.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl Frame {
    /// A frame of a payload.
    pub fn new(sequence: u8, direction: Direction, node: u8, payload: &Payload) -> Self {
        const { assert!(MAX_PAYLOAD <= MAX_DATA) };
        let mut data = [0; MAX_DATA];
        data[..payload.bytes().len()].copy_from_slice(payload.bytes());
        let id = MessageId::new(payload.message(), direction, node);
        Self { sequence, id, data, length: payload.bytes().len() }
    }

    /// A command to a node.
    pub fn command(sequence: u8, node: u8, command: &Command) -> Self {
        Self::new(sequence, Direction::ToDevice, node, &command.encode())
    }

    /// A report of a node.
    pub fn report(sequence: u8, node: u8, report: &Report) -> Self {
        Self::new(sequence, Direction::ToHost, node, &report.encode())
    }

    /// A frame from a CAN bus, checked by its controller already: the identifier's 29 bits and the data. `None` when
    /// they are no rig's, or not of this version.
    pub fn from_can(identifier: u32, bytes: &[u8]) -> Option<Self> {
        let id = MessageId::decode(identifier).filter(|id| id.readable())?;
        let mut data = [0; MAX_DATA];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self { sequence: 0, id, data, length: bytes.len() })
    }

    /// The payload's bytes.
    pub fn data(&self) -> &[u8] {
        &self.data[..self.length]
    }

    /// The bytes on a serial line.
    pub fn encode(&self) -> Wire {
        let mut plain = [0; HEADER + MAX_DATA + CHECKSUM];
        plain[0] = LINK_VERSION;
        plain[1] = self.sequence;
        plain[2..HEADER].copy_from_slice(&self.id.encode().to_le_bytes());
        let end = HEADER + self.length;
        plain[HEADER..end].copy_from_slice(self.data());
        let checksum = crc32c(&plain[..end]).to_le_bytes();
        plain[end..end + CHECKSUM].copy_from_slice(&checksum);
        let mut bytes = [0; MAX_WIRE];
        let length = cobs::encode(&plain[..end + CHECKSUM], &mut bytes)
            .expect("74 bytes need one byte of stuffing, and 76 are there");
        Wire { bytes, length: length + 1 }
    }
}

/// What a receiver saw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Whole frames.
    pub frames: u32,
    /// Frames with a wrong checksum.
    pub checksum_errors: u32,
    /// Frames that are no frames: stuffing, length or identifier.
    pub malformed: u32,
    /// Runs of bytes longer than any frame.
    pub overlong: u32,
    /// Frames of another layout version.
    pub other_version: u32,
    /// Frames that the sender counted and that never came whole, or came out of order.
    pub gaps: u32,
}

/// Bytes to frames.
///
/// ```
/// use firmware_protocol::{Command, Frame, Receiver};
///
/// let order = Command::TimeSync { sequence: 5 };
/// let mut receiver = Receiver::default();
/// // whatever came before: a frame ends with the zero byte that no other byte of it is
/// let line = [&[0xAB, 0x00][..], Frame::command(0, 1, &order).encode().bytes()].concat();
/// let frame = line.iter().find_map(|byte| receiver.push(*byte)).unwrap();
/// assert_eq!(Command::decode(order.encode().message(), frame.data()), Ok(order));
/// assert_eq!((receiver.counters().frames, receiver.counters().malformed), (1, 1));
/// ```
#[derive(Clone, Debug)]
pub struct Receiver {
    buffer: [u8; MAX_WIRE],
    length: usize,
    overrun: bool,
    last_sequence: Option<u8>,
    counters: LinkCounters,
}

impl Default for Receiver {
    fn default() -> Self {
        Self {
            buffer: [0; MAX_WIRE],
            length: 0,
            overrun: false,
            last_sequence: None,
            counters: LinkCounters::default(),
        }
    }
}

impl Receiver {
    /// What was seen so far.
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Takes one byte; a frame when it was the last of a whole one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        if byte != 0 {
            if self.length < self.buffer.len() {
                self.buffer[self.length] = byte;
                self.length += 1;
            } else {
                self.overrun = true;
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.overrun) {
            self.counters.overlong = self.counters.overlong.wrapping_add(1);
            return None;
        }
        if length == 0 {
            return None;
        }
        let frame = self.parse(length)?;
        self.counters.frames = self.counters.frames.wrapping_add(1);
        if self.last_sequence.is_some_and(|last| frame.sequence != last.wrapping_add(1)) {
            self.counters.gaps = self.counters.gaps.wrapping_add(1);
        }
        self.last_sequence = Some(frame.sequence);
        Some(frame)
    }

    fn parse(&mut self, length: usize) -> Option<Frame> {
        let count = |counter: &mut u32| *counter = counter.wrapping_add(1);
        let plain = match cobs::decode(&mut self.buffer[..length]) {
            Some(plain) if (HEADER + CHECKSUM..=HEADER + MAX_DATA + CHECKSUM).contains(&plain) => plain,
            _ => {
                count(&mut self.counters.malformed);
                return None;
            }
        };
        let (body, checksum) = self.buffer[..plain].split_at(plain - CHECKSUM);
        if crc32c(body).to_le_bytes() != checksum {
            count(&mut self.counters.checksum_errors);
            return None;
        }
        if body[0] != LINK_VERSION {
            count(&mut self.counters.other_version);
            return None;
        }
        let Some(id) = MessageId::decode(u32::from_le_bytes([body[2], body[3], body[4], body[5]])) else {
            count(&mut self.counters.malformed);
            return None;
        };
        if !id.readable() {
            count(&mut self.counters.other_version);
            return None;
        }
        let mut data = [0; MAX_DATA];
        data[..body.len() - HEADER].copy_from_slice(&body[HEADER..]);
        Some(Frame { sequence: body[1], id, data, length: body.len() - HEADER })
    }
}
