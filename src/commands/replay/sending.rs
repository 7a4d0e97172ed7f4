//! One round of a recording's packets, and what was sent.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;
use indicatif::{HumanBytes, HumanCount, ProgressBar};

use super::Args;
use crate::mock::senders::{MAX_SENDERS, SenderSockets};
use crate::recording::bags::BagPackets;
use crate::recording::packet_reader::PacketReader;
use crate::recording::source::{capture_losses, name_of};

/// What was sent.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(super) struct Sent {
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
    pub(super) losses: Vec<String>,
    pub(super) notices: Vec<String>,
    /// Senders of the recording, and where their packets come from now.
    pub(super) senders: BTreeMap<IpAddr, IpAddr>,
    /// Senders of the recording, by the port that their packets go to and the socket that they leave from now.
    #[serde(skip)]
    pub(super) mixed: BTreeMap<(u16, usize), BTreeSet<IpAddr>>,
}

#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(super) struct PortSent {
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

    pub(super) fn text(&self, args: &Args) -> String {
        let mut text = String::new();
        for (recorded, port) in &self.ports {
            let to = SocketAddr::new(args.to.ip, port.to_port);
            text += &format!("port {recorded}: {} packets to {to}\n", port.packets);
        }
        if self.senders.len() > 1 {
            for (sender, from) in &self.senders {
                text += &format!("packets of {sender} come from {from}\n");
            }
        }
        if self.not_mapped > 0 {
            text += &format!("{} packets of other ports not sent\n", self.not_mapped);
        }
        let rounds = if args.again { format!(", {} whole rounds", self.rounds) } else { String::new() };
        text += &format!("{} packets, {} bytes in {:.1} s{rounds}\n", self.packets, self.bytes, self.wall_s);
        text
    }
}

pub(super) fn send_once(
    args: &Args,
    path: &Path,
    sent: &mut Sent,
    sockets: &mut SenderSockets,
    bar: &ProgressBar,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let mut capture = PacketReader::open(path, &name_of(path))?;
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
        let Some(to_port) = target_port(args, recorded_port) else {
            sent.not_mapped += 1;
            continue;
        };
        let to = SocketAddr::new(args.to.ip, to_port);
        let sender = packet.source.ip();
        let (socket, from) = sockets.of(sender);
        sockets
            .transmitter
            .send_from(socket, packet.host_time_ns, packet.payload, to)
            .with_context(|| format!("cannot send {} bytes to {to}", packet.payload.len()))?;
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
        if sent.packets.is_multiple_of(256) && std::io::stderr().is_terminal() {
            bar.set_message(format!("{} packets, {}", HumanCount(sent.packets), HumanBytes(sent.bytes)));
            bar.tick();
        }
    };
    let lost_in_bag = capture.bag().map_or_else(Vec::new, BagPackets::losses);
    let damage = damage.iter().map(ToString::to_string);
    sent.losses = damage.chain(lost_in_bag).chain(capture_losses(&capture.counters())).collect();
    Ok(())
}

fn target_port(args: &Args, recorded: u16) -> Option<u16> {
    if args.map.is_empty() {
        return Some(args.to.port.unwrap_or(recorded));
    }
    args.map.iter().find(|(from, _)| *from == recorded).map(|(_, to)| *to)
}
