//! A mock sensor's packets: faults, destinations, counts.

use std::io;
use std::net::{IpAddr, SocketAddr};

use super::{FaultCounts, FaultInjector, PacketStream};
use crate::mock::transmit::Transmitter;
use crate::mock::web::MockWeb;

#[derive(Debug, thiserror::Error)]
#[error("cannot send to {to}")]
pub(crate) struct Unsent {
    to: SocketAddr,
    source: io::Error,
}

/// Why sending ended early.
pub(crate) enum Ended {
    Died,
    Interrupted,
    Unsent(Unsent),
}

impl From<Unsent> for Ended {
    fn from(unsent: Unsent) -> Self {
        Self::Unsent(unsent)
    }
}

pub(crate) struct Sender<'a> {
    pub(crate) output: Output<'a>,
    pub(crate) injector: FaultInjector,
    pub(crate) start_ns: u64,
    /// Send no packet from this second on.
    pub(crate) silent_after_s: Option<f64>,
    /// Die in this second, as if unplugged.
    pub(crate) die_after_s: Option<f64>,
}

/// Sockets and destinations.
pub(crate) struct Output<'a> {
    pub(crate) transmitter: Transmitter,
    /// Its destinations win over `to`.
    pub(crate) web: Option<&'a MockWeb>,
    /// Of lidar and auxiliary packets; without one they are not sent.
    pub(crate) to: [Option<SocketAddr>; 2],
    /// Lidar packets, their bytes, auxiliary packets.
    pub(crate) sent: [u64; 3],
    pub(crate) unreachable: Option<IpAddr>,
    /// A destination that the web interface can change is unreachable: reported once.
    pub(crate) on_unreachable: fn(SocketAddr, &io::Error),
}

impl Output<'_> {
    fn send(&mut self, stream: PacketStream, time_ns: u64, packet: &[u8]) -> Result<(), Unsent> {
        let set = self.web.and_then(|web| web.destinations()[stream as usize]);
        let Some(to) = set.or(self.to[stream as usize]) else { return Ok(()) };
        match (self.transmitter.send(time_ns, packet, to), stream) {
            (Ok(()), PacketStream::Lidar) => {
                self.sent[0] += 1;
                self.sent[1] += packet.len() as u64;
            }
            (Ok(()), PacketStream::Auxiliary) => self.sent[2] += 1,
            (Err(error), _) if self.web.is_some() => {
                if self.unreachable.replace(to.ip()) != Some(to.ip()) {
                    (self.on_unreachable)(to, &error);
                }
            }
            (Err(source), _) => return Err(Unsent { to, source }),
        }
        Ok(())
    }
}

impl Sender<'_> {
    /// Faults strike lidar packets alone.
    pub(crate) fn send(&mut self, stream: PacketStream, time_ns: u64, payload: &[u8]) -> Result<(), Ended> {
        let Self { output, injector, .. } = self;
        let time_s = time_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
        match stream {
            PacketStream::Lidar if self.die_after_s.is_some_and(|death_s| time_s >= death_s) => {
                Err(Ended::Died)
            }
            PacketStream::Lidar => {
                Ok(injector.apply(time_s, payload, &mut |packet| output.send(stream, time_ns, packet))?)
            }
            PacketStream::Auxiliary if output.to[1].is_none() => Ok(()),
            PacketStream::Auxiliary if self.silent_after_s.is_some_and(|silent_s| time_s >= silent_s) => {
                Ok(())
            }
            PacketStream::Auxiliary => Ok(output.send(stream, time_ns, payload)?),
        }
    }

    /// Sends what is still held back.
    pub(crate) fn finish(&mut self, end_ns: u64) -> Result<FaultCounts, Unsent> {
        let Self { output, injector, .. } = self;
        injector.finish(&mut |packet| output.send(PacketStream::Lidar, end_ns, packet))
    }
}
