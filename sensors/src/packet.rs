//! One UDP datagram, wherever it came from.

use std::fmt;
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
    /// How it came to the host, where the recording says so: tells sensors with one address apart.
    pub link: Link,
    /// UDP payload.
    pub payload: &'a [u8],
}

/// Network card, VLAN and hardware address that a packet came by; the default where it is unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Link {
    /// Number of the interface in its recording.
    pub interface: u16,
    /// Identifier of the innermost VLAN; 0 without one.
    pub vlan: u16,
    /// Hardware address of the sender; zeros where the link has none.
    pub hardware: [u8; 6],
}

impl fmt::Display for Link {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "interface {}", self.interface)?;
        if self.vlan > 0 {
            write!(out, ", VLAN {}", self.vlan)?;
        }
        if self.hardware != [0; 6] {
            let octets: Vec<String> = self.hardware.iter().map(|octet| format!("{octet:02x}")).collect();
            write!(out, ", hardware address {}", octets.join(":"))?;
        }
        Ok(())
    }
}
