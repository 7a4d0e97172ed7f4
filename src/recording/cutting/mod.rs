//! The packets of recordings, one recording after the other, into one file.

mod document;
mod sensors;

use std::collections::BTreeSet;
use std::path::PathBuf;

use ::sensors::Packet;
use ::sensors::router::Routed;

pub(crate) use self::document::Document;
use self::sensors::{Needs, Poses, SensorsOf};
use crate::base::times::rfc3339;
use crate::recording::SessionError;
use crate::recording::bags::BagError;
use crate::recording::moment::Moment;
use crate::recording::packet_writer::{PacketFormat, PacketWriteError, PacketWriter};
use crate::recording::part::Part;
use crate::recording::source::{Recording, RecordingError, RecordingSpec};
use crate::recording::{sensor_ids, unread};
use crate::rig::{MountFileError, UnitError};

/// What is asked for.
pub(crate) struct CuttingSpec {
    pub out: PathBuf,
    pub format: PacketFormat,
    pub part: Part,
    /// Where the sensors sit; without it as the recordings say.
    pub mount: Option<PathBuf>,
    /// Where the rig was; without it as the recordings say.
    pub trajectory: Option<PathBuf>,
}

/// Why no packets are written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CuttingError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Writer(#[from] PacketWriteError),
    #[error(transparent)]
    MountFile(#[from] MountFileError),
    #[error(transparent)]
    Unit(#[from] UnitError),
    #[error("{0}")]
    Frames(String),
    #[error("{out}: this file is read; write to another", out = out.display())]
    Itself { out: PathBuf },
    #[error(
        "{out} is not written: the recording holds no packet. `cut` copies packets; `decode` writes the points of clouds, --from and --to \
         take a part of them",
        out = out.display()
    )]
    NoPackets { out: PathBuf },
    #[error(
        "{out} is not written: none of {packets} packets lies in the part that was asked for; they last {seconds:.3} s and begin at {begin}",
        out = out.display()
    )]
    NothingWanted { out: PathBuf, packets: u64, seconds: f64, begin: String },
    #[error("no packet of sensor {name}; there are {met}")]
    UnknownSensor { name: String, met: String },
    #[error("--from, --to: {recording} has fewer revolutions, counted from 0: {counts}")]
    FewerRevolutions { recording: String, counts: String },
}

impl CuttingError {
    /// Whether what was asked for contradicts itself, whatever the files hold.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::Recording(error) if error.is_usage())
    }
}

/// The file that is written, and what is known so far.
pub(crate) struct Cutting<'a> {
    spec: &'a CuttingSpec,
    needs: Needs,
    writer: Option<PacketWriter>,
    document: Document,
    /// Sensors that sent something, and those of `--sensor` that did not yet.
    met: BTreeSet<String>,
    missing: BTreeSet<&'a str>,
    /// Times of the first and the last packet that was read.
    span_ns: Option<[u64; 2]>,
    written: u64,
    poses: Option<Poses>,
}

impl<'a> Cutting<'a> {
    pub(crate) fn new(spec: &'a CuttingSpec) -> Self {
        let CuttingSpec { part, format, .. } = spec;
        let has_frames = part.revolutions().iter().any(Option::is_some);
        Self {
            spec,
            needs: Needs {
                sensors: format.needs_sensors() || !part.only.is_empty() || has_frames,
                frames: has_frames,
                transforms: format.needs_sensors(),
            },
            writer: None,
            document: Document {
                format: "outrigger-cut/1",
                out: spec.out.display().to_string(),
                ..Document::default()
            },
            met: BTreeSet::new(),
            missing: part.only.iter().map(String::as_str).collect(),
            span_ns: None,
            written: 0,
            poses: None,
        }
    }

    /// Writes what is wanted of a recording.
    pub(crate) fn add(&mut self, of: RecordingSpec) -> Result<(), CuttingError> {
        let CuttingSpec { out, format, .. } = self.spec;
        let recording = Recording::open(&RecordingSpec { is_read_again: self.needs.sensors, ..of })?;
        if recording.is_read_from(out) {
            return Err(CuttingError::Itself { out: out.clone() });
        }
        let mut writer = match self.writer.take() {
            Some(writer) => writer,
            None => PacketWriter::create(out, *format)?,
        };
        let mut sensors = SensorsOf::read(self.spec, &recording, (self.needs, self.span_ns.is_none()))?;
        self.poses = sensors.trajectory.take().or(self.poses.take());
        let ending =
            recording.try_each_packet(&mut |packet| self.write(packet, &mut sensors, &mut writer))?;
        self.writer = Some(writer);
        if self.needs.sensors {
            recording.ensure_given_fits(&sensors.router)?;
        }
        self.document.losses.extend(ending.losses());
        if self.document.unassigned > 0 && self.document.sensors.is_empty() {
            let why = unread::why_nothing(&recording, &sensors.router, &ending);
            return Err(RecordingError::NothingRead(why).into());
        }
        Ok(())
    }

    /// Whether a packet lies between `--from` and `--to`.
    fn is_within(&mut self, time_ns: u64) -> bool {
        let [start_ns, end_ns] = self.span_ns.get_or_insert([time_ns; 2]);
        *end_ns = time_ns.max(*end_ns);
        let start_ns = *start_ns;
        let at_ns = |moment: Option<Moment>| moment.and_then(|moment| moment.time_ns(start_ns));
        at_ns(self.spec.part.from).is_none_or(|from_ns| time_ns >= from_ns)
            && at_ns(self.spec.part.to).is_none_or(|to_ns| time_ns < to_ns)
    }

    fn write(
        &mut self,
        packet: &Packet<'_>,
        of: &mut SensorsOf<'_>,
        writer: &mut PacketWriter,
    ) -> Result<(), CuttingError> {
        let is_within = self.is_within(packet.host_time_ns);
        if !self.needs.sensors {
            if is_within {
                writer.write("", packet)?;
                self.written += 1;
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
            let is_wanted = self.spec.part.wants(&name, serial);
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
        self.written += 1;
        Ok(writer.write(name, packet)?)
    }

    /// Why no packet was written.
    fn why_nothing(&self) -> CuttingError {
        let out = self.spec.out.clone();
        let Some([start_ns, end_ns]) = self.span_ns else { return CuttingError::NoPackets { out } };
        CuttingError::NothingWanted {
            out,
            packets: self.document.left_out + self.document.unassigned,
            seconds: (end_ns - start_ns) as f64 * 1e-9,
            begin: rfc3339(start_ns),
        }
    }

    /// Completes the file.
    pub(crate) fn finish(self) -> Result<Document, CuttingError> {
        if let Some(name) = self.missing.first() {
            let met = self.met.into_iter().collect::<Vec<_>>().join(", ");
            return Err(CuttingError::UnknownSensor { name: (*name).to_owned(), met });
        }
        if self.written == 0 {
            return Err(self.why_nothing());
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
