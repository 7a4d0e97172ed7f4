//! The sensors' packets in a bag, in the order of their record. A bag has no addresses: each sensor gets one of the range for
//! documentation (192.0.2.0/24), and the ports that its kind sends to by default.

mod described;
mod layout;

use std::collections::VecDeque;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use sensors::Packet;

use self::layout::{
    OUSTER_IMU_PORT, OUSTER_LIDAR_PORT, VELODYNE_PORT, VELODYNE_POSITION_PORT, ouster_packet, ouster_port,
    sensor_name, velodyne_packet, velodyne_scan, without_extra_byte,
};
use super::cursor::Cursor;
use super::files::{self, BagFiles};
use super::roles::Role;
use super::unpack::{ZSTD, unpack_zstd};
use super::{BagError, BagReader, Topic};

/// Most sensors that get an address of their own.
const MOST_SENSORS: usize = 250;
/// Metadata is not looked for behind so many messages, where no index says where it is.
const MOST_MESSAGES_AHEAD: u64 = 20_000;
/// Messages within which every topic of a recording has appeared.
const MEET_MESSAGES: u64 = 1000;

/// A sensor of a bag: topics that share a namespace.
#[derive(Clone, Debug)]
pub struct BagSensor {
    /// Its namespace without the leading slash; its topic where it has none.
    pub name: String,
    /// Where its packets seem to come from.
    pub address: IpAddr,
    /// Where its lidar packets seem to go to.
    pub port: u16,
    /// Metadata as text and its topic, for an Ouster if the driver recorded them.
    pub metadata: Option<(String, String)>,
}

impl BagSensor {
    /// Whether its packets are those of an Ouster.
    pub fn is_ouster(&self) -> bool {
        self.port == OUSTER_LIDAR_PORT
    }

    /// The port that its auxiliary stream seems to use.
    pub fn auxiliary_port(&self) -> u16 {
        if self.is_ouster() { OUSTER_IMU_PORT } else { VELODYNE_POSITION_PORT }
    }
}

pub(crate) use described::{metadata_in, names_in, notices_of};

/// What a topic held.
#[derive(Clone, Debug, serde::Serialize)]
pub struct TopicCount {
    /// Its name.
    pub topic: String,
    /// Type of its messages.
    #[serde(rename = "type")]
    pub kind: String,
    /// Messages read.
    pub messages: u64,
    /// Packets in them.
    pub packets: u64,
    /// When its first and last message were recorded, ns since 1970.
    pub span_ns: Option<[u64; 2]>,
    /// Messages that could not be read.
    pub malformed: u64,
    /// Where its packets seem to come from.
    #[serde(skip)]
    pub from: Option<SocketAddr>,
}

/// One packet of a bag.
pub struct BagPacket<'a> {
    /// Number of its topic.
    pub topic: usize,
    /// When its message was recorded, ns since 1970.
    pub record_time_ns: u64,
    /// As its message holds it: old drivers of Ouster wrote a byte too many.
    pub stored: &'a [u8],
    /// As the sensor sent it.
    pub packet: Packet<'a>,
}

/// Reads the packets of a bag, all its files in order.
pub struct BagPackets {
    reader: BagReader,
    roles: Vec<Role>,
    sensors: Vec<BagSensor>,
    /// Metadata with no packets in their namespace: text and topic.
    unassigned: Vec<(String, String)>,
    counts: Vec<TopicCount>,
    holds_clouds_only: bool,
    /// The message at hand, unpacked.
    message: Vec<u8>,
    /// Its packets: their times and places in it.
    waiting: VecDeque<(u64, Range<usize>)>,
    topic: usize,
    record_time_ns: u64,
    notices: Vec<String>,
}

impl BagPackets {
    /// Opens a bag, which messages call so, and looks for the metadata of its sensors.
    pub fn open(path: &Path, name: &str) -> Result<Self, BagError> {
        let files = Arc::new(files::find(path, name)?);
        let mut ahead = Self::begin(files.clone())?;
        ahead.look_for_metadata()?;
        let mut packets = Self::begin(files)?;
        packets.sensors = ahead.sensors;
        let has = |is_meant: &dyn Fn(&Role) -> bool| ahead.roles.iter().any(is_meant);
        packets.holds_clouds_only = has(&|role| matches!(role, Role::Cloud | Role::LivoxCloud))
            && !has(&|role| role.has_packets() || matches!(role, Role::OtherPackets(_)));
        packets.unassigned = ahead.unassigned;
        Ok(packets)
    }

    fn begin(files: Arc<BagFiles>) -> Result<Self, BagError> {
        let mut packets = Self {
            reader: BagReader::new(files)?,
            unassigned: Vec::new(),
            holds_clouds_only: false,
            roles: Vec::new(),
            sensors: Vec::new(),
            counts: Vec::new(),
            message: Vec::new(),
            waiting: VecDeque::new(),
            topic: 0,
            record_time_ns: 0,
            notices: Vec::new(),
        };
        packets.learn_topics();
        Ok(packets)
    }

    /// All topics met so far.
    pub fn topics(&self) -> &[Topic] {
        self.reader.topics()
    }

    /// The sensors that were met, in the order of their topics.
    pub fn sensors(&self) -> &[BagSensor] {
        &self.sensors
    }

    /// Metadata with no packets in their namespace: text and topic.
    pub fn unassigned_metadata(&self) -> &[(String, String)] {
        &self.unassigned
    }

    /// Whether there are topics with clouds and none with packets.
    pub fn holds_clouds_only(&self) -> bool {
        self.holds_clouds_only
    }

    /// What each topic held so far.
    pub fn counts(&self) -> &[TopicCount] {
        &self.counts
    }

    /// What is missing so far, in words.
    pub fn losses(&self) -> Vec<String> {
        let malformed = self.counts.iter().filter(|count| count.malformed > 0);
        let malformed = malformed.map(|TopicCount { topic, kind, messages, malformed, .. }| {
            format!("{topic}: {malformed} of {messages} messages are no {kind}")
        });
        self.reader.losses().into_iter().chain(malformed).chain(self.notices.iter().cloned()).collect()
    }

    /// Packets that are in it and are not read: topic, maker and number of messages.
    pub fn other_packets(&self) -> impl Iterator<Item = (&TopicCount, &'static str)> {
        self.counts.iter().zip(&self.roles).filter_map(|(count, role)| match role {
            Role::OtherPackets(maker) => Some((count, *maker)),
            _ => None,
        })
    }

    /// What the messages of a topic are.
    pub fn role(&self, topic: usize) -> Role {
        self.roles[topic]
    }

    /// Bytes read, to show progress.
    pub fn position(&self) -> u64 {
        self.reader.position()
    }

    /// The next packet.
    #[expect(clippy::should_implement_trait, reason = "an Iterator cannot lend its buffer")]
    pub fn next(&mut self) -> Result<Option<BagPacket<'_>>, BagError> {
        let (host_time_ns, place) = loop {
            if let Some(found) = self.waiting.pop_front() {
                break found;
            }
            if !self.next_message()? {
                return Ok(None);
            }
        };
        let (topic, record_time_ns) = (self.topic, self.record_time_ns);
        self.counts[topic].packets += 1;
        let stored = &self.message[place];
        let is_ouster = self.roles[topic] == Role::OusterPacket;
        let payload = if is_ouster { without_extra_byte(stored) } else { stored };
        // every topic with packets has one
        let source = self.counts[topic].from.unwrap_or(SocketAddr::new(RECEIVER, VELODYNE_PORT));
        let destination = SocketAddr::new(RECEIVER, source.port());
        let packet = Packet { host_time_ns, source, destination, link: sensors::Link::default(), payload };
        Ok(Some(BagPacket { topic, record_time_ns, stored, packet }))
    }

    /// Goes on to the next message and finds its packets; false at the end.
    fn next_message(&mut self) -> Result<bool, BagError> {
        let Some((topic, time_ns)) = self.reader.advance()? else { return Ok(false) };
        (self.topic, self.record_time_ns) = (topic, time_ns);
        self.learn_topics();
        let role = self.roles[topic];
        let is_readable = !(role.has_packets() || role == Role::OusterMetadata) || self.take_message();
        let count = &mut self.counts[topic];
        count.messages += 1;
        let span_ns = count.span_ns.get_or_insert([time_ns; 2]);
        *span_ns = [span_ns[0].min(time_ns), span_ns[1].max(time_ns)];
        let encoding = self.reader.topics()[topic].encoding;
        let found = match role {
            Role::OusterPacket => ouster_packet(encoding, &self.message).map(|place| vec![(time_ns, place)]),
            Role::VelodyneScan => velodyne_scan(encoding, &self.message),
            Role::VelodynePacket => velodyne_packet(encoding, &self.message).map(|found| vec![found]),
            Role::OusterMetadata => {
                self.check_metadata(topic);
                return Ok(true);
            }
            _ => return Ok(true),
        };
        match found.filter(|_| is_readable) {
            Some(found) => self.waiting.extend(found),
            None => self.counts[topic].malformed += 1,
        }
        Ok(true)
    }

    /// Keeps the message at hand, unpacked: rosbag2 may pack each by itself, whatever its file is.
    fn take_message(&mut self) -> bool {
        let data = self.reader.data();
        if data.starts_with(&ZSTD) {
            return unpack_zstd(data, &mut self.message).is_ok();
        }
        self.message.clear();
        self.message.extend_from_slice(data);
        true
    }

    fn learn_topics(&mut self) {
        for topic in &self.reader.topics()[self.roles.len()..] {
            let role = Role::of(topic);
            self.roles.push(role);
            let is_known = |sensor: &BagSensor| sensor.name == sensor_name(topic, role);
            let sensor = role.has_packets().then(|| {
                self.sensors.iter().position(is_known).unwrap_or_else(|| {
                    let number = self.sensors.len().min(MOST_SENSORS) as u8; // fits
                    self.sensors.push(BagSensor {
                        name: sensor_name(topic, role),
                        address: Ipv4Addr::new(192, 0, 2, 1 + number).into(),
                        port: if role == Role::OusterPacket { OUSTER_LIDAR_PORT } else { VELODYNE_PORT },
                        metadata: None,
                    });
                    self.sensors.len() - 1
                })
            });
            if let Some(sensor) = sensor
                && role != Role::OusterPacket
            {
                self.sensors[sensor].port = VELODYNE_PORT;
            }
            self.counts.push(TopicCount {
                topic: topic.name.clone(),
                kind: topic.kind.clone(),
                messages: 0,
                packets: 0,
                span_ns: None,
                malformed: 0,
                from: sensor.map(|sensor| {
                    let port =
                        if role == Role::OusterPacket { ouster_port(&topic.name) } else { VELODYNE_PORT };
                    SocketAddr::new(self.sensors[sensor].address, port)
                }),
            });
        }
    }

    /// The text of the message at hand.
    fn text(&self, topic: usize) -> Option<String> {
        let encoding = self.reader.topics()[topic].encoding;
        Cursor::new(encoding, &self.message)?.string().map(str::to_owned)
    }

    /// Reads on until every Ouster has its metadata, or nothing is left that could be some.
    fn look_for_metadata(&mut self) -> Result<(), BagError> {
        let is_text = |at: &usize| self.roles[*at] == Role::OusterMetadata;
        let wanted: Vec<usize> = (0..self.roles.len()).filter(is_text).collect();
        let is_indexed = self.reader.restrict(wanted);
        let mut looked_at = 0;
        while looked_at < MOST_MESSAGES_AHEAD && self.next_message()? {
            self.waiting.clear();
            looked_at += 1;
            // without an index others may come, but seldom so late
            if (is_indexed || looked_at >= MEET_MESSAGES) && self.are_all_described() {
                break;
            }
        }
        Ok(())
    }

    fn are_all_described(&self) -> bool {
        self.sensors.iter().all(|sensor| !sensor.is_ouster() || sensor.metadata.is_some())
    }

    /// Stores the metadata of a sensor; later ones that differ are reported.
    fn check_metadata(&mut self, topic: usize) {
        let Some(text) = self.text(topic) else {
            self.counts[topic].malformed += 1;
            return;
        };
        let about = &self.reader.topics()[topic];
        let name = sensor_name(about, Role::OusterMetadata);
        let Some(sensor) = self.sensors.iter_mut().find(|sensor| sensor.name == name) else {
            let found = (text, about.name.clone());
            if !self.unassigned.contains(&found) && self.unassigned.len() < MOST_SENSORS {
                self.unassigned.push(found);
            }
            return;
        };
        match &sensor.metadata {
            None => sensor.metadata = Some((text, about.name.clone())),
            Some((known, _)) if *known == text => {}
            Some(_) => {
                let at_s = self.record_time_ns as f64 * 1e-9;
                let words = format!(
                    "{}: the metadata change at {at_s:.3} s; the first are used for all packets: cut the bag there",
                    about.name
                );
                if !self.notices.contains(&words) && self.notices.len() < 16 {
                    self.notices.push(words);
                }
            }
        }
    }
}

/// Where packets seem to go to.
const RECEIVER: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 255));
