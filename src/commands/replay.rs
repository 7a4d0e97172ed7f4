//! `outrigger replay`: a capture's packets once more, in their own time.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{bail, ensure};
use indicatif::{HumanBytes, HumanCount};

use super::stage::spinner;
use super::{Context, Outcome, output, signals};
use crate::mock::replay::{ReplaySpec, Target, parse_map, parse_target};
use crate::mock::transmit::Pace;
use crate::recording::Session;
use crate::recording::bags::is_bag_folder;
use crate::recording::source::{name_of, packets_of, spool};

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
    let path = packets_path(&args.capture)?;
    let (name, is_repeated) = (name_of(&path), args.again);
    let mut spec =
        ReplaySpec { path, name, to: args.to, map: args.map.clone(), pace: args.rate, is_repeated };
    // what is read once needs no copy
    let spooled = match args.again || spec.looks_ahead() {
        true => spool(&spec.path)?,
        false => None,
    };
    if let Some(file) = &spooled {
        spec.path = file.path().to_owned();
    }
    spec.check_ports()?;
    let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
    let bar = spinner();
    let show = |packets: u64, bytes: u64| {
        if std::io::stderr().is_terminal() {
            bar.set_message(format!("{} packets, {}", HumanCount(packets), HumanBytes(bytes)));
            bar.tick();
        }
    };
    let sent = spec.send(&show, &stop);
    bar.finish_and_clear();
    let sent = sent?;
    output::print_result(context.json, &sent, &sent.report(&spec), &sent.losses)?;
    sent.notices.iter().for_each(|notice| output::say_notice(notice));
    ensure!(!stop.load(Ordering::Relaxed) || args.again, INTERRUPTED);
    Ok(if sent.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
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
