//! The bytes of one message, and reading them back.

/// The most bytes a message carries: one classic CAN frame.
pub const MAX_PAYLOAD: usize = 8;

/// The bytes of one message with its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Payload {
    message: u8,
    bytes: [u8; MAX_PAYLOAD],
    length: usize,
}

impl Payload {
    /// An empty payload of the message with this number.
    pub(crate) fn new(message: u8) -> Self {
        Self { message, bytes: [0; MAX_PAYLOAD], length: 0 }
    }

    /// The message number.
    pub fn message(&self) -> u8 {
        self.message
    }

    /// The bytes that go on the wire.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Appends bytes. Layouts are fixed, so running over eight bytes is a mistake in this crate's own tables.
    pub(crate) fn with<const N: usize>(mut self, bytes: [u8; N]) -> Self {
        self.bytes[self.length..self.length + N].copy_from_slice(&bytes);
        self.length += N;
        self
    }
}

/// Why bytes are no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// No message of this direction has this number.
    UnknownMessage(u8),
    /// The message has another length.
    Length {
        /// The message number.
        message: u8,
        /// Bytes its layout has.
        expected: usize,
        /// Bytes that came.
        found: usize,
    },
    /// A field holds a value that means nothing.
    Value {
        /// The message number.
        message: u8,
        /// What the field held.
        found: u8,
    },
}

impl core::fmt::Display for DecodeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::UnknownMessage(message) => write!(f, "no message has the number 0x{message:02x}"),
            Self::Length { message, expected, found } => {
                write!(f, "message 0x{message:02x} has {found} bytes, expected {expected}")
            }
            Self::Value { message, found } => {
                write!(f, "message 0x{message:02x} holds 0x{found:02x} where that means nothing")
            }
        }
    }
}

impl core::error::Error for DecodeError {}

/// Reads a payload field by field; the length was checked when it was made.
pub(crate) struct Fields<'a> {
    message: u8,
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    pub(crate) fn new(message: u8, data: &'a [u8], expected: usize) -> Result<Self, DecodeError> {
        if data.len() == expected {
            Ok(Self { message, rest: data })
        } else {
            Err(DecodeError::Length { message, expected, found: data.len() })
        }
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        let (head, rest) = self.rest.split_at(N.min(self.rest.len()));
        bytes[..head.len()].copy_from_slice(head);
        self.rest = rest;
        bytes
    }

    pub(crate) fn u8(&mut self) -> u8 {
        self.take::<1>()[0]
    }

    pub(crate) fn i8(&mut self) -> i8 {
        i8::from_le_bytes(self.take())
    }

    pub(crate) fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    pub(crate) fn i16(&mut self) -> i16 {
        i16::from_le_bytes(self.take())
    }

    pub(crate) fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    pub(crate) fn i32(&mut self) -> i32 {
        i32::from_le_bytes(self.take())
    }

    pub(crate) fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    /// Three bytes, two's complement.
    pub(crate) fn i24(&mut self) -> i32 {
        let [low, middle, high] = self.take::<3>();
        i32::from_le_bytes([0, low, middle, high]) >> 8
    }

    /// Six bytes.
    pub(crate) fn u48(&mut self) -> u64 {
        let [a, b, c, d, e, f] = self.take::<6>();
        u64::from_le_bytes([a, b, c, d, e, f, 0, 0])
    }

    /// A byte that must have a meaning.
    pub(crate) fn known<T>(&mut self, meaning: fn(u8) -> Option<T>) -> Result<T, DecodeError> {
        let found = self.u8();
        meaning(found).ok_or(DecodeError::Value { message: self.message, found })
    }
}

/// The lower three bytes of an angle; [`crate::command::PAIR_RANGE_URAD`] bounds what they hold.
pub(crate) fn i24_bytes(value: i32) -> [u8; 3] {
    let [low, middle, high, _] = value.to_le_bytes();
    [low, middle, high]
}

/// The lower six bytes of a time.
pub(crate) fn u48_bytes(value: u64) -> [u8; 6] {
    let [a, b, c, d, e, f, ..] = value.to_le_bytes();
    [a, b, c, d, e, f]
}
