//! UDP sockets to packets, with every loss counted and named.
//!
//! One thread runs a single-threaded tokio runtime with one task per socket, so that nothing else the program does on
//! its runtime can hold up receiving; the consumer takes datagrams from a bounded queue, blocking or `await`ing. Each
//! datagram carries the kernel's arrival time (`SO_TIMESTAMPNS`), and the kernel's own drop counter is read with each
//! datagram (`SO_RXQ_OVFL`) and once more when the socket closes (`SO_MEMINFO`: the drops after the last datagram).
//!
//! What can be lost, and the counter that says so: the socket's buffer was full ([`SocketCounters::kernel_dropped`]),
//! the queue to the consumer was full ([`SensorCounters::queue_dropped`]), the sender is none of the sensors
//! ([`SocketCounters::foreign_source`]).

mod buffer;
mod counters;
mod data_timeout;
mod socket;
mod thread;

pub use buffer::Datagram;
pub use counters::{Memory, Monitor, ReceiveLoss, SensorCounters, SocketCounters, SocketReport, Tally};
pub use data_timeout::{DataTimeout, DataTimeouts};
pub use thread::{Receiver, Stop};

use std::net::{IpAddr, SocketAddr};
use std::time::{SystemTime, UNIX_EPOCH};

/// One sensor to listen to. Sensors that send to the same address differ by their source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listen {
    /// The sensor's name.
    pub name: String,
    /// Local address and port; port 0 takes any free one. A multicast group is joined.
    pub address: SocketAddr,
    /// Take only what comes from here; `None` takes every sender that no other sensor of this address names.
    pub source: Option<IpAddr>,
}

/// How much may wait before something is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Bytes of kernel buffer asked for, per socket (`SO_RCVBUF`).
    pub receive_buffer_bytes: usize,
    /// Datagrams that may wait for the consumer; one more is dropped and counted.
    pub queue_datagrams: usize,
    /// The same in bytes of memory.
    pub queue_bytes: usize,
}

impl Default for Options {
    /// 8 MiB: 0.4 s of the busiest Ouster (OS1-128 at 1024x20, dual return); 4096 datagrams: above 0.6 s of the
    /// sensor with the most packets (Alpha Prime, 6250 a second); 64 MiB: 3 s of that Ouster.
    fn default() -> Self {
        Self { receive_buffer_bytes: 8 << 20, queue_datagrams: 4096, queue_bytes: 64 << 20 }
    }
}

/// The system's clock, which is the kernel's arrival clock: UTC nanoseconds since 1970.
pub fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_nanos() as u64)
}

/// Why receiving cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum ReceiveError {
    /// Nothing to listen to.
    #[error("no sensor to listen to")]
    Nothing,
    /// Two sensors that cannot be distinguished.
    #[error(
        "sensors {first} and {second} both listen on {address} from {from}: give each its own port or source"
    )]
    SameAddress {
        /// A sensor.
        first: String,
        /// Another.
        second: String,
        /// Where both listen.
        address: SocketAddr,
        /// The source both accept.
        from: String,
    },
    /// The address cannot be had.
    #[error("cannot listen on {address} for sensor {name}: {source}{hint}")]
    Bind {
        /// The sensor.
        name: String,
        /// Where.
        address: SocketAddr,
        /// What to try, or nothing.
        hint: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// The system refuses a thread or a runtime.
    #[error("cannot start the receiving thread: {0}")]
    Thread(std::io::Error),
}

const AUXILIARY: &str = "-aside";

/// Name in a session of a sensor's auxiliary stream (IMU, position packets), where that has a port of its own.
pub(crate) fn auxiliary_name(sensor: &str) -> String {
    format!("{sensor}{AUXILIARY}")
}

/// Whether a name is that of the auxiliary stream of one of these sensors.
pub(crate) fn is_auxiliary<'a>(name: &str, mut sensors: impl Iterator<Item = &'a str>) -> bool {
    sensors.any(|sensor| auxiliary_name(sensor) == name)
}
