//! `outrigger replay`: a capture's packets once more, in their own time.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use indicatif::{HumanBytes, HumanCount, ProgressBar, ProgressStyle};

use super::recording::{self, capture_losses};
use super::{Context, Outcome, output, signals};
use crate::mock::transmit::{Clock, Pace, Transmitter};
use crate::recording::Session;
use crate::recording::bags::{BagPackets, is_bag_folder};
use crate::recording::packet_reader::PacketReader;

/// Datagrams looked at before sending, to know which ports there are.
const LOOK_AHEAD: u64 = 20_000;
/// Most senders that are counted, and reported by name.
const MOST_SENDERS: usize = 8;
const INTERRUPTED: &str = "interrupted: the rest of the recording was not sent";
/// Time after Ctrl-C in which a packet may still be waited for.
const TO_END_WITHIN: Duration = Duration::from_secs(1);

/// Arguments of `replay`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Without a port in --to and without --map, packets go to the ports they went to when they were \
                        recorded. With a port, everything goes there, and must have gone to one port when it was recorded. \
                        With --map, only mapped ports are sent. To 127.0.0.1, each sender of the recording has an address of its own \
                        (127.0.0.1, 127.0.0.2, ...; Linux). Exit codes: 0 when the whole recording was sent, 3 when \
                        some of it could not be read, 1 when nothing was sent or it was interrupted (--loop, which ends so: 0)."
)]
pub struct Args {
    /// Capture (pcap or pcapng; plain, gzip, zstd or lz4), bag (ROS 1, MCAP, db3, or the folder of one), session folder, or -
    /// for standard input.
    capture: PathBuf,
    /// Where packets go.
    #[arg(long, value_name = "HOST[:PORT]", value_parser = parse_target)]
    to: Target,
    /// Send packets of one recorded destination port to another port. May be repeated.
    #[arg(long = "map", value_name = "PORT=PORT", value_parser = parse_map)]
    map: Vec<(u16, u16)>,
    /// Times faster than recorded, or `max`: as fast as a receiver on this host takes packets.
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    rate: Pace,
    /// Begin again at the end, until Ctrl-C.
    #[arg(long = "loop")]
    again: bool,
}

/// What was sent.
#[derive(Clone, Debug, Default, serde::Serialize)]
struct Sent {
    packets: u64,
    bytes: u64,
    /// Recorded destination port, where its packets went, how many.
    ports: BTreeMap<u16, PortSent>,
    /// Packets of ports that are not mapped.
    not_mapped: u64,
    /// Times that the recording was sent to its end.
    rounds: u64,
    wall_s: f64,
    /// What of the recording could not be sent.
    losses: Vec<String>,
    notices: Vec<String>,
    /// Senders of the recording, and where their packets come from now.
    senders: BTreeMap<IpAddr, IpAddr>,
    /// Senders of the recording, by the port that their packets go to and the socket that they leave from now.
    #[serde(skip)]
    mixed: BTreeMap<(u16, usize), BTreeSet<IpAddr>>,
}

#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
struct PortSent {
    to_port: u16,
    packets: u64,
}

/// Where the packets of each sender of the recording leave from: on loopback each has an address of its own, so that
/// whoever receives tells them apart as before.
struct Sockets {
    transmitter: Transmitter,
    /// Address of the first socket.
    first: IpAddr,
    of: BTreeMap<IpAddr, (usize, IpAddr)>,
}

impl Sockets {
    fn new(transmitter: Transmitter) -> std::io::Result<Self> {
        let first = transmitter.local_addr()?.ip();
        Ok(Self { transmitter, first, of: BTreeMap::new() })
    }

    /// Socket of a sender, and the address that its packets come from.
    fn of(&mut self, sender: IpAddr) -> (usize, IpAddr) {
        if let Some(known) = self.of.get(&sender) {
            return *known;
        }
        let mut mounted_frame = (0, self.first);
        if let IpAddr::V4(first) = self.first
            && first.is_loopback()
            && (1..MOST_SENDERS).contains(&self.of.len())
        {
            let next = IpAddr::from(std::net::Ipv4Addr::from_bits(first.to_bits() + self.of.len() as u32));
            // Linux has all of 127.0.0.0/8; where it is not so, all leave from one
            if let Ok(number) = self.transmitter.add_socket(next) {
                mounted_frame = (number, next);
            }
        }
        if self.of.len() < MOST_SENDERS {
            self.of.insert(sender, mounted_frame);
        }
        mounted_frame
    }
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let mut path = packets_path(&args.capture)?;
    let name = if path == Path::new("-") { "standard input".into() } else { path.display().to_string() };
    // what is read once needs no copy
    let spooled = match args.again || looks_ahead(args) {
        true => recording::spool(&path)?,
        false => None,
    };
    if let Some(file) = &spooled {
        path = file.path().to_owned();
    }
    check_ports(args, &path)?;
    let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
    let begun = Instant::now();
    let mut sent = Sent::default();
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {wide_msg}") {
        bar.set_style(style);
    }
    let mut sockets = Transmitter::new(None, SocketAddr::new(args.to.ip, 1), Clock::new(args.rate, None))
        .and_then(Sockets::new)
        .context("cannot open a socket to send from")?;
    loop {
        sockets.transmitter.set_clock(Clock::new(args.rate, None));
        send_once(args, &path, &mut sent, &mut sockets, &bar, &stop)?;
        if stop.load(Ordering::Relaxed) {
            break;
        }
        sent.rounds += 1;
        if !args.again || sent.packets == 0 {
            break;
        }
    }
    bar.finish_and_clear();
    sent.wall_s = begun.elapsed().as_secs_f64();
    let is_interrupted = stop.load(Ordering::Relaxed);
    if sent.packets == 0 && !is_interrupted {
        let none_mapped = (sent.not_mapped > 0).then(|| "none goes to a mapped port".to_owned());
        let why: String = none_mapped.iter().chain(&sent.losses).flat_map(|why| ["; ", why]).collect();
        bail!("{name}: no UDP packet to send{why}");
    }
    for ((port, _), senders) in sent.mixed.iter().filter(|(_, senders)| senders.len() > 1) {
        let list: Vec<String> = senders.iter().map(ToString::to_string).collect();
        sent.notices.push(format!(
            "the packets of {} senders ({}) go to port {port} from one address: sensors without a serial number in their packets \
             cannot be separated there",
            senders.len(),
            list.join(", ")
        ));
    }
    conclude(args, &sent, context)?;
    ensure!(!is_interrupted || args.again, INTERRUPTED);
    Ok(if sent.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
}

fn send_once(
    args: &Args,
    path: &Path,
    sent: &mut Sent,
    sockets: &mut Sockets,
    bar: &ProgressBar,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let name = if path == Path::new("-") { "standard input".into() } else { path.display().to_string() };
    let mut capture = PacketReader::open(path, &name)?;
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
        if sent.senders.len() < MOST_SENDERS {
            sent.senders.insert(sender, from);
        }
        let mixed = sent.mixed.entry((to_port, socket)).or_default();
        if mixed.len() < MOST_SENDERS {
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

/// Whether the ports of the recording have to be known before anything is sent.
fn looks_ahead(args: &Args) -> bool {
    args.to.port.is_some() && args.map.is_empty()
}

/// Refuses to mix ports without being asked: sensors that end on one port can no longer be separated.
fn check_ports(args: &Args, path: &Path) -> anyhow::Result<()> {
    for (at, (from, to)) in args.map.iter().enumerate() {
        let before = args.map[..at].iter().find(|(other, _)| other == from);
        if let Some((_, before)) = before {
            refuse!("--map {from}={before} and --map {from}={to}: a port goes to one port");
        }
    }
    let (Some(port), true) = (args.to.port, looks_ahead(args)) else { return Ok(()) };
    let mut capture = PacketReader::open(path, &path.display().to_string())?;
    let mut ports: BTreeMap<u16, u64> = BTreeMap::new();
    for _ in 0..LOOK_AHEAD {
        // damage is found again, and reported, when the packets are sent
        let Ok(Some(packet)) = capture.next() else { break };
        *ports.entry(packet.destination.port()).or_default() += 1;
    }
    if ports.len() > 1 {
        let list: Vec<String> =
            ports.iter().map(|(port, packets)| format!("{port} ({packets} packets)")).collect();
        bail!(
            "the capture has packets for ports {}: say what goes where with --map PORT={port} ..., or give --to \
             without a port to keep them",
            list.join(", ")
        );
    }
    Ok(())
}

fn packets_path(capture: &Path) -> anyhow::Result<PathBuf> {
    if capture.is_dir() && Session::is_session(capture) {
        return recording::packets_of(capture);
    }
    if !capture.is_dir() || is_bag_folder(capture) {
        return Ok(capture.to_owned());
    }
    bail!("{} is a folder without manifest.json: give a capture file, a bag or a session", capture.display())
}

fn conclude(args: &Args, sent: &Sent, context: Context) -> anyhow::Result<()> {
    if context.json {
        output::print_json(sent)?;
    } else {
        let mut text = String::new();
        for (recorded, port) in &sent.ports {
            let to = SocketAddr::new(args.to.ip, port.to_port);
            text += &format!("port {recorded}: {} packets to {to}\n", port.packets);
        }
        if sent.senders.len() > 1 {
            for (sender, from) in &sent.senders {
                text += &format!("packets of {sender} come from {from}\n");
            }
        }
        if sent.not_mapped > 0 {
            text += &format!("{} packets of other ports not sent\n", sent.not_mapped);
        }
        let rounds = if args.again { format!(", {} whole rounds", sent.rounds) } else { String::new() };
        text += &format!("{} packets, {} bytes in {:.1} s{rounds}\n", sent.packets, sent.bytes, sent.wall_s);
        output::print_text(&text)?;
    }
    sent.losses.iter().chain(&sent.notices).for_each(|notice| output::say_notice(notice));
    Ok(())
}

/// A host, and a port if one was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Target {
    ip: IpAddr,
    port: Option<u16>,
}

fn parse_target(text: &str) -> Result<Target, String> {
    if let Ok(ip) = text.parse() {
        return Ok(Target { ip, port: None });
    }
    let resolve = |with_port: &str| with_port.to_socket_addrs().ok().and_then(|mut found| found.next());
    let has_port = text.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    let found = if has_port { resolve(text) } else { resolve(&format!("{text}:0")) };
    let found = found.ok_or_else(|| format!("{text:?}: expected HOST or HOST:PORT of a known host"))?;
    Ok(Target { ip: found.ip(), port: has_port.then_some(found.port()) })
}

fn parse_map(text: &str) -> Result<(u16, u16), String> {
    let parts = text.split_once('=').and_then(|(from, to)| Some((from.parse().ok()?, to.parse().ok()?)));
    parts.ok_or_else(|| format!("{text:?}: expected PORT=PORT"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_with_and_without_port() {
        let target = |text: &str| parse_target(text).map(|target| (target.ip.to_string(), target.port));
        assert_eq!(target("127.0.0.1"), Ok(("127.0.0.1".into(), None)));
        assert_eq!(target("127.0.0.1:2368"), Ok(("127.0.0.1".into(), Some(2368))));
        assert_eq!(target("::1"), Ok(("::1".into(), None)));
        assert_eq!(target("[::1]:7502"), Ok(("::1".into(), Some(7502))));
        assert!(target("no.such.host.invalid:1").is_err());
        assert_eq!(parse_map("7502=17502"), Ok((7502, 17502)));
        assert!(parse_map("7502:17502").is_err() && parse_map("7502=x").is_err());
    }
}
