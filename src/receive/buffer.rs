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
            payload: &self.payload.bytes[..self.payload.filled],
        }
    }
}

/// Bytes that return to their pool.
#[derive(Debug)]
pub(super) struct Buffer {
    pub(super) bytes: Vec<u8>,
    pub(super) filled: usize,
    pool: Arc<Pool>,
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
}

impl Pool {
    /// Keeps at most `keep` free buffers. They start at one Ethernet frame and grow with what arrives.
    pub(super) fn new(keep: usize) -> Arc<Self> {
        Arc::new(Self { free: Mutex::new(Vec::new()), buffer_bytes: AtomicUsize::new(1536), keep })
    }

    /// A buffer of the present length.
    pub(super) fn take(self: &Arc<Self>) -> Buffer {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let length = self.buffer_bytes.load(Ordering::Relaxed);
        let bytes = free.filter(|bytes| bytes.len() >= length).unwrap_or_else(|| vec![0; length]);
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
        }
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
}
