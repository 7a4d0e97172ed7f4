//! A recording's packets once more, in their own time.

mod sending;
mod target;

use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::senders::SenderSockets;
use super::transmit::{Clock, Pace, Transmitter};
use crate::recording::packet_reader::{PacketError, PacketReader};

pub(crate) use sending::Sent;
use sending::send_once;
pub(crate) use target::{Target, parse_map, parse_target};

/// Datagrams looked at before sending, to know which ports there are.
const LOOK_AHEAD: u64 = 20_000;

/// What is sent, and where to.
pub(crate) struct ReplaySpec {
    pub path: PathBuf,
    /// What messages call it.
    pub name: String,
    pub to: Target,
    /// Recorded ports and those that their packets go to; where there are any, no other packet is sent.
    pub map: Vec<(u16, u16)>,
    pub pace: Pace,
    /// Begins again at the end.
    pub is_repeated: bool,
}

/// Why nothing is sent, or not further.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReplayError {
    #[error(transparent)]
    Packets(#[from] PacketError),
    #[error("cannot open a socket to send from")]
    NoSocket(#[source] io::Error),
    #[error("cannot send {bytes} bytes to {to}")]
    CannotSend { bytes: usize, to: SocketAddr, source: io::Error },
    #[error("--map {from}={before} and --map {from}={to}: a port goes to one port")]
    MappedTwice { from: u16, before: u16, to: u16 },
    #[error(
        "the capture has packets for ports {ports}: say what goes where with --map PORT={port} ..., or give --to \
         without a port to keep them"
    )]
    SeveralPorts { ports: String, port: u16 },
    #[error("{name}: no UDP packet to send{why}")]
    Nothing { name: String, why: String },
}

impl ReplayError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::MappedTwice { .. })
    }
}

impl ReplaySpec {
    /// Whether the ports of the recording have to be known before anything is sent.
    pub(crate) fn looks_ahead(&self) -> bool {
        self.to.port.is_some() && self.map.is_empty()
    }

    /// Refuses to mix ports without being asked: sensors that end on one port can no longer be separated.
    pub(crate) fn check_ports(&self) -> Result<(), ReplayError> {
        for (at, (from, to)) in self.map.iter().enumerate() {
            if let Some((_, before)) = self.map[..at].iter().find(|(other, _)| other == from) {
                return Err(ReplayError::MappedTwice { from: *from, before: *before, to: *to });
            }
        }
        let (Some(port), true) = (self.to.port, self.looks_ahead()) else { return Ok(()) };
        let ports = ports_of(&self.path)?;
        if ports.len() > 1 {
            let list = ports.iter().map(|(port, packets)| format!("{port} ({packets} packets)"));
            return Err(ReplayError::SeveralPorts { ports: list.collect::<Vec<_>>().join(", "), port });
        }
        Ok(())
    }

    /// Sends all of it, or what is sent until it is stopped.
    pub(crate) fn send(&self, show: &dyn Fn(u64, u64), stop: &AtomicBool) -> Result<Sent, ReplayError> {
        let begun = Instant::now();
        let mut sent = Sent::default();
        let mut sockets = Transmitter::new(None, SocketAddr::new(self.to.ip, 1), Clock::new(self.pace, None))
            .and_then(SenderSockets::new)
            .map_err(ReplayError::NoSocket)?;
        loop {
            sockets.transmitter.set_clock(Clock::new(self.pace, None));
            send_once(self, &mut sent, &mut sockets, show, stop)?;
            if stop.load(Ordering::Relaxed) {
                break;
            }
            sent.rounds += 1;
            if !self.is_repeated || sent.packets == 0 {
                break;
            }
        }
        sent.wall_s = begun.elapsed().as_secs_f64();
        if sent.packets == 0 && !stop.load(Ordering::Relaxed) {
            let none_mapped = (sent.not_mapped > 0).then(|| "none goes to a mapped port".to_owned());
            let why = none_mapped.iter().chain(&sent.losses).flat_map(|why| ["; ", why]).collect();
            return Err(ReplayError::Nothing { name: self.name.clone(), why });
        }
        sent.note_mixed_senders();
        Ok(sent)
    }
}

fn ports_of(path: &Path) -> Result<BTreeMap<u16, u64>, PacketError> {
    let mut capture = PacketReader::open(path, &path.display().to_string())?;
    let mut ports: BTreeMap<u16, u64> = BTreeMap::new();
    for _ in 0..LOOK_AHEAD {
        // damage is found again, and reported, when the packets are sent
        let Ok(Some(packet)) = capture.next() else { break };
        *ports.entry(packet.destination.port()).or_default() += 1;
    }
    Ok(ports)
}
