//! Bytes from an interrupt to the main loop: one writer, one reader, no lock.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// A ring of `N` bytes, of which `N - 1` can wait.
pub struct Queue<const N: usize> {
    bytes: [AtomicU8; N],
    head: AtomicUsize,
    tail: AtomicUsize,
}

impl<const N: usize> Default for Queue<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Queue<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        Self { bytes: [const { AtomicU8::new(0) }; N], head: AtomicUsize::new(0), tail: AtomicUsize::new(0) }
    }

    /// Adds a byte; a full ring drops it. Only one writer may call this.
    pub fn push(&self, byte: u8) {
        let head = self.head.load(Ordering::Relaxed);
        let next = (head + 1) % N;
        if next != self.tail.load(Ordering::Acquire) {
            self.bytes[head].store(byte, Ordering::Relaxed);
            self.head.store(next, Ordering::Release);
        }
    }

    /// Takes the oldest byte. Only one reader may call this.
    pub fn pop(&self) -> Option<u8> {
        let tail = self.tail.load(Ordering::Relaxed);
        if tail == self.head.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes[tail].load(Ordering::Relaxed);
        self.tail.store((tail + 1) % N, Ordering::Release);
        Some(byte)
    }

    /// How many bytes still fit.
    pub fn room(&self) -> usize {
        let (head, tail) = (self.head.load(Ordering::Relaxed), self.tail.load(Ordering::Acquire));
        (tail + N - head - 1) % N
    }
}
