//! MCAP: points and inertial samples as ROS 2 or Foxglove messages, one topic each per sensor.
//!
//! Source: MCAP specification, version 0.

mod cdr;
mod ros2;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write as _;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use sensors::ouster::ImuSample;

use super::sink::{Failure, Sink};
use super::{Cause, Cloud, CloudWriter, Kind, Source, Topic, foxglove, topic};
use crate::recording::packet_writer::{TF, TF_STATIC, ros2_transforms};
use crate::rig::NamedFrame;

/// Which messages a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Ros2,
    Foxglove,
}

pub(super) struct McapWriter {
    writer: Writer<Sink>,
    failure: Failure,
    dialect: Dialect,
    schemas: BTreeMap<&'static str, u16>,
    topics: BTreeMap<String, (u16, Topic)>,
}

impl McapWriter {
    pub(super) fn new(file: File, dialect: Dialect) -> Result<Self, Cause> {
        let options = WriteOptions::new()
            .profile(if dialect == Dialect::Ros2 { "ros2" } else { "" })
            .library(concat!("outrigger ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd));
        let (sink, failure) = Sink::new(file);
        let writer = options.create(sink)?;
        Ok(Self { writer, failure, dialect, schemas: BTreeMap::new(), topics: BTreeMap::new() })
    }

    fn write(&mut self, name: String, kind: &Kind, times_ns: [u64; 2], message: &[u8]) -> Result<(), Cause> {
        let [log_time, publish_time] = times_ns;
        if !self.topics.contains_key(&name) {
            let schema = match self.schemas.get(kind.schema) {
                Some(schema) => *schema,
                None => self.writer.add_schema(kind.schema, kind.schema_encoding, &(kind.schema_data)())?,
            };
            self.schemas.insert(kind.schema, schema);
            let metadata = match self.dialect {
                Dialect::Ros2 => BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]),
                Dialect::Foxglove => BTreeMap::new(),
            };
            let channel = self.writer.add_channel(schema, &name, kind.encoding, &metadata)?;
            let topic =
                Topic { name: name.clone(), kind: kind.schema, messages: 0, log_time_ns: [log_time; 2] };
            self.topics.insert(name.clone(), (channel, topic));
        }
        if let Some((channel_id, topic)) = self.topics.get_mut(&name) {
            let [first, last] = topic.log_time_ns;
            topic.log_time_ns = [first.min(log_time), last.max(log_time)];
            let sequence = topic.messages;
            topic.messages = topic.messages.wrapping_add(1);
            let header = MessageHeader { channel_id: *channel_id, sequence, log_time, publish_time };
            self.writer.write_to_known_channel(&header, message)?;
        }
        self.failure.check()
    }
}

impl CloudWriter for McapWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        let stamp_ns = cloud.stamp_ns();
        let log_time_ns = if cloud.host_time_ns > 0 { cloud.host_time_ns } else { stamp_ns };
        let (kind, message) = match self.dialect {
            Dialect::Ros2 => (&ros2::POINTS, ros2::points(cloud)?),
            Dialect::Foxglove => (&foxglove::POINTS, foxglove::points(cloud)?),
        };
        self.write(topic(&cloud.source.id, kind.topic), kind, [log_time_ns, stamp_ns], &message)
    }

    fn add_imu(&mut self, source: &Source, sample: &ImuSample, host_time_ns: u64) -> Result<(), Cause> {
        if self.dialect == Dialect::Foxglove {
            return Ok(()); // Foxglove has no schema of its own for inertial samples
        }
        let stamp_ns = super::cloud::stamp_ns(sample.time_ns, host_time_ns);
        let message = ros2::imu(source, sample, stamp_ns);
        self.write(topic(&source.id, ros2::IMU.topic), &ros2::IMU, [host_time_ns, stamp_ns], &message)
    }

    fn add_frames(
        &mut self,
        is_static: bool,
        times_ns: [u64; 2],
        frames: &[NamedFrame],
    ) -> Result<(), Cause> {
        let [_, stamp_ns] = times_ns;
        let (kind, message) = match self.dialect {
            Dialect::Ros2 => (&ros2::TRANSFORMS, ros2_transforms(stamp_ns, frames)),
            Dialect::Foxglove => {
                let frames: Vec<_> = frames
                    .iter()
                    .map(|frame| (frame.parent.as_str(), frame.name.as_str(), frame.parent_from_frame))
                    .collect();
                (&foxglove::TRANSFORMS, foxglove::transforms(stamp_ns, &frames)?)
            }
        };
        let topic = if is_static { TF_STATIC } else { TF };
        self.write(topic.to_owned(), kind, times_ns, &message)
    }

    fn topics(&self) -> Vec<Topic> {
        self.topics.values().map(|(_, topic)| topic.clone()).collect()
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        let Self { mut writer, failure, .. } = *self;
        writer.finish()?;
        writer.into_inner().flush()?;
        failure.check()
    }
}
