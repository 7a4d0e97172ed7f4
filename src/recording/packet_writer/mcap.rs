//! Writes MCAP files with ROS 2 messages, as rosbag2 does.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use super::message::{Dialect, Kind};
use super::{Cause, MessageSink, TopicName};

pub(super) struct McapPackets<W: Write + Seek> {
    writer: Writer<W>,
    schemas: BTreeMap<&'static str, u16>,
    sequences: BTreeMap<u16, u32>,
}

impl<W: Write + Seek> McapPackets<W> {
    pub fn new(sink: W) -> Result<Self, Cause> {
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("outrigger ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd));
        Ok(Self { writer: options.create(sink)?, schemas: BTreeMap::new(), sequences: BTreeMap::new() })
    }
}

impl<W: Write + Seek + Send> MessageSink for McapPackets<W> {
    fn dialect(&self) -> Dialect {
        Dialect::Ros2
    }

    fn add_topic(&mut self, topic: &TopicName, kind: Kind) -> Result<u32, Cause> {
        let schema = match self.schemas.get(kind.ros2_name()) {
            Some(schema) => *schema,
            None => {
                let definition = kind.definition(Dialect::Ros2);
                self.writer.add_schema(kind.ros2_name(), "ros2msg", definition.as_bytes())?
            }
        };
        self.schemas.insert(kind.ros2_name(), schema);
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        Ok(self.writer.add_channel(schema, &topic.0, "cdr", &metadata)?.into())
    }

    fn write(&mut self, topic: u32, time_ns: u64, message: &[u8]) -> Result<(), Cause> {
        let channel_id = u16::try_from(topic)?;
        let sequence = self.sequences.entry(channel_id).or_default();
        let header =
            MessageHeader { channel_id, sequence: *sequence, log_time: time_ns, publish_time: time_ns };
        *sequence = sequence.wrapping_add(1);
        Ok(self.writer.write_to_known_channel(&header, message)?)
    }

    fn close(mut self: Box<Self>) -> Result<(), Cause> {
        self.writer.finish()?;
        Ok(self.writer.into_inner().flush()?)
    }
}
