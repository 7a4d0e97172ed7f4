//! A file of pieces (packet blocks, lines) that are in it whole or not at all, with its SHA-256 updated while it grows.

use std::fs::File;
use std::io::{self, Write};

use sha2::{Digest, Sha256};

/// Bytes gathered before the system is asked to write.
const BUFFER_BYTES: usize = 1 << 20;

/// Appends pieces. Each `write` call is one piece; a piece that the disk takes only in part is cut off again.
pub(super) struct WholeFile<F> {
    file: F,
    buffer: Vec<u8>,
    /// Where each gathered piece ends in the buffer.
    ends: Vec<usize>,
    bytes: u64,
    hash: Sha256,
    failed: Option<io::ErrorKind>,
    lost: Vec<Vec<u8>>,
}

/// What a [`WholeFile`] needs from its file besides writing: truncation.
pub(super) trait Cut: Write {
    /// Cuts the file back to a length and goes on writing there.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl Cut for File {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        use std::io::Seek as _;
        self.set_len(length)?;
        self.seek(io::SeekFrom::Start(length)).map(drop)
    }
}

impl<F: Cut> WholeFile<F> {
    pub(super) fn new(file: F) -> Self {
        Self {
            file,
            buffer: Vec::with_capacity(BUFFER_BYTES),
            ends: Vec::new(),
            bytes: 0,
            hash: Sha256::new(),
            failed: None,
            lost: Vec::new(),
        }
    }

    /// The file beneath.
    pub(super) fn file(&self) -> &F {
        &self.file
    }

    /// Bytes in the file, gathered ones not counted.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// SHA-256 of the bytes in the file, hexadecimal.
    pub(super) fn sha256(&self) -> String {
        crate::base::files::hexadecimal(&self.hash.clone().finalize())
    }

    /// Pieces that were accepted and then not written, first bytes only, since the last call.
    pub(super) fn take_lost(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.lost)
    }

    /// Tries again after a failure: space may have been freed.
    pub(super) fn retry(&mut self) {
        self.failed = None;
    }

    fn write_out(&mut self) -> io::Result<()> {
        if let Some(kind) = self.failed {
            return Err(kind.into());
        }
        let mut done = 0;
        let mut outcome = Ok(());
        while done < self.buffer.len() {
            match self.file.write(&self.buffer[done..]) {
                Ok(0) => outcome = Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => done += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => outcome = Err(error),
            }
            if outcome.is_err() {
                break;
            }
        }
        let whole = self.ends.iter().rev().copied().find(|end| *end <= done).unwrap_or(0);
        self.hash.update(&self.buffer[..whole]);
        self.bytes += whole as u64;
        if let Err(error) = &outcome {
            self.failed = Some(error.kind());
            let mut start = whole;
            for end in self.ends.iter().copied().filter(|end| *end > whole) {
                self.lost.push(self.buffer[start..end.min(start + 16)].to_vec());
                start = end;
            }
            // half a piece at the end would only be skipped on reading: cutting it off may fail without harm
            let _ = self.file.cut(self.bytes);
        }
        self.buffer.clear();
        self.ends.clear();
        outcome
    }
}

impl<F: Cut> Write for WholeFile<F> {
    fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
        if let Some(kind) = self.failed {
            return Err(kind.into());
        }
        if self.buffer.len() + piece.len() > BUFFER_BYTES {
            self.write_out()?;
        }
        self.buffer.extend_from_slice(piece);
        self.ends.push(self.buffer.len());
        Ok(piece.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.write_out()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with room for so many bytes.
    #[derive(Default)]
    struct Disk {
        content: Vec<u8>,
        room: usize,
    }

    impl Write for &mut Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let count = bytes.len().min(self.room - self.content.len());
            if count == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.content.extend_from_slice(&bytes[..count]);
            Ok(count)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Cut for &mut Disk {
        fn cut(&mut self, length: u64) -> io::Result<()> {
            self.content.truncate(length as usize);
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_keeps_whole_pieces_and_counts_the_rest() {
        for room in 0..=30 {
            let mut disk = Disk { room, ..Disk::default() };
            let mut file = WholeFile::new(&mut disk);
            for piece in [b"0123456789", b"abcdefghij", b"ABCDEFGHIJ"] {
                file.write_all(piece).unwrap();
            }
            assert_eq!(file.flush().is_err(), room < 30, "{room}");
            let (bytes, lost, hash) = (file.bytes(), file.take_lost().len(), file.sha256());
            assert_eq!(file.write_all(b"more").is_err(), room < 30);
            drop(file);
            assert_eq!((bytes as usize, lost), (room / 10 * 10, 3 - room / 10), "{room}");
            assert_eq!(disk.content, b"0123456789abcdefghijABCDEFGHIJ"[..room / 10 * 10]);
            assert_eq!(hash, crate::base::files::hexadecimal(&Sha256::digest(&disk.content)));
        }
    }
}
