//! Small services of the file system: whole files, checksums, free space.

use std::io::{self, Read as _};
use std::path::Path;

use sha2::{Digest, Sha256};

use super::SessionError;
use crate::base::files::{self, hexadecimal};

/// Puts a file of a session under its name whole or not at all, and on the disk.
pub(super) fn write_whole(path: &Path, content: &[u8]) -> Result<(), SessionError> {
    files::write_whole(path, content).map_err(|error| SessionError::io(path, "cannot be written", error))
}

/// Length and checksum of a file of a session.
pub(super) fn entry_of(dir: &Path, relative: &str) -> Result<FileEntry, SessionError> {
    let path = dir.join(relative);
    let failed = |error| SessionError::io(&path, "cannot be read", error);
    let mut file = files::open_inside(dir, relative).map_err(failed)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => {
                hash.update(&buffer[..count]);
                bytes += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(failed(error)),
        }
    }
    Ok(FileEntry { path: relative.to_owned(), bytes, sha256: hexadecimal(&hash.finalize()) })
}

/// Bytes an ordinary user may still write in the file system of a folder.
pub fn free_bytes(folder: &Path) -> io::Result<u64> {
    let state = nix::sys::statvfs::statvfs(folder)?;
    Ok(state.blocks_available() * state.fragment_size())
}

/// One file of a session.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FileEntry {
    /// Path in the session, with forward slashes.
    pub path: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    #[serde(default)]
    pub sha256: String,
}

impl FileEntry {
    /// Whether its content can be held against a digest.
    pub(super) fn has_digest(&self) -> bool {
        self.sha256.len() == 64 && self.sha256.bytes().all(|byte| byte.is_ascii_hexdigit())
    }
}

/// Free space below which a warning is due.
pub const LOW_DISK_BYTES: u64 = 512 << 20;

/// The recording time left below which a warning is due, s.
pub const LOW_DISK_SECONDS: f64 = 120.0;

/// Space runs out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LowDisk {
    /// Bytes still free.
    pub free_bytes: u64,
    /// How long they last at the present rate, s; none while nothing arrives.
    pub seconds_left: Option<f64>,
}
