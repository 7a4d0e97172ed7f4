//! What was received and what was lost, readable while it happens.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Counters of one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SensorCounters {
    /// Datagrams handed to the consumer.
    pub packets: u64,
    /// Their payload bytes.
    pub bytes: u64,
    /// Datagrams dropped because the queue to the consumer was full.
    pub queue_dropped: u64,
    /// Kernel arrival time of the last one, UTC ns; 0 before the first.
    pub last_time_ns: u64,
}

/// Counters of one socket.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SocketCounters {
    /// Datagrams the kernel dropped, for want of buffer in nearly all cases.
    pub kernel_dropped: u64,
    /// Datagrams from a sender that is none of the sensors.
    pub foreign_source: u64,
    /// The first such sender.
    pub first_foreign_source: Option<SocketAddr>,
    /// Datagrams without a kernel time, stamped when they were read.
    pub stamped_late: u64,
    /// Errors the socket reported (a device that went down, for example); receiving went on.
    pub socket_errors: u64,
}

/// A socket: where it listens, for whom, and what it counted.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SocketReport {
    /// Local address, with the port in use.
    pub address: SocketAddr,
    /// Names of its sensors.
    pub sensors: Vec<String>,
    /// Kernel buffer asked for, bytes.
    pub asked_buffer_bytes: usize,
    /// Kernel buffer granted, bytes (half of what `SO_RCVBUF` reads: the kernel doubles it for its own bookkeeping).
    pub granted_buffer_bytes: usize,
    /// Counters.
    #[serde(flatten)]
    pub counters: SocketCounters,
}

impl SocketReport {
    /// What to do when the kernel grants less buffer than asked.
    pub(crate) fn buffer_warning(&self) -> Option<String> {
        (self.granted_buffer_bytes < self.asked_buffer_bytes).then(|| {
            format!(
                "the kernel grants {} of {} bytes of receive buffer on {}: raise it with `sysctl -w net.core.rmem_max={}`",
                self.granted_buffer_bytes, self.asked_buffer_bytes, self.address, self.asked_buffer_bytes
            )
        })
    }
}

/// What receiving lost, and where it listened: enough to close a session with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// By sensor, in the order the receiver was given.
    pub sensors: Vec<ReceiveLoss>,
    /// Sockets with their counters.
    pub sockets: Vec<SocketReport>,
}

/// What one sensor lost before the consumer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveLoss {
    /// Dropped by the kernel; a socket shared by several sensors counts for its first.
    pub kernel_dropped: u64,
    /// Dropped because the queue to the consumer was full.
    pub queue_dropped: u64,
}

impl Tally {
    /// What was added since an earlier tally of the same receiver; the sockets are named as they are now.
    #[must_use]
    pub(crate) fn since(&self, earlier: &Self) -> Self {
        let mut since = self.clone();
        for (loss, before) in since.sensors.iter_mut().zip(&earlier.sensors) {
            loss.kernel_dropped -= before.kernel_dropped;
            loss.queue_dropped -= before.queue_dropped;
        }
        for (socket, before) in since.sockets.iter_mut().zip(&earlier.sockets) {
            let (now, before) = (&mut socket.counters, &before.counters);
            now.kernel_dropped -= before.kernel_dropped;
            now.foreign_source -= before.foreign_source;
            now.stamped_late -= before.stamped_late;
            now.socket_errors -= before.socket_errors;
            if now.foreign_source == 0 {
                now.first_foreign_source = None;
            }
        }
        since
    }

    /// Packets that were lost.
    pub(crate) fn lost(&self) -> u64 {
        self.sensors.iter().map(|sensor| sensor.kernel_dropped + sensor.queue_dropped).sum()
    }
}

/// Memory of a receiver's datagrams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Bytes of all buffers, free, waiting or in the consumer's hands.
    pub held_bytes: usize,
    /// Of these, what waits for the consumer now.
    pub waiting_bytes: usize,
    /// The most that ever waited.
    pub max_waiting_bytes: usize,
}

/// A view of the counters that outlives the receiver.
#[derive(Clone, Debug)]
pub struct Monitor {
    pub(super) sockets: Arc<Vec<SocketCells>>,
    pub(super) sensors: Arc<Vec<SensorCells>>,
    pub(super) held: Arc<AtomicUsize>,
    pub(super) waiting: Arc<Waiting>,
}

/// Bytes of buffers in the queue to the consumer.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    now: AtomicUsize,
    most: AtomicUsize,
}

impl Waiting {
    pub(super) fn bytes(&self) -> usize {
        self.now.load(Ordering::Relaxed)
    }

    pub(super) fn add(&self, bytes: usize) {
        let now = self.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.most.fetch_max(now, Ordering::Relaxed);
    }

    pub(super) fn take(&self, bytes: usize) {
        self.now.fetch_sub(bytes, Ordering::Relaxed);
    }
}

impl Monitor {
    /// Counters of each sensor, in the order the receiver was given.
    pub fn sensors(&self) -> Vec<SensorCounters> {
        self.sensors.iter().map(SensorCells::read).collect()
    }

    /// Each socket with its counters.
    pub fn sockets(&self) -> Vec<SocketReport> {
        self.sockets.iter().map(SocketCells::read).collect()
    }

    /// What was lost so far.
    pub(crate) fn tally(&self) -> Tally {
        let queue = self.sensors.iter().map(|sensor| sensor.queue_dropped.load(Ordering::Relaxed));
        let losses = self.kernel_drops().into_iter().zip(queue);
        Tally {
            sensors: losses
                .map(|(kernel_dropped, queue_dropped)| ReceiveLoss { kernel_dropped, queue_dropped })
                .collect(),
            sockets: self.sockets(),
        }
    }

    /// Memory of the datagrams.
    pub fn memory(&self) -> Memory {
        Memory {
            held_bytes: self.held.load(Ordering::Relaxed),
            waiting_bytes: self.waiting.bytes(),
            max_waiting_bytes: self.waiting.most.load(Ordering::Relaxed),
        }
    }

    /// The local address of a sensor.
    pub(crate) fn address(&self, sensor: usize) -> SocketAddr {
        self.sockets[self.sensors[sensor].socket].about.address
    }

    /// Per sensor, the datagrams the kernel dropped. The kernel does not name the sensor: a socket shared by several
    /// sensors counts for its first.
    pub fn kernel_drops(&self) -> Vec<u64> {
        let mut drops = vec![0; self.sensors.len()];
        for socket in self.sockets.iter() {
            drops[socket.first_sensor] += socket.kernel_dropped.load(Ordering::Relaxed);
        }
        drops
    }
}

/// The live counters of one sensor.
#[derive(Debug, Default)]
pub(super) struct SensorCells {
    pub(super) socket: usize,
    pub(super) packets: AtomicU64,
    pub(super) bytes: AtomicU64,
    pub(super) queue_dropped: AtomicU64,
    pub(super) last_time_ns: AtomicU64,
}

impl SensorCells {
    fn read(&self) -> SensorCounters {
        SensorCounters {
            packets: self.packets.load(Ordering::Relaxed),
            bytes: self.bytes.load(Ordering::Relaxed),
            queue_dropped: self.queue_dropped.load(Ordering::Relaxed),
            last_time_ns: self.last_time_ns.load(Ordering::Relaxed),
        }
    }
}

/// The live counters of one socket.
#[derive(Debug)]
pub(super) struct SocketCells {
    pub(super) about: SocketReport,
    pub(super) first_sensor: usize,
    pub(super) kernel_dropped: AtomicU64,
    pub(super) foreign_source: AtomicU64,
    pub(super) first_foreign_source: Mutex<Option<SocketAddr>>,
    pub(super) stamped_late: AtomicU64,
    pub(super) socket_errors: AtomicU64,
}

impl SocketCells {
    pub(super) fn new(about: SocketReport, first_sensor: usize) -> Self {
        Self {
            about,
            first_sensor,
            kernel_dropped: AtomicU64::new(0),
            foreign_source: AtomicU64::new(0),
            first_foreign_source: Mutex::new(None),
            stamped_late: AtomicU64::new(0),
            socket_errors: AtomicU64::new(0),
        }
    }

    pub(super) fn count_foreign(&self, source: SocketAddr) {
        if self.foreign_source.fetch_add(1, Ordering::Relaxed) == 0 {
            *self.first_foreign_source.lock().unwrap_or_else(PoisonError::into_inner) = Some(source);
        }
    }

    fn read(&self) -> SocketReport {
        let counters = SocketCounters {
            kernel_dropped: self.kernel_dropped.load(Ordering::Relaxed),
            foreign_source: self.foreign_source.load(Ordering::Relaxed),
            first_foreign_source: *self.first_foreign_source.lock().unwrap_or_else(PoisonError::into_inner),
            stamped_late: self.stamped_late.load(Ordering::Relaxed),
            socket_errors: self.socket_errors.load(Ordering::Relaxed),
        };
        SocketReport { counters, ..self.about.clone() }
    }
}
