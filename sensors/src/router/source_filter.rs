//! Where a sensor sends from or to, as specified: separates units when their packets name no sensor.

use std::fmt;
use std::net::{IpAddr, SocketAddr};

use crate::Packet;

/// What a sensor's packets have in common, as somebody says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceFilter {
    /// They come from this address.
    Sender(IpAddr),
    /// Its lidar packets go to this port; what else it sends goes where it likes.
    Port(u16),
    /// They come from this address, and the lidar packets go to this port.
    Stream(SocketAddr),
}

impl SourceFilter {
    /// An address, a port behind a colon, or both: `192.168.1.10`, `:7502`, `192.168.1.10:7502`, `[fd00::10]:7502`. None where
    /// the text is none of them; an error where it is one with a port that there is not.
    pub fn from_text(text: &str) -> Option<Result<Self, String>> {
        if let Some(address) = address(text) {
            return Some(Ok(Self::Sender(address)));
        }
        let (sender, port) = text.rsplit_once(':')?;
        if port.is_empty() || !port.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        let sender = match sender {
            "" => None,
            // without brackets nothing tells the port from a part of the address
            sender if sender.contains(':') && !sender.starts_with('[') => return None,
            sender => Some(address(sender)?),
        };
        let Some(number) = port.parse().ok().filter(|number| *number > 0) else {
            return Some(Err(format!("{text}: there is no port {port}, expected 1 to {}", u16::MAX)));
        };
        Some(Ok(match sender {
            Some(address) => Self::Stream(SocketAddr::new(address, number)),
            None => Self::Port(number),
        }))
    }

    /// Whether a packet is of this sensor by it; none where it does not say.
    pub(super) fn holds(self, packet: &Packet<'_>, lidar_bytes: usize) -> Option<bool> {
        let goes_to = |port| (packet.payload.len() == lidar_bytes).then(|| packet.destination.port() == port);
        match self {
            Self::Sender(address) => Some(packet.source.ip() == address),
            Self::Port(port) => goes_to(port),
            Self::Stream(stream) if packet.source.ip() == stream.ip() => goes_to(stream.port()),
            Self::Stream(_) => Some(false),
        }
    }
}

/// An address, one of six in brackets or not.
fn address(text: &str) -> Option<IpAddr> {
    let bare = text.strip_prefix('[').and_then(|text| text.strip_suffix(']'));
    bare.map_or_else(|| text.parse().ok(), |bare| bare.parse().ok().map(IpAddr::V6))
}

impl fmt::Display for SourceFilter {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sender(address) => write!(out, "{address}"),
            Self::Port(port) => write!(out, ":{port}"),
            Self::Stream(stream) => write!(out, "{stream}"),
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
    /// Port of the auxiliary stream, if it is another.
    pub auxiliary_port: Option<u16>,
}

impl Named {
    /// Whether a Velodyne is meant by where its position packets come from and go to.
    pub(super) fn sends_auxiliary_from(&self, address: IpAddr, port: u16) -> bool {
        self.metadata.is_none()
            && self.port.is_some()
            && [self.port, self.auxiliary_port].contains(&Some(port))
            && self.source.is_none_or(|known| known == address)
    }

    /// Whether a sensor is meant: by its metadata, or by where its lidar packets come from and go to.
    pub(super) fn means(&self, metadata: Option<&str>, seen: Option<(SocketAddr, u16)>) -> bool {
        if self.metadata.is_some() && self.metadata.as_deref() == metadata {
            return true;
        }
        let Some((source, port)) = seen else { return false };
        self.port == Some(port) && self.source.is_none_or(|known| known == source.ip())
    }
}
