//! `outrigger replay`: a capture's packets once more, in their own time.

mod sending;
mod target;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Context, Outcome, output, signals};
use crate::mock::senders::SenderSockets;
use crate::mock::transmit::{Clock, Pace, Transmitter};
use crate::recording::Session;
use crate::recording::bags::is_bag_folder;
use crate::recording::packet_reader::PacketReader;
use crate::recording::source::{name_of, packets_of, spool};
use sending::{Sent, send_once};
use target::{Target, parse_map, parse_target};

/// Datagrams looked at before sending, to know which ports there are.
const LOOK_AHEAD: u64 = 20_000;
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

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let mut path = packets_path(&args.capture)?;
    let name = name_of(&path);
    // what is read once needs no copy
    let spooled = match args.again || looks_ahead(args) {
        true => spool(&path)?,
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
        .and_then(SenderSockets::new)
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
    sent.note_mixed_senders();
    output::print_result(context.json, &sent, || sent.text(args), &sent.losses)?;
    sent.notices.iter().for_each(|notice| output::say_notice(notice));
    ensure!(!is_interrupted || args.again, INTERRUPTED);
    Ok(if sent.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
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
        return Ok(packets_of(capture)?);
    }
    if !capture.is_dir() || is_bag_folder(capture) {
        return Ok(capture.to_owned());
    }
    bail!("{} is a folder without manifest.json: give a capture file, a bag or a session", capture.display())
}
