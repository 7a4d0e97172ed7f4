//! `outrigger cut`: packets to packets.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::PathBuf;

use anyhow::{bail, ensure};
use sensors::Decoded;
use sensors::router::{Routed, Router, Sensor};
use serde::Serialize;

use super::recording::Recording;
use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output, sensor_ids};
use crate::commands::part::PartArgs;
use crate::recording::bags::Surroundings;
use crate::recording::moment::Moment;
use crate::recording::packet_writer::{PacketFormat, PacketWriter};
use crate::rig::{MountFile, NamedFrame, framed};

/// Packets looked at before any is written, to know what the sensors are.
const LOOK_AHEAD: u64 = 20_000;

/// Arguments of `cut`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Payloads stay as they are, bit for bit, and times to the nanosecond. A bag has no addresses: each sensor gets \
                  the topics of its name (/NAME/lidar_packets, /NAME/imu_packets, /NAME/velodyne_packets, \
                  /NAME/position_packets) and, for an Ouster, /NAME/metadata. Packets from a bag get made-up addresses \
                  (192.0.2.0/24) in a capture.\n\
                  Exit codes: 0 done, 1 failed, 3 done, but some of the recording is missing or could not be assigned to a \
                  sensor."
)]
pub struct Args {
    /// Captures, bags or session folders; several are joined in this order.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    sensors: SensorArgs,
    /// File to write: .pcap, .pcapng, .bag (ROS 1) or .mcap (ROS 2).
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    /// Where the sensors sit: written to a bag as static transforms. Without it a session's own, or those of the bag that is read.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Overwrite a file that exists.
    #[arg(long)]
    force: bool,
}

/// What was written.
#[derive(Debug, Default, Serialize)]
struct Document {
    format: &'static str,
    out: String,
    packets: u64,
    /// Packets by sensor, where they were assigned to one.
    sensors: BTreeMap<String, u64>,
    /// Packets that no sensor takes, which a bag has no topic for.
    unassigned: u64,
    /// Packets before --from, from --to on, and of other sensors.
    left_out: u64,
    losses: Vec<String>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let Some(format) = PacketFormat::of_path(&args.out) else {
        refuse!("--out {}: expected a name that ends in .pcap, .pcapng, .bag or .mcap", args.out.display());
    };
    ensure!(args.force || !args.out.exists(), "{} exists already; --force overwrites it", args.out.display());
    let mut writer = None;
    let mut document =
        Document { format: "outrigger-cut/1", out: args.out.display().to_string(), ..Document::default() };
    let mut met: BTreeSet<String> = BTreeSet::new();
    let mut wanted: BTreeSet<&str> = args.part.only.iter().map(String::as_str).collect();
    let has_frames = args.part.revolutions().iter().any(Option::is_some);
    let assigns = format.needs_sensors() || !args.part.only.is_empty() || has_frames;
    let mut start_ns = None;
    for path in &args.recordings {
        let sensors = args.sensors.or_of(context, path);
        let recording = match assigns {
            true => Recording::open_to_reread(path, &sensors)?,
            false => Recording::open(path, &sensors)?,
        };
        ensure!(
            !recording.is_read_from(&args.out),
            "{}: this file is read; write to another",
            args.out.display()
        );
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(PacketWriter::create(&args.out, format)?),
        };
        let mut router = if assigns { recording.router()? } else { Router::new() };
        let revolutions = if has_frames { revolutions(args, &recording)? } else { BTreeMap::new() };
        let first_names = if assigns { names_of(&recording)? } else { Vec::new() };
        let mut transforms = match format.needs_sensors() && start_ns.is_none() {
            true => static_frames(args, &recording, &first_names)?,
            false => None,
        };
        let mut names: BTreeMap<usize, (String, bool)> = BTreeMap::new();
        let ending = recording.each_packet(&mut |packet| {
            let start_ns = *start_ns.get_or_insert(packet.host_time_ns);
            let at_ns = |moment: Option<Moment>| moment.and_then(|moment| moment.time_ns(start_ns));
            let is_within = at_ns(args.part.from).is_none_or(|from_ns| packet.host_time_ns >= from_ns)
                && at_ns(args.part.to).is_none_or(|to_ns| packet.host_time_ns < to_ns);
            if !assigns {
                if is_within {
                    writer.write("", packet)?;
                } else {
                    document.left_out += 1;
                }
                return Ok(());
            }
            let (Routed::Assigned(at) | Routed::Damaged(at)) = router.push(packet, &mut |_, _, _| {}) else {
                document.unassigned += u64::from(is_within);
                return Ok(());
            };
            let (name, is_wanted) = names.entry(at).or_insert_with(|| {
                let found = || sensor_ids::ids(&router).swap_remove(at);
                let name = first_names.get(at).cloned().unwrap_or_else(found);
                let serial = router.sensors()[at].serial();
                met.insert(name.clone());
                let is_wanted = args.part.wants(&name, serial);
                wanted.retain(|only| *only != name && *only != serial);
                (name, is_wanted)
            });
            let is_of_frames = !has_frames
                || revolutions.get(&at).is_some_and(|times_ns| times_ns.contains(&packet.host_time_ns));
            if !*is_wanted || !is_within || !is_of_frames {
                document.left_out += 1;
                return Ok(());
            }
            if let Some(frames) = transforms.take() {
                writer.add_transforms(packet.host_time_ns, &frames)?;
            }
            let is_new = !document.sensors.contains_key(name.as_str());
            if is_new && let Some(text) = recording.metadata_text(&router.sensors()[at]) {
                writer.add_metadata(name, packet.host_time_ns, text)?;
            }
            *document.sensors.entry(name.clone()).or_default() += 1;
            Ok(writer.write(name, packet)?)
        })?;
        if assigns {
            recording.ensure_given_fits(&router)?;
        }
        document.losses.extend(ending.losses());
        if document.unassigned > 0 && document.sensors.is_empty() {
            bail!("{}", super::unread::why_nothing(&recording, &router, &ending));
        }
    }
    if let Some(name) = wanted.first() {
        let met: Vec<String> = met.into_iter().collect();
        bail!("no packet of sensor {name}; there are {}", met.join(", "));
    }
    document.packets = writer.map_or(Ok(0), PacketWriter::finish)?;
    if document.unassigned > 0 {
        document.losses.push(format!(
            "{} packets are of no known sensor and were left out; `outrigger inspect` says why",
            document.unassigned
        ));
    }
    output::print_result(context.json, &document, || text(&document), &document.losses)?;
    Ok(if document.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
}

/// The frames of the sensors, by `--mount` or the recording itself.
fn static_frames(
    args: &Args,
    recording: &Recording,
    names: &[String],
) -> anyhow::Result<Option<Vec<NamedFrame>>> {
    let mount = match (&args.mount, recording.checked_session()) {
        (Some(path), _) => Some(MountFile::read(path)?),
        (None, Some(session)) => session.mount()?,
        (None, None) => None,
    };
    if let Some(mut mount) = mount {
        // sensors of a capture have no names of their own: they are those of the mount file in their order
        let is_named = names.iter().any(|name| mount.sensors.iter().any(|entry| entry.name == *name));
        for (entry, name) in mount.sensors.iter_mut().zip(names).filter(|_| !is_named) {
            entry.name.clone_from(name);
        }
        let units = mount.units(&[])?;
        let framed = framed(&mount, &units).map_err(anyhow::Error::msg)?;
        return Ok(Some(framed.into_iter().flat_map(|sensor| sensor.frames).collect()));
    }
    if !recording.is_bag() {
        return Ok(None);
    }
    let frames: Vec<NamedFrame> =
        Surroundings::read(recording.path(), &recording.name())?.frames.links().collect();
    Ok((!frames.is_empty()).then_some(frames))
}

/// By sensor, when the packets of the revolutions that are wanted came: from the first of `--from` to the last before `--to`.
fn revolutions(args: &Args, recording: &Recording) -> anyhow::Result<BTreeMap<usize, RangeInclusive<u64>>> {
    let [from, to] = args.part.revolutions();
    let (from, to) = (from.unwrap_or(0), to.unwrap_or(u64::MAX));
    let mut router = recording.router()?;
    let mut counts: BTreeMap<usize, u64> = BTreeMap::new();
    let mut times_ns: BTreeMap<usize, RangeInclusive<u64>> = BTreeMap::new();
    let mut count = |at: usize, _: &Sensor, decoded: Decoded<'_>| {
        let Decoded::Frame(frame) = decoded else { return };
        let number = counts.entry(at).or_default();
        if (from..to).contains(number) {
            let [first_ns, last_ns] = frame.host_time_ns;
            let known = times_ns.entry(at).or_insert(first_ns..=last_ns);
            *known = *known.start()..=last_ns.max(*known.end());
        }
        *number += 1;
    };
    recording.each_packet(&mut |packet| {
        router.push(packet, &mut count);
        Ok(())
    })?;
    router.finish(&mut count);
    ensure!(
        !times_ns.is_empty(),
        "--from, --to: {} has fewer revolutions, counted from 0: {}",
        recording.name(),
        counts.values().map(u64::to_string).collect::<Vec<_>>().join(", ")
    );
    Ok(times_ns)
}

/// Ends a pass early.
#[derive(Debug, thiserror::Error)]
#[error("enough was read")]
struct Enough;

/// What the sensors of a recording are called, as `inspect` calls them: what some are shows only after some packets.
fn names_of(recording: &Recording) -> anyhow::Result<Vec<String>> {
    let mut router = recording.router()?;
    let mut packets = 0;
    let outcome = recording.each_packet(&mut |packet| {
        packets += 1;
        ensure!(packets <= LOOK_AHEAD, Enough);
        router.push(packet, &mut |_, _, _| {});
        Ok(())
    });
    match outcome {
        Err(error) if !error.is::<Enough>() => Err(error),
        _ => Ok(sensor_ids::ids(&router)),
    }
}

fn text(document: &Document) -> String {
    let mut text = format!("{}: {} packets\n", document.out, document.packets);
    for (sensor, packets) in &document.sensors {
        text += &format!("  {sensor}: {packets}\n");
    }
    if document.left_out > 0 {
        text += &format!("  {} packets of other times or sensors left out\n", document.left_out);
    }
    text
}
