//! One round of a recording's packets, and what was sent.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};

use super::{ReplayError, ReplaySpec};
use crate::mock::senders::{MAX_SENDERS, SenderSockets};
use crate::recording::bags::BagPackets;
use crate::recording::packet_reader::PacketReader;
use crate::recording::source::{capture_losses, name_of};
use crate::report::Report;

/// What was sent.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(crate) struct Sent {
    pub(super) packets: u64,
    pub(super) bytes: u64,
    /// Recorded destination port, where its packets went, how many.
    pub(super) ports: BTreeMap<u16, PortSent>,
    /// Packets of ports that are not mapped.
    pub(super) not_mapped: u64,
    /// Times that the recording was sent to its end.
    pub(super) rounds: u64,
    pub(super) wall_s: f64,
    /// What of the recording could not be sent.
    pub(crate) losses: Vec<String>,
    pub(crate) notices: Vec<String>,
    /// Senders of the recording, and where their packets come from now.
    pub(super) senders: BTreeMap<IpAddr, IpAddr>,
    /// Senders of the recording, by the port that their packets go to and the socket that they leave from now.
    #[serde(skip)]
    pub(super) mixed: BTreeMap<(u16, usize), BTreeSet<IpAddr>>,
}

#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(crate) struct PortSent {
    pub(super) to_port: u16,
    pub(super) packets: u64,
}

impl Sent {
    /// Where packets of several senders leave from one address.
    pub(super) fn note_mixed_senders(&mut self) {
        for ((port, _), senders) in self.mixed.iter().filter(|(_, senders)| senders.len() > 1) {
            let list: Vec<String> = senders.iter().map(ToString::to_string).collect();
            self.notices.push(format!(
                "the packets of {} senders ({}) go to port {port} from one address: sensors without a serial number in their packets \
                 cannot be separated there",
                senders.len(),
                list.join(", ")
            ));
        }
    }

    pub(crate) fn report(&self, spec: &ReplaySpec) -> Report {
        let rounds = if spec.is_repeated { format!(", {} whole rounds", self.rounds) } else { String::new() };
        let sentence =
            format!("{} packets, {} bytes in {:.1} s{rounds}", self.packets, self.bytes, self.wall_s);
        let mut report = Report::new("Packets sent", &sentence);
        for (recorded, port) in &self.ports {
            let to = SocketAddr::new(spec.to.ip, port.to_port);
            report.figure(&format!("port {recorded}"), format!("{} packets to {to}", port.packets));
        }
        let senders = self.senders.iter().filter(|_| self.senders.len() > 1);
        report
            .figures(senders.map(|(sender, from)| (sender.to_string(), format!("packets come from {from}"))));
        if self.not_mapped > 0 {
            report.note(format!("{} packets of other ports not sent", self.not_mapped));
        }
        report
    }
}

/// One round; `show` is called now and then with the packets and the bytes that were sent.
pub(super) fn send_once(
    spec: &ReplaySpec,
    sent: &mut Sent,
    sockets: &mut SenderSockets,
    show: &dyn Fn(u64, u64),
    stop: &AtomicBool,
) -> Result<(), ReplayError> {
    let mut capture = PacketReader::open(&spec.path, &name_of(&spec.path))?;
    let damage = loop {
        let packet = match capture.next() {
            Ok(Some(packet)) => packet,
            Ok(None) => break None,
            Err(error) => break Some(error),
        };
        if stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        let recorded_port = packet.destination.port();
        let Some(to_port) = target_port(spec, recorded_port) else {
            sent.not_mapped += 1;
            continue;
        };
        let to = SocketAddr::new(spec.to.ip, to_port);
        let sender = packet.source.ip();
        let (socket, from) = sockets.of(sender);
        sockets
            .transmitter
            .send_from(socket, packet.host_time_ns, packet.payload, to)
            .map_err(|source| ReplayError::CannotSend { bytes: packet.payload.len(), to, source })?;
        let port = sent.ports.entry(recorded_port).or_default();
        port.to_port = to_port;
        port.packets += 1;
        if sent.senders.len() < MAX_SENDERS {
            sent.senders.insert(sender, from);
        }
        let mixed = sent.mixed.entry((to_port, socket)).or_default();
        if mixed.len() < MAX_SENDERS {
            mixed.insert(sender);
        }
        sent.packets += 1;
        sent.bytes += packet.payload.len() as u64;
        if sent.packets.is_multiple_of(256) {
            show(sent.packets, sent.bytes);
        }
    };
    let lost_in_bag = capture.bag().map_or_else(Vec::new, BagPackets::losses);
    let damage = damage.iter().map(ToString::to_string);
    sent.losses = damage.chain(lost_in_bag).chain(capture_losses(&capture.counters())).collect();
    Ok(())
}

fn target_port(spec: &ReplaySpec, recorded: u16) -> Option<u16> {
    if spec.map.is_empty() {
        return Some(spec.to.port.unwrap_or(recorded));
    }
    spec.map.iter().find(|(from, _)| *from == recorded).map(|(_, to)| *to)
}
