//! ROS 1 bags, format 2.0: records from front to back, also of a bag without index after its recorder was killed.
//! <https://wiki.ros.org/Bags/Format/2.0>

mod record;

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{BufReader, Read, Seek as _};

use self::record::{Fields, op, record};
use super::files::ROS1_MAGIC;
use super::unpack::{MOST_MESSAGE_BYTES, Packing, unpack};
use super::{BagError, BagFile, Container, Encoding, Losses, Topic};

/// Longest header of a record: the fields of a connection.
const MOST_HEADER_BYTES: u32 = 1 << 20;
/// Message definitions are the longest records after chunks and messages.
const MOST_CONNECTION_BYTES: u32 = 16 << 20;

pub(super) struct Ros1 {
    file: BufReader<File>,
    name: String,
    length: u64,
    /// Where the next record of the file begins.
    at: u64,
    topics: Vec<Topic>,
    /// Topic of each connection.
    connections: HashMap<u32, usize>,
    /// Connections with messages in the chunk at each place, as the index says.
    index: HashMap<u64, Vec<u32>>,
    /// Connections that are needed, where not all are.
    wanted: Option<HashSet<u32>>,
    chunk: Vec<u8>,
    /// Where its next record begins.
    chunk_at: usize,
    /// Where the chunk stands in the file.
    chunk_offset: u64,
    /// Place of the message in the chunk.
    message: std::ops::Range<usize>,
    losses: Losses,
    is_ended: bool,
}

impl Ros1 {
    pub fn open(bag_file: &BagFile) -> Result<Self, BagError> {
        let io = |source| bag_file.io("cannot be read", source);
        let file = crate::base::files::open(&bag_file.path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut bag = Self {
            file: BufReader::with_capacity(1 << 16, file),
            name: bag_file.name.clone(),
            length,
            at: ROS1_MAGIC.len() as u64,
            topics: Vec::new(),
            connections: HashMap::new(),
            index: HashMap::new(),
            wanted: None,
            chunk: Vec::new(),
            chunk_at: 0,
            chunk_offset: 0,
            message: 0..0,
            losses: Losses::default(),
            is_ended: false,
        };
        let mut magic = [0; ROS1_MAGIC.len()];
        bag.file.read_exact(&mut magic).map_err(io)?;
        if magic != *ROS1_MAGIC {
            let found = format!("a ROS 1 bag of another format ({})", magic.escape_ascii());
            let instead = "only format 2.0 is read; `rosbag fix OLD NEW` converts";
            return Err(BagError::Unsupported { name: bag.name, found, instead });
        }
        bag.read_bag_header()?;
        Ok(bag)
    }

    fn read_bag_header(&mut self) -> Result<(), BagError> {
        let Some((header, data_bytes)) = self.record_header()? else { return Ok(()) };
        let fields = Fields(&header);
        if fields.op() != Some(op::BAG_HEADER) {
            return Err(self.damaged(self.at, "another record", "the bag's header record (op 3)"));
        }
        if let Some(encryptor) = fields.text("encryptor").filter(|name| !name.is_empty()) {
            return Err(BagError::Unsupported {
                name: self.name.clone(),
                found: format!("a ROS 1 bag encrypted by {encryptor}"),
                instead: "decrypt it first: rosbag decrypt",
            });
        }
        let index_pos = fields.u64("index_pos").unwrap_or(0);
        self.at += 8 + header.len() as u64 + u64::from(data_bytes);
        let first = self.at;
        if (first..self.length).contains(&index_pos) {
            // what the index lacks comes with the messages
            self.read_index(index_pos)?;
            self.is_ended = false;
            self.losses = Losses::default();
        }
        self.at = first;
        self.seek(first)
    }

    fn read_index(&mut self, index_pos: u64) -> Result<(), BagError> {
        self.at = index_pos;
        self.seek(index_pos)?;
        while let Some((header, data_bytes)) = self.record_header()? {
            let fields = Fields(&header);
            let end = self.at + 8 + header.len() as u64 + u64::from(data_bytes);
            if end > self.length || !matches!(fields.op(), Some(op::CONNECTION | op::CHUNK_INFO)) {
                break;
            }
            if data_bytes <= MOST_CONNECTION_BYTES {
                let data = self.exactly(data_bytes as usize)?;
                match (fields.op(), fields.u64("chunk_pos")) {
                    (Some(op::CONNECTION), _) => self.meet_connection(&Fields(&header), &data),
                    (_, Some(place)) => {
                        let ids = data.chunks_exact(8).filter_map(|entry| entry.first_chunk::<4>());
                        self.index.insert(place, ids.map(|id| u32::from_le_bytes(*id)).collect());
                    }
                    _ => {}
                }
            }
            self.at = end;
            self.seek(end)?;
        }
        Ok(())
    }

    fn meet_connection(&mut self, fields: &Fields<'_>, data: &[u8]) {
        let inner = Fields(data);
        let (Some(id), Some(topic), Some(kind)) =
            (fields.u32("conn"), fields.text("topic"), inner.text("type"))
        else {
            return; // its messages are then of no known connection, and counted as such
        };
        let topic = Topic::new(topic, kind, Encoding::Ros1);
        let number = self.topics.iter().position(|known| *known == topic).unwrap_or_else(|| {
            self.topics.push(topic);
            self.topics.len() - 1
        });
        self.connections.insert(id, number);
    }

    /// The header of the record at `self.at` and the length of its data; none at the end of the file.
    fn record_header(&mut self) -> Result<Option<(Vec<u8>, u32)>, BagError> {
        let left = self.length.saturating_sub(self.at);
        if left == 0 {
            return Ok(None);
        }
        if left < 8 {
            self.end_cut(left, 8);
            return Ok(None);
        }
        let header_bytes = self.u32()?;
        if header_bytes > MOST_HEADER_BYTES {
            let found = format!("a record header of {header_bytes} bytes");
            return Err(self.damaged(self.at, found, "one of at most 1 MiB"));
        }
        let needed = 8 + u64::from(header_bytes);
        if left < needed {
            self.end_cut(left, needed);
            return Ok(None);
        }
        let header = self.exactly(header_bytes as usize)?;
        Ok(Some((header, self.u32()?)))
    }

    fn end_cut(&mut self, found: u64, expected: u64) {
        self.is_ended = true;
        self.losses.push(format!(
            "{}: the file ends inside the record at byte {}: {found} of {expected} bytes are there",
            self.name, self.at
        ));
    }

    fn u32(&mut self) -> Result<u32, BagError> {
        let mut bytes = [0; 4];
        self.file.read_exact(&mut bytes).map_err(|source| self.read_error(source))?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// So many bytes, of which is known that they are there.
    fn exactly(&mut self, count: usize) -> Result<Vec<u8>, BagError> {
        let mut bytes = vec![0; count];
        self.file.read_exact(&mut bytes).map_err(|source| self.read_error(source))?;
        Ok(bytes)
    }

    fn seek(&mut self, to: u64) -> Result<(), BagError> {
        // what is buffered already is not read again
        let here = self.file.stream_position().map_err(|source| self.read_error(source))?;
        let by = to.cast_signed() - here.cast_signed();
        self.file.seek_relative(by).map_err(|source| self.read_error(source))
    }

    fn read_error(&self, source: std::io::Error) -> BagError {
        BagError::Io { name: self.name.clone(), doing: "cannot be read", source }
    }

    fn damaged(&self, offset: u64, found: impl Into<String>, expected: &'static str) -> BagError {
        BagError::Damaged { name: self.name.clone(), offset, found: found.into(), expected }
    }

    /// Unpacks the chunk behind the header just read; what cannot be had is counted, and the next is found all the same.
    fn load_chunk(&mut self, fields: &Fields<'_>, data_bytes: u32, data_at: u64) -> Result<(), BagError> {
        let at = self.at;
        let packing = match fields.text("compression") {
            Some("none" | "") => Packing::None,
            Some("bz2") => Packing::Bz2,
            Some("lz4") => Packing::Lz4,
            other => {
                let found = format!("a chunk packed with {:?}", other.unwrap_or("nothing stated"));
                return Err(self.damaged(at, found, "none, bz2 or lz4"));
            }
        };
        let Some(size) = fields.u32("size") else {
            return Err(self.damaged(at, "a chunk without its size", "the field `size`"));
        };
        let there = u64::from(data_bytes).min(self.length - data_at);
        if size as usize > MOST_MESSAGE_BYTES {
            self.losses.push(format!(
                "{}: the chunk at byte {at} was not read: it says it unpacks to {size} bytes, expected at most {MOST_MESSAGE_BYTES}",
                self.name
            ));
            return Ok(());
        }
        let mut packed = (&mut self.file).take(there);
        let outcome = unpack(packing, &mut packed, size as usize, &mut self.chunk);
        (self.chunk_at, self.chunk_offset) = (0, at);
        let lost = match outcome {
            _ if there < u64::from(data_bytes) => {
                self.end_cut(data_at - at + there, data_at - at + u64::from(data_bytes));
                None
            }
            Err(error) => Some(format!("{error}")),
            Ok(()) if self.chunk.len() < size as usize => Some("its data end too early".into()),
            Ok(()) => None,
        };
        if let Some(why) = lost {
            let unpacked = self.chunk.len();
            self.losses.push(format!(
                "{}: the chunk at byte {at} gives {unpacked} of {size} bytes: {why}",
                self.name
            ));
        }
        Ok(())
    }

    /// The next message of the chunk.
    fn next_in_chunk(&mut self) -> Option<(usize, u64)> {
        while self.chunk_at < self.chunk.len() {
            let chunk = std::mem::take(&mut self.chunk);
            let found = record(&chunk, self.chunk_at);
            let Some((fields, content)) = found else {
                // what a cut chunk lacks was reported
                if !self.is_ended {
                    self.losses.push(format!(
                        "{}: the chunk at byte {}: no whole record at {} of its {} bytes; its rest is lost",
                        self.name,
                        self.chunk_offset,
                        self.chunk_at,
                        chunk.len()
                    ));
                }
                return None;
            };
            self.chunk_at = content.end;
            let found = self.in_memory(&fields, &chunk[content.clone()]);
            self.chunk = chunk;
            if found.is_some() {
                self.message = content;
                return found;
            }
        }
        None
    }

    /// What a record that lies in memory is: a message, or something learnt.
    fn in_memory(&mut self, fields: &Fields<'_>, data: &[u8]) -> Option<(usize, u64)> {
        match fields.op() {
            Some(op::CONNECTION) => self.meet_connection(fields, data),
            Some(op::MESSAGE) => {
                let id = fields.u32("conn")?;
                let is_wanted = self.wanted.as_ref().is_none_or(|wanted| wanted.contains(&id));
                let found = self.connections.get(&id).copied().zip(fields.time_ns("time"));
                if found.is_none() {
                    self.losses.push(format!(
                        "{}: the chunk at byte {}: a message of connection {id}, which the bag does not describe",
                        self.name, self.chunk_offset
                    ));
                }
                return found.filter(|_| is_wanted);
            }
            _ => {}
        }
        None
    }
}

impl Container for Ros1 {
    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn advance(&mut self) -> Result<Option<(usize, u64)>, BagError> {
        loop {
            if let Some(found) = self.next_in_chunk() {
                return Ok(Some(found));
            }
            self.chunk.clear();
            if self.is_ended {
                return Ok(None);
            }
            let Some((header, data_bytes)) = self.record_header()? else {
                self.is_ended = true;
                return Ok(None);
            };
            let fields = Fields(&header);
            let data_at = self.at + 8 + header.len() as u64;
            let end = data_at + u64::from(data_bytes);
            match fields.op() {
                Some(op::CHUNK) => {
                    let wanted = self.wanted.as_ref().zip(self.index.get(&self.at));
                    if wanted.is_none_or(|(wanted, held)| held.iter().any(|id| wanted.contains(id))) {
                        self.load_chunk(&fields, data_bytes, data_at)?;
                    }
                }
                Some(op::CONNECTION | op::MESSAGE) if end <= self.length => {
                    // a record outside of chunks is read as a chunk of one
                    if data_bytes as usize > MOST_MESSAGE_BYTES {
                        return Err(self.damaged(
                            self.at,
                            format!("a record of {data_bytes} bytes"),
                            "256 MiB at most",
                        ));
                    }
                    let data = self.exactly(data_bytes as usize)?;
                    let mut whole = u32::try_from(header.len()).unwrap_or(0).to_le_bytes().to_vec();
                    whole.extend(&header);
                    whole.extend(data_bytes.to_le_bytes());
                    whole.extend(data);
                    (self.chunk, self.chunk_at, self.chunk_offset) = (whole, 0, self.at);
                }
                Some(op::INDEX | op::CHUNK_INFO | op::BAG_HEADER | op::CONNECTION | op::MESSAGE) => {
                    if end > self.length {
                        self.end_cut(self.length - self.at, end - self.at);
                    }
                }
                found => {
                    let found =
                        found.map_or("a record without op".into(), |op| format!("a record of op {op}"));
                    return Err(self.damaged(self.at, found, "op 2 to 7"));
                }
            }
            self.at = end.min(self.length);
            self.seek(self.at)?;
        }
    }

    fn data(&self) -> &[u8] {
        &self.chunk[self.message.clone()]
    }

    fn restrict(&mut self, is_wanted: &dyn Fn(&Topic) -> bool) -> bool {
        if self.index.is_empty() {
            return false; // connections that are not met yet could be wanted
        }
        let wanted = self.connections.iter().filter(|(_, at)| is_wanted(&self.topics[**at]));
        let wanted: HashSet<u32> = wanted.map(|(id, _)| *id).collect();
        self.is_ended |= wanted.is_empty();
        self.wanted = Some(wanted);
        true
    }

    fn position(&self) -> u64 {
        self.at
    }

    fn losses(&self) -> &Losses {
        &self.losses
    }
}
