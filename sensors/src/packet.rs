//! One UDP datagram, wherever it came from.

use std::net::SocketAddr;

/// A UDP datagram with its host arrival time; borrowed, because packets are many and short-lived.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'a> {
    /// Host arrival time, UTC nanoseconds since 1970; 0 when the source has no clock.
    pub host_time_ns: u64,
    /// Sender.
    pub source: SocketAddr,
    /// Receiver; its port is what tells lidar, IMU and position packets apart on a first look.
    pub destination: SocketAddr,
    /// UDP payload.
    pub payload: &'a [u8],
}
