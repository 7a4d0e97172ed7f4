//! A window on a stream: as much memory as the largest record that really is there, never what a length field claims.

use std::io::{self, Read};

/// Long enough that the cost of asking for more is lost in that of the bytes; not touched before it is filled.
const START: usize = 1 << 20;

pub(super) struct Buffer {
    read: Box<dyn Read + Send>,
    bytes: Vec<u8>,
    start: usize,
    end: usize,
    offset: u64,
}

impl Buffer {
    pub(super) fn new(read: Box<dyn Read + Send>) -> Self {
        Self { read, bytes: vec![0; START], start: 0, end: 0, offset: 0 }
    }

    /// Place of the window's start in the stream.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// Makes `length` bytes available if the stream has them; returns how many of them there are. `length` may come
    /// from the stream: memory grows only as bytes arrive.
    pub(super) fn fill(&mut self, length: usize) -> io::Result<usize> {
        while self.end - self.start < length {
            if self.start > 0 {
                self.bytes.copy_within(self.start..self.end, 0);
                self.end -= self.start;
                self.start = 0;
            }
            if self.end == self.bytes.len() {
                self.bytes.resize(self.bytes.len() * 2, 0);
            }
            match self.read.read(&mut self.bytes[self.end..]) {
                Ok(0) => break,
                Ok(count) => self.end += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(length.min(self.end - self.start))
    }

    /// What [`Buffer::fill`] made available.
    pub(super) fn available(&self) -> &[u8] {
        &self.bytes[self.start..self.end]
    }

    /// Moves on within what is available; returns the place of the bytes passed over, valid until the next fill.
    pub(super) fn consume(&mut self, length: usize) -> usize {
        let at = self.start;
        let length = length.min(self.end - self.start);
        self.start += length;
        self.offset += length as u64;
        at
    }

    /// Bytes at a place that [`Buffer::consume`] returned.
    pub(super) fn at(&self, place: std::ops::Range<usize>) -> &[u8] {
        &self.bytes[place]
    }

    /// Passes over `length` bytes without keeping them; returns how many there were.
    pub(super) fn skip(&mut self, length: u64) -> io::Result<u64> {
        let mut passed = 0;
        while passed < length {
            let step = (length - passed).min(START as u64) as usize;
            let have = self.fill(step)?;
            self.consume(have);
            passed += have as u64;
            if have < step {
                break;
            }
        }
        Ok(passed)
    }
}
