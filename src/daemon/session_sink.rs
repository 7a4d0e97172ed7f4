//! Packets of the receive workers go into the session that is open, if one is.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use super::latency::Latency;
use crate::live::receive::{Datagram, now_ns};
use crate::recording::SessionWriter;

/// The open session, to be exchanged between two packets.
#[derive(Debug, Default)]
pub(super) struct SessionSink {
    session: RwLock<Option<Arc<SessionWriter>>>,
    /// The session refused packets.
    failed: AtomicBool,
    /// Packets and payload bytes handed to the session since it was opened.
    packets: AtomicU64,
    bytes: AtomicU64,
    /// From the kernel's stamp until the session took a packet.
    latency: Latency,
    /// Every write takes so long more: a slow disk, to be tested with.
    held_up: Duration,
}

impl SessionSink {
    /// Without a session.
    pub(crate) fn new(held_up: Duration) -> Self {
        Self { held_up, ..Self::default() }
    }

    /// Writes packets to the session; without one they are not recorded.
    pub(crate) fn write(&self, datagrams: &[Datagram]) {
        let session = self.session.read().unwrap_or_else(PoisonError::into_inner);
        let Some(writer) = &*session else { return };
        if !self.held_up.is_zero() {
            std::thread::sleep(self.held_up);
        }
        // the writer keeps the failure and counts what it does not take
        if writer.write_datagrams(datagrams).is_err() {
            self.failed.store(true, Ordering::Relaxed);
        }
        let bytes: usize = datagrams.iter().map(|datagram| datagram.packet().payload.len()).sum();
        self.packets.fetch_add(datagrams.len() as u64, Ordering::Relaxed);
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        if let [first, ..] = datagrams {
            self.latency.add(first.host_time_ns, now_ns());
        }
    }

    /// Puts another session in the place of the present one and returns that: every packet is in one of them.
    pub(crate) fn exchange(&self, session: Option<Arc<SessionWriter>>) -> Option<Arc<SessionWriter>> {
        let mut place = self.session.write().unwrap_or_else(PoisonError::into_inner);
        self.failed.store(false, Ordering::Relaxed);
        self.packets.store(0, Ordering::Relaxed);
        self.bytes.store(0, Ordering::Relaxed);
        std::mem::replace(&mut place, session)
    }

    /// Whether the session refused packets.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    /// Packets and payload bytes of the present session.
    pub(crate) fn counts(&self) -> [u64; 2] {
        [self.packets.load(Ordering::Relaxed), self.bytes.load(Ordering::Relaxed)]
    }

    /// From the kernel's stamp until a session took a packet.
    pub(crate) fn latency(&self) -> &Latency {
        &self.latency
    }
}
