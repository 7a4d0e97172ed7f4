//! Writes ROS 1 bags, format 2.0, with their index. <https://wiki.ros.org/Bags/Format/2.0>

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};

use super::message::{Dialect, Kind};
use super::{MessageSink, TopicName};

const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Length at which a chunk is closed, as `rosbag record` does.
const CHUNK_BYTES: usize = 768 << 10;
/// The bag's header is padded so that the first chunk begins here.
const FIRST_CHUNK_AT: u64 = 4109;

pub(super) struct Ros1Writer<W: Write + Seek> {
    sink: W,
    at: u64,
    chunk: Vec<u8>,
    /// Times and places of the messages of each connection in the chunk.
    in_chunk: BTreeMap<u32, Vec<(u64, u32)>>,
    connections: Vec<Vec<u8>>,
    chunks: Vec<ChunkInfo>,
}

struct ChunkInfo {
    place: u64,
    /// First and last time of its messages.
    span_ns: [u64; 2],
    /// Connection and number of messages.
    counts: Vec<(u32, u32)>,
}

fn field(into: &mut Vec<u8>, name: &str, value: &[u8]) {
    into.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
    into.extend_from_slice(name.as_bytes());
    into.push(b'=');
    into.extend_from_slice(value);
}

fn fields(of: &[(&str, &[u8])]) -> Vec<u8> {
    let mut header = Vec::new();
    of.iter().for_each(|(name, value)| field(&mut header, name, value));
    header
}

fn time(time_ns: u64) -> [u8; 8] {
    let seconds = ((time_ns / 1_000_000_000) as u32).to_le_bytes(); // till 2106
    let nanoseconds = ((time_ns % 1_000_000_000) as u32).to_le_bytes();
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&seconds);
    bytes[4..].copy_from_slice(&nanoseconds);
    bytes
}

fn append(into: &mut Vec<u8>, header: &[u8], data: &[u8]) {
    into.extend((header.len() as u32).to_le_bytes());
    into.extend_from_slice(header);
    into.extend((data.len() as u32).to_le_bytes());
    into.extend_from_slice(data);
}

impl<W: Write + Seek> Ros1Writer<W> {
    pub fn new(sink: W) -> io::Result<Self> {
        let mut writer = Self {
            sink,
            at: 0,
            chunk: Vec::with_capacity(CHUNK_BYTES + (64 << 10)),
            in_chunk: BTreeMap::new(),
            connections: Vec::new(),
            chunks: Vec::new(),
        };
        writer.write_header(0)?;
        Ok(writer)
    }

    /// The bag's header; the place of the index is known at the end.
    fn write_header(&mut self, index_pos: u64) -> io::Result<()> {
        let (connections, chunks) = (self.connections.len() as u32, self.chunks.len() as u32);
        let header = fields(&[
            ("op", &[3]),
            ("index_pos", &index_pos.to_le_bytes()),
            ("conn_count", &connections.to_le_bytes()),
            ("chunk_count", &chunks.to_le_bytes()),
        ]);
        let padding = FIRST_CHUNK_AT as usize - MAGIC.len() - 8 - header.len();
        let mut record = MAGIC.to_vec();
        append(&mut record, &header, &vec![b' '; padding]);
        self.sink.seek(SeekFrom::Start(0))?;
        self.sink.write_all(&record)?;
        self.at = FIRST_CHUNK_AT;
        Ok(())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.sink.write_all(bytes)
    }

    fn close_chunk(&mut self) -> io::Result<()> {
        if self.in_chunk.is_empty() {
            return Ok(());
        }
        let place = self.at;
        let (chunk, in_chunk) = (std::mem::take(&mut self.chunk), std::mem::take(&mut self.in_chunk));
        let header =
            fields(&[("op", &[5]), ("compression", b"none"), ("size", &(chunk.len() as u32).to_le_bytes())]);
        let mut record = (header.len() as u32).to_le_bytes().to_vec();
        record.extend(&header);
        record.extend((chunk.len() as u32).to_le_bytes());
        self.write_all(&record)?;
        self.write_all(&chunk)?;
        let times = in_chunk.values().flatten().map(|(time_ns, _)| *time_ns);
        let span_ns = [times.clone().min().unwrap_or(0), times.max().unwrap_or(0)];
        for (id, messages) in &in_chunk {
            let header = fields(&[
                ("op", &[4]),
                ("ver", &1_u32.to_le_bytes()),
                ("conn", &id.to_le_bytes()),
                ("count", &(messages.len() as u32).to_le_bytes()),
            ]);
            let mut data = Vec::new();
            for (time_ns, offset) in messages {
                data.extend(time(*time_ns));
                data.extend(offset.to_le_bytes());
            }
            let mut record = Vec::new();
            append(&mut record, &header, &data);
            self.write_all(&record)?;
        }
        let counts = in_chunk.iter().map(|(id, messages)| (*id, messages.len() as u32)).collect();
        self.chunks.push(ChunkInfo { place, span_ns, counts });
        self.chunk = chunk;
        self.chunk.clear();
        Ok(())
    }
}

impl<W: Write + Seek + Send> MessageSink for Ros1Writer<W> {
    fn dialect(&self) -> Dialect {
        Dialect::Ros1
    }

    fn add_topic(&mut self, topic: &TopicName, kind: Kind) -> Result<u32, super::Cause> {
        let id = self.connections.len() as u32; // of few sensors
        let header = fields(&[("op", &[7]), ("conn", &id.to_le_bytes()), ("topic", topic.0.as_bytes())]);
        let is_latched: &[u8] = if matches!(kind, Kind::Text | Kind::Transforms) { b"1" } else { b"0" };
        let data = fields(&[
            ("topic", topic.0.as_bytes()),
            ("type", kind.ros1_name().as_bytes()),
            ("md5sum", kind.md5().as_bytes()),
            ("message_definition", kind.definition(Dialect::Ros1).as_bytes()),
            ("callerid", b"/outrigger"),
            ("latching", is_latched),
        ]);
        let mut record = Vec::new();
        append(&mut record, &header, &data);
        self.chunk.extend_from_slice(&record);
        self.connections.push(record);
        Ok(id)
    }

    fn write(&mut self, topic: u32, time_ns: u64, message: &[u8]) -> Result<(), super::Cause> {
        if time_ns / 1_000_000_000 > u64::from(u32::MAX) {
            return Err("a ROS 1 bag holds times up to 2106".into());
        }
        let header = fields(&[("op", &[2]), ("conn", &topic.to_le_bytes()), ("time", &time(time_ns))]);
        self.in_chunk.entry(topic).or_default().push((time_ns, self.chunk.len() as u32));
        append(&mut self.chunk, &header, message);
        if self.chunk.len() >= CHUNK_BYTES {
            self.close_chunk()?;
        }
        Ok(())
    }

    fn close(mut self: Box<Self>) -> Result<(), super::Cause> {
        self.close_chunk()?;
        let index_pos = self.at;
        let mut index = self.connections.concat();
        for ChunkInfo { place, span_ns: [first_ns, last_ns], counts } in &self.chunks {
            let header = fields(&[
                ("op", &[6]),
                ("ver", &1_u32.to_le_bytes()),
                ("chunk_pos", &place.to_le_bytes()),
                ("start_time", &time(*first_ns)),
                ("end_time", &time(*last_ns)),
                ("count", &(counts.len() as u32).to_le_bytes()),
            ]);
            let data: Vec<u8> = counts
                .iter()
                .flat_map(|(id, count)| [id.to_le_bytes(), count.to_le_bytes()].concat())
                .collect();
            append(&mut index, &header, &data);
        }
        self.write_all(&index)?;
        self.write_header(index_pos)?;
        Ok(self.sink.flush()?)
    }
}
