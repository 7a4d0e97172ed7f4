//! The packets of recordings, one recording after the other, into one file.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{bail, ensure};
use sensors::Packet;
use sensors::router::Routed;

use super::Args;
use super::document::Document;
use super::sensors::{Needs, Poses, SensorsOf};
use crate::commands::recording::Recording;
use crate::commands::{Context, sensor_ids, unread};
use crate::recording::moment::Moment;
use crate::recording::packet_writer::{PacketFormat, PacketWriter};

/// The file that is written, and what is known so far.
pub(super) struct Cutting<'a> {
    args: &'a Args,
    format: PacketFormat,
    needs: Needs,
    writer: Option<PacketWriter>,
    document: Document,
    /// Sensors that sent something, and those of `--sensor` that did not yet.
    met: BTreeSet<String>,
    missing: BTreeSet<&'a str>,
    start_ns: Option<u64>,
    poses: Option<Poses>,
}

impl<'a> Cutting<'a> {
    pub(super) fn new(args: &'a Args, format: PacketFormat) -> Self {
        let has_frames = args.part.revolutions().iter().any(Option::is_some);
        Self {
            args,
            format,
            needs: Needs {
                sensors: format.needs_sensors() || !args.part.only.is_empty() || has_frames,
                frames: has_frames,
                transforms: format.needs_sensors(),
            },
            writer: None,
            document: Document {
                format: "outrigger-cut/1",
                out: args.out.display().to_string(),
                ..Document::default()
            },
            met: BTreeSet::new(),
            missing: args.part.only.iter().map(String::as_str).collect(),
            start_ns: None,
            poses: None,
        }
    }

    /// Writes what is wanted of a recording.
    pub(super) fn add(&mut self, path: &Path, context: Context) -> anyhow::Result<()> {
        let args = self.args;
        let sensors = args.sensors.or_of(context, path);
        let recording = match self.needs.sensors {
            true => Recording::open_to_reread(path, &sensors)?,
            false => Recording::open(path, &sensors)?,
        };
        ensure!(
            !recording.is_read_from(&args.out),
            "{}: this file is read; write to another",
            args.out.display()
        );
        let mut writer = match self.writer.take() {
            Some(writer) => writer,
            None => PacketWriter::create(&args.out, self.format)?,
        };
        let mut sensors = SensorsOf::read(args, &recording, (self.needs, self.start_ns.is_none()))?;
        self.poses = sensors.trajectory.take().or(self.poses.take());
        let ending = recording.each_packet(&mut |packet| self.write(packet, &mut sensors, &mut writer))?;
        self.writer = Some(writer);
        if self.needs.sensors {
            recording.ensure_given_fits(&sensors.router)?;
        }
        self.document.losses.extend(ending.losses());
        if self.document.unassigned > 0 && self.document.sensors.is_empty() {
            bail!("{}", unread::why_nothing(&recording, &sensors.router, &ending));
        }
        Ok(())
    }

    /// Whether a packet lies between `--from` and `--to`.
    fn is_within(&mut self, time_ns: u64) -> bool {
        let start_ns = *self.start_ns.get_or_insert(time_ns);
        let at_ns = |moment: Option<Moment>| moment.and_then(|moment| moment.time_ns(start_ns));
        at_ns(self.args.part.from).is_none_or(|from_ns| time_ns >= from_ns)
            && at_ns(self.args.part.to).is_none_or(|to_ns| time_ns < to_ns)
    }

    fn write(
        &mut self,
        packet: &Packet<'_>,
        of: &mut SensorsOf<'_>,
        writer: &mut PacketWriter,
    ) -> anyhow::Result<()> {
        let is_within = self.is_within(packet.host_time_ns);
        if !self.needs.sensors {
            if is_within {
                writer.write("", packet)?;
            } else {
                self.document.left_out += 1;
            }
            return Ok(());
        }
        let (Routed::Assigned(at) | Routed::Damaged(at)) = of.router.push(packet, &mut |_, _, _| {}) else {
            self.document.unassigned += u64::from(is_within);
            return Ok(());
        };
        let (name, is_wanted) = of.names.entry(at).or_insert_with(|| {
            let found = || sensor_ids::ids(&of.router).swap_remove(at);
            let name = of.first_names.get(at).cloned().unwrap_or_else(found);
            let serial = of.router.sensors()[at].serial();
            self.met.insert(name.clone());
            let is_wanted = self.args.part.wants(&name, serial);
            self.missing.retain(|only| *only != name && *only != serial);
            (name, is_wanted)
        });
        let is_of_frames = !self.needs.frames
            || of.revolutions.get(&at).is_some_and(|times_ns| times_ns.contains(&packet.host_time_ns));
        if !*is_wanted || !is_within || !is_of_frames {
            self.document.left_out += 1;
            return Ok(());
        }
        if let Some(frames) = of.transforms.take() {
            writer.add_transforms(packet.host_time_ns, &frames)?;
        }
        for (time_ns, frame) in self.poses.iter_mut().flat_map(|poses| poses.until(packet.host_time_ns)) {
            writer.add_pose(time_ns, frame)?;
        }
        let is_new = !self.document.sensors.contains_key(name.as_str());
        if is_new && let Some(text) = of.recording.metadata_text(&of.router.sensors()[at]) {
            writer.add_metadata(name, packet.host_time_ns, text)?;
        }
        *self.document.sensors.entry(name.clone()).or_default() += 1;
        Ok(writer.write(name, packet)?)
    }

    /// Completes the file.
    pub(super) fn finish(self) -> anyhow::Result<Document> {
        if let Some(name) = self.missing.first() {
            let met: Vec<String> = self.met.into_iter().collect();
            bail!("no packet of sensor {name}; there are {}", met.join(", "));
        }
        let mut document = self.document;
        document.losses.extend(self.poses.as_ref().and_then(Poses::loss));
        document.packets = self.writer.map_or(Ok(0), PacketWriter::finish)?;
        if document.unassigned > 0 {
            document.losses.push(format!(
                "{} packets are of no known sensor and were left out; `outrigger inspect` says why",
                document.unassigned
            ));
        }
        Ok(document)
    }
}
