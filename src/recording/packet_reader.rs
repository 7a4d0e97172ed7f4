//! The one place where what was recorded is opened: its packets in order, from a capture (plain or packed), a bag, or a stream
//! that can be read but once.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use sensors::Packet;
use sensors::capture::{CaptureCounters, CaptureError, CaptureReader, Interface};
use tempfile::NamedTempFile;

use super::bags::{BagError, BagPackets, Packed, is_bag, is_bag_at, start_of};

/// Why packets cannot be read, or not further.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PacketError {
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(transparent)]
    Bag(#[from] BagError),
}

/// Packets in the order of their record.
pub(crate) struct PacketReader {
    source: Source,
    /// Bytes read from a packed file.
    packed_bytes: Option<Arc<AtomicU64>>,
    /// A stream that was copied to a file because it holds a bag.
    spooled: Cell<Option<NamedTempFile>>,
}

enum Source {
    Capture(Box<CaptureReader>),
    Bag(Box<BagPackets>),
}

impl PacketReader {
    /// Opens a file or the folder of a bag; `-` is standard input, which `name` calls so.
    pub fn open(path: &Path, name: &str) -> Result<Self, PacketError> {
        if path.as_os_str() == "-" {
            return Self::of_stream(io::stdin(), name);
        }
        if is_bag_at(path) {
            return Ok(Source::Bag(Box::new(BagPackets::open(path, name)?)).into());
        }
        let open_error = |source| CaptureError::Open { name: name.to_owned(), source };
        let mut file = File::open(path).map_err(open_error)?;
        let kind = file.metadata().map_err(open_error)?.file_type();
        if kind.is_dir() {
            return Err(open_error(io::Error::from(io::ErrorKind::IsADirectory)).into());
        }
        if !kind.is_file() {
            return Self::of_stream(file, name);
        }
        let start = start_of(&mut file).map_err(open_error)?;
        let file = File::open(path).map_err(open_error)?; // from its start again
        Self::of_capture(&start, file, name)
    }

    /// Reads from what can be read but once.
    fn of_stream(mut read: impl Read + Send + 'static, name: &str) -> Result<Self, PacketError> {
        let read_error = |source| CaptureError::Read { name: name.to_owned(), offset: 0, source };
        let start = start_of(&mut read).map_err(read_error)?;
        let whole = io::Cursor::new(start.clone()).chain(read);
        if !is_bag(&start) {
            return Self::of_capture(&start, whole, name);
        }
        // its index lies at its end
        let spooled = NamedTempFile::new().and_then(|mut file| {
            io::copy(&mut { whole }, &mut file)?;
            Ok(file)
        });
        let doing = "cannot be stored in a temporary file (TMPDIR)";
        let spooled = spooled.map_err(|source| BagError::Io { name: name.to_owned(), doing, source })?;
        let mut reader: Self = Source::Bag(Box::new(BagPackets::open(spooled.path(), name)?)).into();
        reader.spooled = Cell::new(Some(spooled));
        Ok(reader)
    }

    fn of_capture(start: &[u8], read: impl Read + Send + 'static, name: &str) -> Result<Self, PacketError> {
        let Some(packed) = Packed::of(start) else {
            return Ok(Source::Capture(Box::new(CaptureReader::new(read, name)?)).into());
        };
        let count = Arc::new(AtomicU64::new(0));
        let counting = Counting { read, count: count.clone() };
        let read_error = |source| CaptureError::Read { name: name.to_owned(), offset: 0, source };
        let content = packed.open(counting).map_err(read_error)?;
        let mut reader: Self = Source::Capture(Box::new(CaptureReader::new(content, name)?)).into();
        reader.packed_bytes = Some(count);
        Ok(reader)
    }

    /// The file that a bag from a stream was copied to: who opens it again has it.
    pub fn take_spooled(&self) -> Option<NamedTempFile> {
        self.spooled.take()
    }

    /// The next packet.
    pub fn next(&mut self) -> Result<Option<Packet<'_>>, PacketError> {
        Ok(self.next_from()?.map(|(_, packet)| packet))
    }

    /// The next packet, and the number of its interface in a capture, of its topic in a bag.
    pub fn next_from(&mut self) -> Result<Option<(usize, Packet<'_>)>, PacketError> {
        match &mut self.source {
            Source::Capture(reader) => Ok(reader.next_from()?),
            Source::Bag(bag) => Ok(bag.next()?.map(|found| (found.topic, found.packet))),
        }
    }

    /// What was met so far; of a bag, messages count as frames.
    pub fn counters(&self) -> CaptureCounters {
        match &self.source {
            Source::Capture(reader) => reader.counters().clone(),
            Source::Bag(bag) => {
                let mut counters = CaptureCounters::default();
                counters.frames = bag.counts().iter().map(|count| count.messages).sum();
                counters.datagrams = bag.counts().iter().map(|count| count.packets).sum();
                counters
            }
        }
    }

    /// Interfaces of a capture.
    pub fn interfaces(&self) -> &[Interface] {
        match &self.source {
            Source::Capture(reader) => reader.interfaces(),
            Source::Bag(_) => &[],
        }
    }

    /// The bag that is read.
    pub fn bag(&self) -> Option<&BagPackets> {
        match &self.source {
            Source::Capture(_) => None,
            Source::Bag(bag) => Some(bag),
        }
    }

    /// Bytes read from the file so far (packed ones, if it is packed).
    pub fn position(&self) -> u64 {
        match (&self.source, &self.packed_bytes) {
            (_, Some(count)) => count.load(Ordering::Relaxed),
            (Source::Capture(reader), None) => reader.position(),
            (Source::Bag(bag), None) => bag.position(),
        }
    }

    /// Whether the whole file is packed.
    pub fn is_packed(&self) -> bool {
        let is_gzip = matches!(&self.source, Source::Capture(reader) if reader.is_packed());
        is_gzip || self.packed_bytes.is_some()
    }
}

impl From<Source> for PacketReader {
    fn from(source: Source) -> Self {
        Self { source, packed_bytes: None, spooled: Cell::new(None) }
    }
}

/// Whether something can be read but once: standard input as `-`, a pipe.
pub(crate) fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-" || std::fs::metadata(path).is_ok_and(|file| !file.is_file() && !file.is_dir())
}

/// A temporary copy of what can be read only once; none for another file.
pub(crate) fn keep_stream(path: &Path) -> io::Result<Option<NamedTempFile>> {
    if !is_stream(path) {
        return Ok(None);
    }
    let mut file = NamedTempFile::new()?;
    match path.as_os_str() == "-" {
        true => io::copy(&mut io::stdin(), &mut file)?,
        false => io::copy(&mut File::open(path)?, &mut file)?,
    };
    Ok(Some(file))
}

/// Counts what goes through.
struct Counting<R> {
    read: R,
    count: Arc<AtomicU64>,
}

impl<R: Read> Read for Counting<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.read.read(into)?;
        self.count.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}
