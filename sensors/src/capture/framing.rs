//! Records of pcap and blocks of pcapng, either byte order, as link-layer frames with a time. `pcap-parser` parses
//! headers, records and blocks, once their lengths are believed and their bytes are there; finding them in a stream
//! with bounded memory, and saying at which byte a file is cut or damaged, is done here.
//!
//! Sources: IETF draft-ietf-opsawg-pcap (classic), draft-ietf-opsawg-pcapng sections 3.5 and 4.

use std::ops::Range;

use pcap_parser::pcap::{parse_pcap_frame, parse_pcap_frame_be, parse_pcap_header};
use pcap_parser::pcapng::SHB_MAGIC;

use super::buffer::Buffer;
use super::clock::Clock;
use super::error::{CaptureCounters, CaptureError, Truncated, ZeroTail};
use super::identify::looks_like;
use super::pcapng_blocks::{self as blocks, Body, Bytes};

/// Longest frame that is believed; what links carry is far below (65 kB with offloading).
const MAX_CAPTURED: u32 = 1 << 20;
/// Longest descriptive block that is read whole; longer ones are passed over.
const MAX_DESCRIPTION: u32 = 1 << 20;

/// How pcap files start: stamps in microseconds or nanoseconds, either byte order. `pcap-parser` also reads
/// Kuznetzov's modified pcap, which has longer records.
const CLASSIC_MAGICS: [[u8; 4]; 4] =
    [[0xd4, 0xc3, 0xb2, 0xa1], [0x4d, 0x3c, 0xb2, 0xa1], [0xa1, 0xb2, 0xc3, 0xd4], [0xa1, 0xb2, 0x3c, 0x4d]];

/// One link-layer frame; `place` is valid in the buffer until the next one is asked for.
pub(super) struct LinkFrame {
    pub(super) place: Range<usize>,
    pub(super) link_type: u16,
    pub(super) interface: usize,
    pub(super) time_ns: u64,
    pub(super) original_length: usize,
}

/// One interface of a capture.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Interface {
    /// Name the recorder gave it, if any.
    pub name: Option<String>,
    /// Link type, as registered for pcap.
    pub link_type: u16,
    /// Packets the recorder says it dropped here.
    pub dropped: u64,
    #[serde(skip)]
    clock: Clock,
}

pub(super) struct Framing {
    pub(super) buffer: Buffer,
    name: String,
    format: Format,
    /// Of the current section; pcap has one.
    interfaces: Vec<Interface>,
    done: bool,
}

#[derive(Clone, Copy)]
enum Format {
    Pcap { order: Bytes },
    Pcapng { order: Bytes },
}

impl Framing {
    pub(super) fn new(mut buffer: Buffer, name: String) -> Result<Self, CaptureError> {
        let read_error = |source| CaptureError::Read { name: name.clone(), offset: 0, source };
        let have = buffer.fill(24).map_err(read_error)?;
        let start = buffer.available();
        let mut interfaces = Vec::new();
        let format = if start.starts_with(&SHB_MAGIC.to_le_bytes()) {
            Format::Pcapng { order: Bytes::Little } // until the section header is read
        } else if !CLASSIC_MAGICS.iter().any(|magic| start.starts_with(magic)) {
            let start = &start[..start.len().min(4096)];
            return Err(CaptureError::NotACapture { looks_like: looks_like(start), name });
        } else {
            let Ok((_, header)) = parse_pcap_header(start) else {
                let looks_like = format!("a pcap header of {have} bytes; it has 24");
                return Err(CaptureError::NotACapture { looks_like, name });
            };
            let ticks_per_second = if header.is_nanosecond_precision() { 1_000_000_000 } else { 1_000_000 };
            interfaces.push(Interface {
                link_type: header.network.0 as u16, // the upper half tells about checksums
                clock: Clock { ticks_per_second, offset_s: 0 },
                ..Default::default()
            });
            buffer.consume(header.size());
            Format::Pcap { order: if header.is_bigendian() { Bytes::Big } else { Bytes::Little } }
        };
        Ok(Self { buffer, name, format, interfaces, done: false })
    }

    pub(super) fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    /// The next frame, or `None` at the end; a file that ends inside a record is noted in `counters`.
    pub(super) fn next(&mut self, counters: &mut CaptureCounters) -> Result<Option<LinkFrame>, CaptureError> {
        if self.done {
            return Ok(None);
        }
        let next = match self.format {
            Format::Pcap { order } => self.next_record(order, counters),
            Format::Pcapng { .. } => self.next_block(counters),
        };
        self.done = !matches!(next, Ok(Some(_)));
        next
    }

    fn next_record(
        &mut self,
        order: Bytes,
        counters: &mut CaptureCounters,
    ) -> Result<Option<LinkFrame>, CaptureError> {
        const HEADER: usize = 16;
        if !self.need(HEADER, counters)? {
            return Ok(None);
        }
        if is_zeros(&self.buffer.available()[..HEADER]) {
            self.pass_zeros(HEADER as u64, counters)?;
            return Ok(None);
        }
        let captured = order.u32(self.buffer.available(), 8);
        if captured > MAX_CAPTURED {
            return Err(self.damaged(
                format!("a record of {captured} bytes"),
                format!("at most {MAX_CAPTURED}, and a record header"),
            ));
        }
        let interface = &self.interfaces[0]; // made with the file header
        let (clock, link_type) = (interface.clock, interface.link_type);
        let length = captured as usize;
        if !self.need(HEADER + length, counters)? {
            return Ok(None);
        }
        let whole = &self.buffer.available()[..HEADER + length];
        let parsed = match order {
            Bytes::Little => parse_pcap_frame(whole),
            Bytes::Big => parse_pcap_frame_be(whole),
        };
        let Ok((_, record)) = parsed else {
            return Err(
                self.damaged(format!("a record of {captured} bytes"), "a record as pcap has it".into())
            );
        };
        // at most 1e9 per s
        let ticks = u64::from(record.ts_sec) * clock.ticks_per_second as u64 + u64::from(record.ts_usec);
        let original_length = record.origlen as usize;
        let at = self.buffer.consume(HEADER + length) + HEADER;
        Ok(Some(LinkFrame {
            place: at..at + length,
            link_type,
            interface: 0,
            time_ns: clock.time_ns(ticks),
            original_length,
        }))
    }

    fn next_block(&mut self, counters: &mut CaptureCounters) -> Result<Option<LinkFrame>, CaptureError> {
        loop {
            if !self.need(12, counters)? {
                return Ok(None);
            }
            let head = self.buffer.available();
            if is_zeros(&head[..12]) {
                self.pass_zeros(12, counters)?;
                return Ok(None);
            }
            if head.starts_with(&SHB_MAGIC.to_le_bytes()) {
                match head.get(8..12) {
                    Some([0x4d, 0x3c, 0x2b, 0x1a]) => self.format = Format::Pcapng { order: Bytes::Little },
                    Some([0x1a, 0x2b, 0x3c, 0x4d]) => self.format = Format::Pcapng { order: Bytes::Big },
                    found => {
                        let found = format!("a section header with byte-order magic {found:02x?}");
                        return Err(self.damaged(found, "1a 2b 3c 4d in either order".into()));
                    }
                }
                self.interfaces.clear();
            }
            let Format::Pcapng { order } = self.format else { return Ok(None) };
            let head = self.buffer.available();
            let (kind, length) = (order.u32(head, 0), order.u32(head, 4));
            if length < 12 || !length.is_multiple_of(4) {
                let found = format!("a block of type {kind:#x} and length {length}");
                return Err(self.damaged(found, "a length of 12 or more, in steps of 4".into()));
            }
            if !blocks::is_read(kind) {
                self.skip_block(length, counters)?;
                if counters.truncated.is_some() {
                    return Ok(None);
                }
                continue;
            }
            if length > MAX_CAPTURED + MAX_DESCRIPTION {
                let found = format!("a block of type {kind:#x} and {length} bytes");
                return Err(self.damaged(found, format!("at most {} bytes", MAX_CAPTURED + MAX_DESCRIPTION)));
            }
            if !self.need(length as usize, counters)? {
                return Ok(None);
            }
            if let Some(frame) = self.take_block(order, kind, length as usize, counters)? {
                return Ok(Some(frame));
            }
        }
    }

    /// Reads one whole block; a frame, if it holds one.
    fn take_block(
        &mut self,
        order: Bytes,
        kind: u32,
        length: usize,
        counters: &mut CaptureCounters,
    ) -> Result<Option<LinkFrame>, CaptureError> {
        let whole = &self.buffer.available()[..length];
        let trailer = order.u32(whole, length - 4);
        if trailer as usize != length {
            return Err(self.damaged(
                format!("a block with the two lengths {length} and {trailer}"),
                "the same number twice".into(),
            ));
        }
        let body = match blocks::parse(kind, order, whole) {
            Ok(body) => body,
            Err((found, expected)) => return Err(self.damaged(found, expected)),
        };
        let packet = match body {
            Body::Other => None,
            Body::Interface(interface) => {
                self.interfaces.push(Interface {
                    name: interface.name,
                    link_type: interface.link_type,
                    dropped: 0,
                    clock: interface.clock,
                });
                None
            }
            Body::Statistics { interface, dropped } => {
                if let Some(entry) = self.interfaces.get_mut(interface as usize) {
                    let more = dropped.saturating_sub(entry.dropped);
                    entry.dropped += more;
                    counters.dropped_by_recorder = counters.dropped_by_recorder.saturating_add(more);
                }
                None
            }
            Body::Packet(packet) => Some(packet),
        };
        let Some(packet) = packet else {
            self.buffer.consume(length);
            return Ok(None);
        };
        let known = self.interfaces.len();
        let Some(interface) = self.interfaces.get_mut(packet.interface as usize) else {
            return Err(self.damaged(
                format!("a packet of interface {}", packet.interface),
                format!("one of the {known} interfaces described before it"),
            ));
        };
        interface.dropped = interface.dropped.saturating_add(packet.dropped);
        counters.dropped_by_recorder = counters.dropped_by_recorder.saturating_add(packet.dropped);
        let frame = LinkFrame {
            place: packet.data,
            link_type: interface.link_type,
            interface: packet.interface as usize,
            time_ns: packet.ticks.map_or(0, |ticks| interface.clock.time_ns(ticks)),
            original_length: packet.original_length as usize,
        };
        let at = self.buffer.consume(length) + 8;
        Ok(Some(LinkFrame { place: frame.place.start + at..frame.place.end + at, ..frame }))
    }

    fn skip_block(&mut self, length: u32, counters: &mut CaptureCounters) -> Result<(), CaptureError> {
        let offset = self.buffer.offset();
        let passed = match self.buffer.skip(u64::from(length)) {
            Ok(passed) => passed,
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => self.buffer.offset() - offset,
            Err(error) => return Err(self.stopped(error)),
        };
        if passed < u64::from(length) {
            counters.truncated =
                Some(Truncated { offset, found_bytes: passed, expected_bytes: u64::from(length) });
        }
        Ok(())
    }

    /// Whether `length` bytes are there; a file that ends before them is noted, unless it ends at a border.
    fn need(&mut self, length: usize, counters: &mut CaptureCounters) -> Result<bool, CaptureError> {
        let (have, cut) = match self.buffer.fill(length) {
            Ok(have) => (have, have > 0),
            // a gzip stream that was cut off, perhaps between two records
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                (self.buffer.available().len(), true)
            }
            Err(error) => return Err(self.stopped(error)),
        };
        if have < length && cut {
            counters.truncated = Some(Truncated {
                offset: self.buffer.offset(),
                found_bytes: have as u64,
                expected_bytes: length as u64,
            });
        }
        Ok(have == length)
    }

    /// Passes over zeros where a record should begin: no recorder writes a record of length 0 and time 0. Up to the end of
    /// the file they are noted; zeros with something behind them are damage.
    fn pass_zeros(&mut self, header_bytes: u64, counters: &mut CaptureCounters) -> Result<(), CaptureError> {
        const STEP: usize = 4096;
        let offset = self.buffer.offset();
        let mut bytes = 0;
        loop {
            let have = match self.buffer.fill(STEP) {
                Ok(have) => have,
                Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                    self.buffer.available().len()
                }
                Err(error) => return Err(self.stopped(error)),
            };
            let zeros = self.buffer.available()[..have].iter().take_while(|byte| **byte == 0).count();
            bytes += zeros as u64;
            self.buffer.consume(zeros);
            if zeros < have {
                let found = format!("{bytes} zero bytes, and other bytes behind them");
                let expected = "a record that begins with its time and length".into();
                return Err(CaptureError::Damaged { name: self.name.clone(), offset, found, expected });
            }
            if have == 0 {
                counters.zero_tail = Some(ZeroTail { offset, bytes, header_bytes });
                return Ok(());
            }
        }
    }

    fn stopped(&self, source: std::io::Error) -> CaptureError {
        let offset = self.buffer.offset() + self.buffer.available().len() as u64;
        CaptureError::Read { name: self.name.clone(), offset, source }
    }

    fn damaged(&self, found: String, expected: String) -> CaptureError {
        CaptureError::Damaged { name: self.name.clone(), offset: self.buffer.offset(), found, expected }
    }
}

fn is_zeros(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| *byte == 0)
}
