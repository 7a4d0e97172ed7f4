//! MCAP files: record by record, each chunk for itself, so that one that is damaged or cut off costs no other.
//! <https://mcap.dev/spec>

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek as _, SeekFrom};

use super::cursor::Cursor;
use super::files::MCAP_MAGIC;
use super::unpack::{MOST_MESSAGE_BYTES, Packing, unpack};
use super::{BagError, BagFile, Container, Encoding, Losses, Topic};

/// Longest summary.
const MOST_SUMMARY_BYTES: u64 = 64 << 20;
/// Operation and length of a record.
const RECORD_HEAD_BYTES: u64 = 9;
/// The last record: where the summary begins, where its offsets do, and its checksum.
const FOOTER_BYTES: u64 = RECORD_HEAD_BYTES + 20;

/// Operations of records. The `mcap` library, which writes these files here, takes memory as the lengths in a record ask for it:
/// a damaged one ends the program.
mod op {
    pub(super) const FOOTER: u8 = 2;
    pub(super) const SCHEMA: u8 = 3;
    pub(super) const CHANNEL: u8 = 4;
    pub(super) const MESSAGE: u8 = 5;
    pub(super) const CHUNK: u8 = 6;
    pub(super) const CHUNK_INDEX: u8 = 8;
    pub(super) const DATA_END: u8 = 15;
}

/// The first record of these bytes: its operation, its content, and what comes behind it.
fn split_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let ([opcode, length @ ..], rest) = bytes.split_first_chunk::<{ RECORD_HEAD_BYTES as usize }>()?;
    let (body, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((*opcode, body, rest))
}

/// Where a chunk begins, and the channels that it holds messages of.
fn chunk_index(body: &[u8]) -> Option<(u64, Vec<u16>)> {
    let mut fields = Cursor::packed(body);
    let (_first_ns, _last_ns, offset, _bytes) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u64()?);
    let channels = fields.bytes()?.chunks_exact(10);
    Some((offset, channels.map(|entry| u16::from_le_bytes([entry[0], entry[1]])).collect()))
}

pub(super) struct Mcap {
    file: BufReader<File>,
    name: String,
    length: u64,
    /// Where the next record of the file begins.
    at: u64,
    chunk: Chunk,
    schemas: HashMap<u16, String>,
    /// Topic of each channel.
    channels: HashMap<u16, usize>,
    topics: Vec<Topic>,
    /// Chunks that hold the channels that are needed, last first, where not all are.
    plan: Option<Vec<u64>>,
    /// Chunks that the index lists, and channels with messages in each.
    index: Vec<(u64, Vec<u16>)>,
    message: Vec<u8>,
    losses: Losses,
    is_ended: bool,
}

/// The unpacked records of a chunk.
#[derive(Default)]
struct Chunk {
    records: Vec<u8>,
    /// Where the next one begins.
    next: usize,
    /// Where the chunk stands in the file.
    at: u64,
}

/// What stands before the records of a chunk.
struct ChunkHeader {
    unpacked_bytes: u64,
    crc: u32,
    packing: Option<Packing>,
    packed_bytes: u64,
    /// Its own length.
    bytes: u64,
}

impl ChunkHeader {
    fn read(from: &mut impl Read) -> std::io::Result<Self> {
        let mut start = [0; 32];
        from.read_exact(&mut start)?;
        let u32_at = |at: usize| u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]);
        let name_bytes = u32_at(28);
        if name_bytes > 64 {
            let why = format!("a name of {name_bytes} bytes for its compression");
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, why));
        }
        let mut name = vec![0; name_bytes as usize];
        from.read_exact(&mut name)?;
        let mut packed_bytes = [0; 8];
        from.read_exact(&mut packed_bytes)?;
        let packing = match &name[..] {
            b"" => Some(Packing::None),
            b"lz4" => Some(Packing::Lz4),
            b"zstd" => Some(Packing::Zstd),
            _ => None,
        };
        let unpacked_bytes = u64::from(u32_at(16)) | u64::from(u32_at(20)) << 32;
        let packed_bytes = u64::from_le_bytes(packed_bytes);
        Ok(Self { unpacked_bytes, crc: u32_at(24), packing, packed_bytes, bytes: 40 + u64::from(name_bytes) })
    }
}

impl Mcap {
    pub fn open(bag_file: &BagFile) -> Result<Self, BagError> {
        let io = |source| bag_file.io("cannot be read", source);
        let file = crate::base::files::open(&bag_file.path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut bag = Self {
            file: BufReader::with_capacity(1 << 16, file),
            name: bag_file.name.clone(),
            length,
            at: MCAP_MAGIC.len() as u64,
            chunk: Chunk::default(),
            schemas: HashMap::new(),
            channels: HashMap::new(),
            topics: Vec::new(),
            plan: None,
            index: Vec::new(),
            message: Vec::new(),
            losses: Losses::default(),
            is_ended: false,
        };
        bag.read_summary().map_err(io)?;
        bag.seek(bag.at)?;
        Ok(bag)
    }

    /// Topics and chunks as the summary at the end lists them; a file that was cut off has none. What cannot be read of it
    /// comes with the records, too.
    fn read_summary(&mut self) -> std::io::Result<()> {
        let Some(footer_at) = self.length.checked_sub(FOOTER_BYTES + MCAP_MAGIC.len() as u64) else {
            return Ok(());
        };
        self.file.seek(SeekFrom::Start(footer_at))?;
        let mut footer = [0; FOOTER_BYTES as usize];
        self.file.read_exact(&mut footer)?;
        let summary_at = Cursor::packed(&footer[RECORD_HEAD_BYTES as usize..]).u64().unwrap_or(0);
        let bytes = footer_at.saturating_sub(summary_at);
        if footer[0] != op::FOOTER || summary_at == 0 || bytes > MOST_SUMMARY_BYTES {
            return Ok(());
        }
        self.file.seek(SeekFrom::Start(summary_at))?;
        let mut summary = Vec::new();
        (&mut self.file).take(bytes).read_to_end(&mut summary)?;
        let mut rest = &summary[..];
        while let Some((opcode, body, behind)) = split_record(rest) {
            match opcode {
                op::SCHEMA | op::CHANNEL => drop(self.take(opcode, body, summary_at)),
                op::CHUNK_INDEX => self.index.extend(chunk_index(body)),
                _ => {}
            }
            rest = behind;
        }
        self.index.sort_unstable_by_key(|(offset, _)| *offset);
        self.losses = Losses::default();
        Ok(())
    }

    fn meet_channel(&mut self, id: u16, topic: &str, kind: &str, encoding: &str) {
        let encoding = match encoding {
            "ros1" => Encoding::Ros1,
            "cdr" => Encoding::Cdr,
            _ => Encoding::Other,
        };
        let topic = Topic::new(topic, kind, encoding);
        let number = self.topics.iter().position(|known| *known == topic).unwrap_or_else(|| {
            self.topics.push(topic);
            self.topics.len() - 1
        });
        self.channels.insert(id, number);
    }

    fn seek(&mut self, to: u64) -> Result<(), BagError> {
        let here = self.file.stream_position().map_err(|source| self.io(source))?;
        self.file.seek_relative(to.cast_signed() - here.cast_signed()).map_err(|source| self.io(source))
    }

    fn io(&self, source: std::io::Error) -> BagError {
        BagError::Io { name: self.name.clone(), doing: "cannot be read", source }
    }

    fn lose(&mut self, at: u64, why: impl std::fmt::Display) {
        self.losses.push(format!("{}: the record at byte {at}: {why}", self.name));
    }

    /// A record outside of chunks or in one: a message, or something learnt.
    fn take(&mut self, opcode: u8, body: &[u8], at: u64) -> Option<(usize, u64)> {
        let found = match opcode {
            op::SCHEMA => self.take_schema(body).map(|()| None),
            op::CHANNEL => self.take_channel(body).map(|()| None),
            op::MESSAGE => self.take_message(body).map(Some),
            _ => return None,
        };
        if found.is_none() {
            self.lose(
                at,
                format_args!(
                    "a record of operation {opcode} in it cannot be read, or is of no known channel"
                ),
            );
        }
        found.flatten()
    }

    fn take_schema(&mut self, body: &[u8]) -> Option<()> {
        let mut fields = Cursor::packed(body);
        let id = fields.u16()?;
        self.schemas.insert(id, fields.string()?.to_owned());
        Some(())
    }

    fn take_channel(&mut self, body: &[u8]) -> Option<()> {
        let mut fields = Cursor::packed(body);
        let (id, schema) = (fields.u16()?, fields.u16()?);
        let (topic, encoding) = (fields.string()?, fields.string()?);
        let kind = self.schemas.get(&schema).cloned().unwrap_or_default();
        self.meet_channel(id, topic, &kind, encoding);
        Some(())
    }

    fn take_message(&mut self, body: &[u8]) -> Option<(usize, u64)> {
        let mut fields = Cursor::packed(body);
        let (id, _sequence, log_time_ns, _) = (fields.u16()?, fields.u32()?, fields.u64()?, fields.u64()?);
        let topic = *self.channels.get(&id)?;
        self.message.clear();
        self.message.extend_from_slice(fields.rest());
        Some((topic, log_time_ns))
    }

    /// Unpacks the chunk of a record with so many bytes behind its head; what cannot be had is counted.
    fn load_chunk(&mut self, at: u64, there: u64) {
        self.chunk.records.clear();
        (self.chunk.next, self.chunk.at) = (0, at);
        let mut record = (&mut self.file).take(there);
        let header = match ChunkHeader::read(&mut record) {
            Ok(header) => header,
            Err(error) => return self.lose(at, format_args!("a chunk that cannot be read: {error}")),
        };
        let Some(packing) = header.packing else {
            return self.lose(at, "a chunk of unknown compression; expected none, lz4 or zstd");
        };
        let ChunkHeader { unpacked_bytes, crc, packed_bytes, bytes, .. } = header;
        if unpacked_bytes > MOST_MESSAGE_BYTES as u64 {
            let most = MOST_MESSAGE_BYTES;
            return self.lose(
                at,
                format_args!(
                    "a chunk that says it unpacks to {unpacked_bytes} bytes; at most {most} are read"
                ),
            );
        }
        if bytes.saturating_add(packed_bytes) > there && !self.is_ended {
            return self.lose(at, format_args!("a chunk of {packed_bytes} bytes in a record of {there}"));
        }
        let records = &mut self.chunk.records;
        let outcome = unpack(packing, record.take(packed_bytes), unpacked_bytes as usize, records);
        let found = self.chunk.records.len() as u64;
        let lost = match outcome {
            _ if self.is_ended => None, // what the end of the file cuts off was reported
            Err(error) => Some(error.to_string()),
            Ok(()) if found < unpacked_bytes => Some("its data end too early".into()),
            Ok(()) if crc != 0 && crc32fast::hash(&self.chunk.records) != crc => {
                // a message may be wrong anywhere in it
                self.chunk.records.clear();
                return self.lose(at, "a chunk with a wrong checksum: all of it is left out");
            }
            Ok(()) => None,
        };
        if let Some(why) = lost {
            self.lose(at, format_args!("a chunk that gives {found} of {unpacked_bytes} bytes: {why}"));
        }
    }

    fn next_in_chunk(&mut self) -> Option<(usize, u64)> {
        let chunk = std::mem::take(&mut self.chunk);
        let (mut next, mut found) = (chunk.next, None);
        while found.is_none() && next < chunk.records.len() {
            let Some((opcode, body, _)) = split_record(&chunk.records[next..]) else {
                if !self.is_ended {
                    let (bytes, at) = (chunk.records.len(), chunk.at);
                    self.lose(
                        at,
                        format_args!(
                            "a chunk with no whole record at {next} of its {bytes} bytes; its rest is lost"
                        ),
                    );
                }
                next = chunk.records.len();
                break;
            };
            next += RECORD_HEAD_BYTES as usize + body.len();
            found = self.take(opcode, body, chunk.at);
        }
        self.chunk = Chunk { next, ..chunk };
        found
    }
}

impl Container for Mcap {
    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn advance(&mut self) -> Result<Option<(usize, u64)>, BagError> {
        loop {
            if let Some(found) = self.next_in_chunk() {
                return Ok(Some(found));
            }
            if let Some(plan) = &mut self.plan {
                match plan.pop() {
                    Some(offset) => self.at = offset,
                    None => self.is_ended = true,
                }
            }
            if self.is_ended {
                return Ok(None);
            }
            self.seek(self.at)?;
            let left = self.length.saturating_sub(self.at);
            if left < RECORD_HEAD_BYTES {
                self.is_ended = true;
                let why = format!(
                    "the file ends here ({left} bytes), without the record that ends its data: its recorder was stopped"
                );
                self.lose(self.at, why);
                return Ok(None);
            }
            let mut head = [0; RECORD_HEAD_BYTES as usize];
            self.file.read_exact(&mut head).map_err(|source| self.io(source))?;
            let (at, [opcode, length @ ..]) = (self.at, head);
            let length = u64::from_le_bytes(length);
            let there = length.min(left - RECORD_HEAD_BYTES);
            self.at = at + RECORD_HEAD_BYTES + there;
            if there < length {
                self.is_ended = true;
                self.lose(at, format_args!("the file ends inside it: {there} of {length} bytes are there"));
                if opcode != op::CHUNK {
                    return Ok(None);
                }
            }
            match opcode {
                op::CHUNK => self.load_chunk(at, there),
                op::DATA_END | op::FOOTER => {
                    self.is_ended = true;
                    return Ok(None);
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    if there > MOST_MESSAGE_BYTES as u64 {
                        self.lose(
                            at,
                            format_args!("{there} bytes long, expected at most {MOST_MESSAGE_BYTES}"),
                        );
                        continue;
                    }
                    let mut body = vec![0; there as usize];
                    self.file.read_exact(&mut body).map_err(|source| self.io(source))?;
                    if let Some(found) = self.take(opcode, &body, at) {
                        return Ok(Some(found));
                    }
                }
                0 => {
                    let found = "a record of operation 0".into();
                    let expected = "1 to 15";
                    return Err(BagError::Damaged { name: self.name.clone(), offset: at, found, expected });
                }
                _ => {} // an index, an attachment, or a private record
            }
        }
    }

    fn data(&self) -> &[u8] {
        &self.message
    }

    fn restrict(&mut self, is_wanted: &dyn Fn(&Topic) -> bool) -> bool {
        if self.index.is_empty() {
            return false; // channels that are not met yet could be wanted
        }
        let is_wanted = |id: &u16| self.channels.get(id).is_some_and(|at| is_wanted(&self.topics[*at]));
        let plan = self.index.iter().rev().filter(|(_, held)| held.iter().any(is_wanted));
        self.plan = Some(plan.map(|(offset, _)| *offset).collect());
        true
    }

    fn position(&self) -> u64 {
        self.at
    }

    fn losses(&self) -> &Losses {
        &self.losses
    }
}
