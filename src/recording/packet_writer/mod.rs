//! Packets to packets: a capture or a bag of the packets of sensors, none encoded again. The file appears under its name only
//! when it is whole.

#[cfg(feature = "mcap")]
mod mcap;
mod message;
mod ros1;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use sensors::Packet;
use sensors::capture::{PcapWriter, PcapngWriter};
use sensors::router::Guess;
use tempfile::NamedTempFile;

use self::message::{Dialect, Kind, Message};
use crate::base::files;
use crate::rig::NamedFrame;

/// Topic of frames that do not move against each other, and of those that do.
pub(super) const TF_STATIC: &str = "/tf_static";
pub(super) const TF: &str = "/tf";

/// A `tf2_msgs/msg/TFMessage` of ROS 2, in CDR.
#[cfg(feature = "mcap")]
pub(super) fn ros2_transforms(time_ns: u64, frames: &[NamedFrame]) -> Vec<u8> {
    Message::transforms(Dialect::Ros2, time_ns, frames)
}

/// Its definition.
#[cfg(feature = "mcap")]
pub(super) fn ros2_transforms_definition() -> String {
    Kind::Transforms.definition(Dialect::Ros2)
}

/// What a writer says went wrong.
type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Data of one packet of a Velodyne.
const VELODYNE_BYTES: usize = 1206;
/// Packets of one message with a Velodyne's: a revolution of a VLP-16 at 600 rpm.
const SCAN_PACKETS: usize = 76;

/// A format of packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PacketFormat {
    Pcap,
    Pcapng,
    /// ROS 1.
    Bag,
    /// With ROS 2 messages.
    Mcap,
}

impl PacketFormat {
    /// By a file's extension.
    pub fn of_path(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "pcap" | "cap" => Some(Self::Pcap),
            "pcapng" => Some(Self::Pcapng),
            "bag" => Some(Self::Bag),
            "mcap" => Some(Self::Mcap),
            _ => None,
        }
    }

    /// Whether packets need to be assigned to a sensor: a bag has topics, and no addresses.
    pub fn needs_sensors(self) -> bool {
        matches!(self, Self::Bag | Self::Mcap)
    }
}

/// Why packets were not written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", path.display())]
pub(crate) struct PacketWriteError {
    path: PathBuf,
    cause: Cause,
}

/// The name of a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct TopicName(String);

/// What takes messages: a bag of either ROS.
trait MessageSink: Send {
    fn dialect(&self) -> Dialect;
    fn add_topic(&mut self, topic: &TopicName, kind: Kind) -> Result<u32, Cause>;
    fn write(&mut self, topic: u32, time_ns: u64, message: &[u8]) -> Result<(), Cause>;
    fn close(self: Box<Self>) -> Result<(), Cause>;
}

enum Sink {
    Pcap(PcapWriter<BufWriter<File>>),
    Pcapng(PcapngWriter<BufWriter<File>>, BTreeMap<String, u32>),
    Messages(Box<Messages>),
}

/// A file of packets being written.
pub(crate) struct PacketWriter {
    path: PathBuf,
    temporary: NamedTempFile,
    sink: Sink,
    packets: u64,
}

impl PacketWriter {
    pub fn create(path: &Path, format: PacketFormat) -> Result<Self, PacketWriteError> {
        let create = || -> Result<(NamedTempFile, Sink), Cause> {
            let temporary = files::temporary_near(path)?;
            let file = BufWriter::new(temporary.as_file().try_clone()?);
            let sink = match format {
                PacketFormat::Pcap => Sink::Pcap(PcapWriter::new(file)?),
                PacketFormat::Pcapng => Sink::Pcapng(PcapngWriter::new(file)?, BTreeMap::new()),
                PacketFormat::Bag => Sink::Messages(Messages::new(Box::new(ros1::Ros1Writer::new(file)?))),
                #[cfg(feature = "mcap")]
                PacketFormat::Mcap => Sink::Messages(Messages::new(Box::new(mcap::McapPackets::new(file)?))),
                #[cfg(not(feature = "mcap"))]
                PacketFormat::Mcap => return Err(crate::base::features::left_out("MCAP", "mcap").into()),
            };
            Ok((temporary, sink))
        };
        let (temporary, sink) =
            create().map_err(|cause| PacketWriteError { path: path.to_owned(), cause })?;
        Ok(Self { path: path.to_owned(), temporary, sink, packets: 0 })
    }

    /// Puts the metadata of a sensor before its packets, where the format has a place for them.
    pub fn add_metadata(&mut self, sensor: &str, time_ns: u64, text: &str) -> Result<(), PacketWriteError> {
        let Sink::Messages(messages) = &mut self.sink else { return Ok(()) };
        messages.add_metadata(sensor, time_ns, text).map_err(|cause| self.error(cause))
    }

    /// Puts where frames sit before the packets, where the format has a place for it.
    pub fn add_transforms(&mut self, time_ns: u64, frames: &[NamedFrame]) -> Result<(), PacketWriteError> {
        self.add_frames(TF_STATIC, time_ns, frames)
    }

    /// Adds where a frame was at a time, where the format has a place for it.
    pub fn add_pose(&mut self, time_ns: u64, frame: NamedFrame) -> Result<(), PacketWriteError> {
        self.add_frames(TF, time_ns, &[frame])
    }

    fn add_frames(
        &mut self,
        topic: &str,
        time_ns: u64,
        frames: &[NamedFrame],
    ) -> Result<(), PacketWriteError> {
        let Sink::Messages(messages) = &mut self.sink else { return Ok(()) };
        messages.add_frames(topic, time_ns, frames).map_err(|cause| self.error(cause))
    }

    /// Adds a packet of a sensor.
    pub fn write(&mut self, sensor: &str, packet: &Packet<'_>) -> Result<(), PacketWriteError> {
        let outcome = match &mut self.sink {
            Sink::Pcap(writer) => writer.write(packet).map_err(Cause::from),
            Sink::Pcapng(writer, interfaces) => match interfaces.get(sensor) {
                Some(interface) => writer.write(*interface, packet).map_err(Cause::from),
                None => writer.add_interface(sensor).map_err(Cause::from).and_then(|interface| {
                    interfaces.insert(sensor.to_owned(), interface);
                    Ok(writer.write(interface, packet)?)
                }),
            },
            Sink::Messages(messages) => messages.write(sensor, packet),
        };
        self.packets += u64::from(outcome.is_ok());
        outcome.map_err(|cause| self.error(cause))
    }

    /// Ends the file and gives it its name; how many packets it holds.
    pub fn finish(self) -> Result<u64, PacketWriteError> {
        let Self { path, temporary, sink, packets } = self;
        let close = || -> Result<(), Cause> {
            match sink {
                Sink::Pcap(writer) => drop(writer.close()?),
                Sink::Pcapng(writer, _) => writer.close(&[])?.flush()?,
                Sink::Messages(messages) => messages.close()?,
            }
            temporary.as_file().sync_all()?;
            temporary.persist(&path)?;
            Ok(())
        };
        close().map_err(|cause| PacketWriteError { path: path.clone(), cause })?;
        Ok(packets)
    }

    fn error(&self, cause: Cause) -> PacketWriteError {
        PacketWriteError { path: self.path.clone(), cause }
    }
}

/// Packets as messages of topics.
struct Messages {
    sink: Box<dyn MessageSink>,
    topics: BTreeMap<TopicName, u32>,
    /// Packets of each Velodyne that make one message, with their times.
    scans: BTreeMap<String, Vec<(u64, Vec<u8>)>>,
    sequence: u32,
}

impl Messages {
    fn new(sink: Box<dyn MessageSink>) -> Box<Self> {
        Box::new(Self { sink, topics: BTreeMap::new(), scans: BTreeMap::new(), sequence: 0 })
    }

    fn topic(&mut self, sensor: &str, what: &str, kind: Kind) -> Result<u32, Cause> {
        self.topic_called(TopicName(format!("/{}/{what}", namespace(sensor))), kind)
    }

    fn topic_called(&mut self, name: TopicName, kind: Kind) -> Result<u32, Cause> {
        if let Some(topic) = self.topics.get(&name) {
            return Ok(*topic);
        }
        let topic = self.sink.add_topic(&name, kind)?;
        self.topics.insert(name, topic);
        Ok(topic)
    }

    fn add_metadata(&mut self, sensor: &str, time_ns: u64, text: &str) -> Result<(), Cause> {
        let topic = self.topic(sensor, "metadata", Kind::Text)?;
        self.sink.write(topic, time_ns, &Message::text(self.sink.dialect(), text))
    }

    fn add_frames(&mut self, topic: &str, time_ns: u64, frames: &[NamedFrame]) -> Result<(), Cause> {
        let kind = if topic == TF { Kind::Poses } else { Kind::Transforms };
        let topic = self.topic_called(TopicName(topic.into()), kind)?;
        self.sink.write(topic, time_ns, &Message::transforms(self.sink.dialect(), time_ns, frames))
    }

    fn write(&mut self, sensor: &str, packet: &Packet<'_>) -> Result<(), Cause> {
        let (what, is_data) = match Guess::of(packet.payload) {
            Guess::VelodyneData => ("velodyne_packets", true),
            Guess::VelodynePosition => ("position_packets", false),
            Guess::OusterImu { .. } => ("imu_packets", false),
            Guess::OusterZone { .. } => ("zone_packets", false),
            _ => ("lidar_packets", false),
        };
        if is_data && packet.payload.len() == VELODYNE_BYTES {
            let scan = self.scans.entry(sensor.to_owned()).or_default();
            scan.push((packet.host_time_ns, packet.payload.to_vec()));
            if scan.len() == SCAN_PACKETS {
                self.write_scan(sensor)?;
            }
            return Ok(());
        }
        let topic = self.topic(sensor, what, Kind::Packet)?;
        self.sink.write(topic, packet.host_time_ns, &Message::packet(self.sink.dialect(), packet.payload))
    }

    fn write_scan(&mut self, sensor: &str) -> Result<(), Cause> {
        let Some(scan) = self.scans.remove(sensor) else { return Ok(()) };
        let topic = self.topic(sensor, "velodyne_packets", Kind::Scan)?;
        let time_ns = scan.last().map_or(0, |(time_ns, _)| *time_ns);
        let message = Message::scan(self.sink.dialect(), self.sequence, &namespace(sensor), &scan);
        self.sequence = self.sequence.wrapping_add(1);
        self.sink.write(topic, time_ns, &message)
    }

    fn close(mut self) -> Result<(), Cause> {
        for sensor in self.scans.keys().cloned().collect::<Vec<_>>() {
            self.write_scan(&sensor)?;
        }
        self.sink.close()
    }
}

/// A sensor's name as ROS allows names.
fn namespace(sensor: &str) -> String {
    let name: String = sensor.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_digit()) { format!("_{name}") } else { name }
}
