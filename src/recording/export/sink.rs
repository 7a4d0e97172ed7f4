//! A file behind other people's writers.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::sync::{Arc, OnceLock};

use super::Cause;

/// Takes everything from the first error on, and keeps that error: some writers end their file when they are dropped, and
/// panic where the disk is still full then; others do not pass on the disk's error.
pub(super) struct Sink {
    file: BufWriter<File>,
    place: u64,
    end: u64,
    failure: Failure,
}

/// What went wrong first in a [`Sink`].
#[derive(Clone, Default)]
pub(super) struct Failure(Arc<OnceLock<io::Error>>);

impl Sink {
    /// At the start of an empty file.
    pub(super) fn new(file: File) -> (Self, Failure) {
        let failure = Failure::default();
        (Self { file: BufWriter::new(file), place: 0, end: 0, failure: failure.clone() }, failure)
    }

    fn attempt(&mut self, what: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) {
        if self.failure.0.get().is_none()
            && let Err(error) = what(&mut self.file)
        {
            let _ = self.failure.0.set(error); // it was empty
        }
    }
}

impl Failure {
    /// What went wrong, if anything did.
    pub(super) fn check(&self) -> Result<(), Cause> {
        match self.0.get() {
            None => Ok(()),
            Some(error) => {
                let again = error.raw_os_error().map(io::Error::from_raw_os_error);
                Err(again.unwrap_or_else(|| io::Error::new(error.kind(), error.to_string())).into())
            }
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|file| file.write_all(bytes));
        self.place += bytes.len() as u64;
        self.end = self.end.max(self.place);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(BufWriter::flush);
        Ok(())
    }
}

impl Seek for Sink {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let place = match to {
            SeekFrom::Start(place) => Some(place),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
            SeekFrom::Current(by) => self.place.checked_add_signed(by),
        };
        self.place = place.ok_or(io::ErrorKind::InvalidInput)?;
        let place = self.place;
        self.attempt(|file| file.seek(SeekFrom::Start(place)).map(|_| ()));
        Ok(place)
    }
}
