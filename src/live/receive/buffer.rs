//! Reused datagram buffers: no allocation per packet once the queue has been full once.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use sensors::Packet;

/// A received datagram. Its buffer goes back to the receiver when it is dropped.
#[derive(Debug)]
pub struct Datagram {
    /// Position of the sensor in the list that the receiver was given.
    pub sensor: usize,
    /// When the kernel received it, UTC nanoseconds since 1970.
    pub host_time_ns: u64,
    /// Sender.
    pub source: SocketAddr,
    /// The address it was sent to.
    pub destination: SocketAddr,
    pub(super) payload: Buffer,
}

impl Datagram {
    /// The datagram as decoders and recorders take it.
    pub fn packet(&self) -> Packet<'_> {
        Packet {
            host_time_ns: self.host_time_ns,
            source: self.source,
            destination: self.destination,
            link: Default::default(),
            payload: &self.payload.bytes[..self.payload.filled],
        }
    }

    /// Bytes of memory it takes: those of the longest datagram of its receiver.
    pub(crate) fn held_bytes(&self) -> usize {
        self.payload.bytes.len()
    }
}

/// Bytes that return to their pool.
#[derive(Debug)]
pub(super) struct Buffer {
    bytes: Vec<u8>,
    filled: usize,
    pool: Arc<Pool>,
}

impl Buffer {
    /// All of it, for a datagram to be put into.
    pub(super) fn room(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// A datagram fills so many bytes, of which the last did not fit.
    pub(super) fn fill(&mut self, length: usize, overflow: &[u8]) {
        if !overflow.is_empty() {
            self.pool.count(overflow.len() as isize);
            self.bytes.extend_from_slice(overflow);
        }
        self.filled = length;
    }

    /// Bytes of the datagram.
    pub(super) fn filled(&self) -> usize {
        self.filled
    }

    /// Bytes of memory.
    pub(super) fn held(&self) -> usize {
        self.bytes.len()
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.pool.take_back(std::mem::take(&mut self.bytes));
    }
}

/// Free buffers, all about as long as the longest datagram so far.
#[derive(Debug)]
pub(super) struct Pool {
    free: Mutex<Vec<Vec<u8>>>,
    buffer_bytes: AtomicUsize,
    keep: usize,
    /// Bytes of all buffers, free and in use.
    held: Arc<AtomicUsize>,
}

impl Pool {
    /// Keeps at most `keep` free buffers. They start at one Ethernet frame and grow with what arrives.
    pub(super) fn new(keep: usize) -> Arc<Self> {
        let buffer_bytes = AtomicUsize::new(1536);
        Arc::new(Self { free: Mutex::default(), buffer_bytes, keep, held: Arc::default() })
    }

    /// Bytes of all buffers, free and in use, to be read at any time.
    pub(super) fn held(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.held)
    }

    /// A buffer of the present length.
    pub(super) fn take(self: &Arc<Self>) -> Buffer {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let length = self.buffer_bytes.load(Ordering::Relaxed);
        let bytes = match free {
            Some(bytes) if bytes.len() >= length => bytes,
            short => {
                let before = short.map_or(0, |short| short.len());
                self.count(length as isize - before as isize);
                vec![0; length]
            }
        };
        Buffer { bytes, filled: 0, pool: Arc::clone(self) }
    }

    /// From now on buffers hold at least `length`.
    pub(super) fn grow(&self, length: usize) {
        self.buffer_bytes.fetch_max(length.next_multiple_of(256), Ordering::Relaxed);
    }

    fn take_back(&self, bytes: Vec<u8>) {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.len() < self.keep && bytes.len() >= self.buffer_bytes.load(Ordering::Relaxed) {
            free.push(bytes);
        } else {
            self.count(-(bytes.len() as isize));
        }
    }

    fn count(&self, more: isize) {
        self.held.fetch_add(more as usize, Ordering::Relaxed); // wraps: less is a sum too
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_come_back_and_short_ones_do_not() {
        let pool = Pool::new(2);
        let first = pool.take();
        let address = first.bytes.as_ptr();
        drop(first);
        let again = pool.take();
        assert_eq!(again.bytes.as_ptr(), address, "reused");
        pool.grow(24_896);
        drop(again);
        assert_eq!(pool.take().bytes.len(), 25_088, "too short a buffer is given up");
    }

    #[test]
    fn every_byte_is_counted() {
        let pool = Pool::new(2);
        let held = || pool.held().load(Ordering::Relaxed);
        let mut many: Vec<Buffer> = (0..5).map(|_| pool.take()).collect();
        assert_eq!(held(), 5 * 1536);
        many[0].fill(1600, &[7; 64]);
        assert_eq!((held(), many[0].held(), many[0].filled()), (5 * 1536 + 64, 1600, 1600));
        many.clear();
        assert_eq!(held(), 1536 + 1600, "two are held");
        pool.grow(4096);
        drop([pool.take(), pool.take(), pool.take()]);
        assert_eq!(held(), 2 * 4096);
    }
}
