//! Streams the UDP datagrams of a capture.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::net::SocketAddr;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use flate2::bufread::MultiGzDecoder;

use super::buffer::Buffer;
use super::dissect::{Carried, dissect, udp};
use super::error::{CaptureCounters, CaptureError};
use super::framing::{Framing, Interface, LinkFrame};
use super::reassembly::{Added, Reassembly};
use crate::{Link, Packet};

/// Reads a capture from front to back: pcap or pcapng in either byte order, plain or gzip. Memory does not depend on
/// the file's length, and no packet costs an allocation (but for those with pcapng options of their own).
///
/// ```
/// use sensors::Packet;
/// use sensors::capture::{CaptureReader, PcapWriter};
///
/// let (source, destination) = ("192.168.1.201:2368".parse()?, "192.168.1.1:2368".parse()?);
/// let mut file = Vec::new();
/// let mut writer = PcapWriter::new(&mut file)?;
/// for (host_time_ns, payload) in [(1, b"one"), (2, b"two")] {
///     writer.write(&Packet { host_time_ns, source, destination, link: Default::default(), payload })?;
/// }
/// file.pop(); // the disk was full
///
/// let mut capture = CaptureReader::new(std::io::Cursor::new(file), "drive.pcap")?;
/// let packet = capture.next()?.unwrap();
/// assert_eq!((packet.source, packet.payload), (source, &b"one"[..]));
/// assert!(capture.next()?.is_none());
/// assert!(capture.counters().truncated.is_some(), "the second packet lacks a byte, and that is counted");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CaptureReader {
    framing: Framing,
    reassembly: Reassembly,
    counters: CaptureCounters,
    interface: usize,
    position: Arc<AtomicU64>,
    is_packed: bool,
}

/// A datagram; its bytes do not move while it is handed out.
struct Found {
    source: SocketAddr,
    destination: SocketAddr,
    link: Link,
    time_ns: u64,
    place: Place,
}

/// Where.
enum Place {
    InFrame(Range<usize>),
    Reassembled { slot: usize, payload: Range<usize> },
}

impl CaptureReader {
    /// Opens a file; gzip is recognised by its content.
    pub fn open(path: &Path) -> Result<Self, CaptureError> {
        let name = path.display().to_string();
        let open_error = |source| CaptureError::Open { name: name.clone(), source };
        let file = File::open(path).map_err(open_error)?;
        if file.metadata().map_err(open_error)?.is_dir() {
            return Err(open_error(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        Self::new(file, name)
    }

    /// Reads from anywhere; `name` stands in messages.
    pub fn new(read: impl Read + Send + 'static, name: impl Into<String>) -> Result<Self, CaptureError> {
        let name = name.into();
        let position = Arc::new(AtomicU64::new(0));
        let read_error = |source| CaptureError::Read { name: name.clone(), offset: 0, source };
        let mut counting = Counting { read, position: position.clone() };
        let mut start = Vec::with_capacity(2);
        (&mut counting).take(2).read_to_end(&mut start).map_err(read_error)?;
        let gzip = start == [0x1f, 0x8b];
        let read = io::Cursor::new(start).chain(counting);
        let read: Box<dyn Read + Send> = match gzip {
            true => Box::new(MultiGzDecoder::new(BufReader::new(read))),
            false => Box::new(read),
        };
        Ok(Self {
            framing: Framing::new(Buffer::new(read), name)?,
            reassembly: Reassembly::default(),
            counters: CaptureCounters::default(),
            interface: 0,
            position,
            is_packed: gzip,
        })
    }

    /// The next datagram; `None` at the end, also where the file was cut off (see [`CaptureCounters::truncated`]).
    /// The host time of a datagram that came in fragments is that of the fragment which completed it.
    #[expect(clippy::should_implement_trait, reason = "an Iterator cannot lend its buffer")]
    pub fn next(&mut self) -> Result<Option<Packet<'_>>, CaptureError> {
        Ok(self.next_from()?.map(|(_, packet)| packet))
    }

    /// The next datagram, as [`CaptureReader::next`] gives it, and the number of its interface.
    pub fn next_from(&mut self) -> Result<Option<(usize, Packet<'_>)>, CaptureError> {
        let found = loop {
            let Some(frame) = self.framing.next(&mut self.counters)? else {
                self.reassembly.finish();
                self.counters.fragments_incomplete = self.reassembly.incomplete();
                return Ok(None);
            };
            self.counters.frames += 1;
            self.interface = frame.interface;
            if let Some(found) = self.take(frame) {
                self.counters.datagrams += 1;
                break found;
            }
        };
        let payload = match found.place {
            Place::InFrame(payload) => self.framing.buffer.at(payload),
            Place::Reassembled { slot, payload } => &self.reassembly.datagram(slot)[payload],
        };
        let Found { source, destination, link, time_ns: host_time_ns, .. } = found;
        Ok(Some((self.interface, Packet { host_time_ns, source, destination, link, payload })))
    }

    /// What was met so far.
    pub fn counters(&self) -> &CaptureCounters {
        &self.counters
    }

    /// Interfaces described so far in the current section; a classic pcap has one.
    pub fn interfaces(&self) -> &[Interface] {
        self.framing.interfaces()
    }

    /// The interface of the packet handed out last.
    pub fn interface(&self) -> Option<&Interface> {
        self.framing.interfaces().get(self.interface)
    }

    /// Bytes read from the file so far (packed ones, if it is packed), to show progress.
    pub fn position(&self) -> u64 {
        self.position.load(Ordering::Relaxed)
    }

    /// Whether the file is packed.
    pub fn is_packed(&self) -> bool {
        self.is_packed
    }

    /// Counts a frame as what it is; a datagram, if it holds or completes one.
    fn take(&mut self, frame: LinkFrame) -> Option<Found> {
        let counters = &mut self.counters;
        let bytes = self.framing.buffer.at(frame.place.clone());
        let cut = if frame.original_length > bytes.len() {
            &mut counters.cut_by_snap_length
        } else {
            &mut counters.malformed
        };
        let time_ns = frame.time_ns;
        let mut link = Link { interface: frame.interface as u16, ..Link::default() };
        match dissect(frame.link_type, bytes, &mut link) {
            Carried::Udp { source, destination, payload } => {
                let payload = within(bytes, payload);
                let place =
                    Place::InFrame(frame.place.start + payload.start..frame.place.start + payload.end);
                return Some(Found { source, destination, link, time_ns, place });
            }
            Carried::Fragment(fragment) => {
                counters.fragments += 1;
                let added = self.reassembly.add(&fragment, time_ns);
                counters.fragments_incomplete = self.reassembly.incomplete();
                match added {
                    Added::Complete(slot) => {
                        let datagram = self.reassembly.datagram(slot);
                        if let Carried::Udp { source, destination, payload } =
                            udp(fragment.key.source, fragment.key.destination, datagram)
                        {
                            let payload = within(datagram, payload);
                            let place = Place::Reassembled { slot, payload };
                            return Some(Found { source, destination, link, time_ns, place });
                        }
                        counters.malformed += 1;
                    }
                    Added::Waiting => {}
                    Added::Duplicate => counters.fragments_duplicated += 1,
                    Added::Malformed => counters.malformed += 1,
                }
            }
            Carried::NotIp => counters.not_ip += 1,
            Carried::NotUdp => counters.not_udp += 1,
            Carried::OtherLinkType => counters.other_link_type += 1,
            Carried::Cut => *cut += 1,
            Carried::Malformed => counters.malformed += 1,
        }
        None
    }
}

/// Where a part of a slice begins and ends in it.
fn within(whole: &[u8], part: &[u8]) -> Range<usize> {
    let start = part.as_ptr().addr() - whole.as_ptr().addr();
    start..start + part.len()
}

/// Counts what goes through.
struct Counting<R> {
    read: R,
    position: Arc<AtomicU64>,
}

impl<R: Read> Read for Counting<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.read.read(into)?;
        self.position.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}
