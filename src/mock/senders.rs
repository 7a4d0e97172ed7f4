//! The senders of a recording, each with an address of its own on loopback.

use std::collections::BTreeMap;
use std::net::IpAddr;

use super::transmit::Transmitter;

/// Senders that are distinguished and listed.
pub(crate) const MAX_SENDERS: usize = 8;

/// Where the packets of each sender of the recording leave from: on loopback each has an address of its own, so that
/// a receiver distinguishes them as before.
pub(crate) struct SenderSockets {
    pub(crate) transmitter: Transmitter,
    /// Address of the first socket.
    first: IpAddr,
    of: BTreeMap<IpAddr, (usize, IpAddr)>,
}

impl SenderSockets {
    pub(crate) fn new(transmitter: Transmitter) -> std::io::Result<Self> {
        let first = transmitter.local_addr()?.ip();
        Ok(Self { transmitter, first, of: BTreeMap::new() })
    }

    /// Socket of a sender, and the address that its packets come from.
    pub(crate) fn of(&mut self, sender: IpAddr) -> (usize, IpAddr) {
        if let Some(known) = self.of.get(&sender) {
            return *known;
        }
        let mut socket = (0, self.first);
        if let IpAddr::V4(first) = self.first
            && first.is_loopback()
            && (1..MAX_SENDERS).contains(&self.of.len())
        {
            let next = IpAddr::from(std::net::Ipv4Addr::from_bits(first.to_bits() + self.of.len() as u32));
            // Linux has all of 127.0.0.0/8; where it is not so, all leave from one
            if let Ok(number) = self.transmitter.add_socket(next) {
                socket = (number, next);
            }
        }
        if self.of.len() < MAX_SENDERS {
            self.of.insert(sender, socket);
        }
        socket
    }
}
