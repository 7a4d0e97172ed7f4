//! Where a sensor is said to send from or to: tells units apart whose packets do not say whose they are.

use std::fmt;
use std::net::{IpAddr, SocketAddr};

use crate::Packet;

/// What a sensor's packets have in common, as somebody says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tie {
    /// They come from this address.
    Sender(IpAddr),
    /// Its lidar packets go to this port; what else it sends goes where it likes.
    Port(u16),
}

impl Tie {
    /// An address, or a port behind a colon.
    pub fn from_text(text: &str) -> Option<Self> {
        match text.strip_prefix(':') {
            Some(port) => port.parse().ok().map(Self::Port),
            None => text.parse().ok().map(Self::Sender),
        }
    }

    /// Whether a packet is of this sensor by it; none where it does not say.
    pub(super) fn holds(self, packet: &Packet<'_>, lidar_bytes: usize) -> Option<bool> {
        match self {
            Self::Sender(address) => Some(packet.source.ip() == address),
            Self::Port(port) => {
                (packet.payload.len() == lidar_bytes).then(|| packet.destination.port() == port)
            }
        }
    }
}

impl fmt::Display for Tie {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sender(address) => write!(out, "{address}"),
            Self::Port(port) => write!(out, ":{port}"),
        }
    }
}

/// How a sensor is called where it sends so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Name of its metadata, where it has some.
    pub metadata: Option<String>,
    /// Where its packets come from, where that is known.
    pub source: Option<IpAddr>,
    /// Port that its lidar packets go to.
    pub port: Option<u16>,
}

impl Named {
    /// Whether a sensor is meant: by its metadata, or by where its lidar packets come from and go to.
    pub(super) fn means(&self, metadata: Option<&str>, seen: Option<(SocketAddr, u16)>) -> bool {
        if self.metadata.is_some() && self.metadata.as_deref() == metadata {
            return true;
        }
        let Some((source, port)) = seen else { return false };
        self.port == Some(port) && self.source.is_none_or(|known| known == source.ip())
    }
}
