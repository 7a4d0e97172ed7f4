//! The files of a recording, before it is opened.

use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::RecordingError;
use crate::recording::Session;
use crate::recording::bags::is_bag_folder;
use crate::recording::packet_reader::keep_stream;

/// Packets looked at before decoding, where several sensors have to be separated by sender, or where an HDL-64E
/// has not sent its calibration yet.
const LEARN_PACKETS: usize = 20_000;

/// Packets within which every sensor of a recording has sent something.
const MEET_PACKETS: usize = 1000;

/// Refuses what is not there, and a folder that is no session.
pub(crate) fn ensure_recording(path: &Path) -> Result<(), RecordingError> {
    if path.as_os_str() != "-"
        && let Err(source) = path.metadata()
    {
        return Err(RecordingError::File { name: path.display().to_string(), source });
    }
    if path.is_dir() && !Session::is_session(path) && !is_bag_folder(path) {
        return Err(RecordingError::NoRecording { path: path.to_owned() });
    }
    Ok(())
}

/// The packets of a session: a file that lies in its folder.
pub(crate) fn packets_of(session: &Path) -> Result<PathBuf, RecordingError> {
    let path = session.join(crate::recording::file::PACKETS);
    match inside_of(session, &path) {
        Ok(()) => Ok(path),
        Err(source) => Err(RecordingError::File { name: path.display().to_string(), source }),
    }
}

/// Whether a path in a folder leads to a file there.
pub(super) fn inside_of(folder: &Path, path: &Path) -> std::io::Result<()> {
    crate::base::files::open_inside(folder, path.strip_prefix(folder).unwrap_or(path)).map(drop)
}

/// Looks at packets before any is decoded: `look` learns from one and says whether nothing is left to learn; none at the
/// end of the packets.
pub(crate) fn look_first(mut look: impl FnMut() -> Option<bool>) {
    for looked_at in 1..=LEARN_PACKETS {
        match look() {
            Some(is_all) if !is_all || looked_at < MEET_PACKETS => {}
            _ => return,
        }
    }
}

/// A temporary copy of what can be read only once; none for another file.
pub(crate) fn spool(path: &Path) -> Result<Option<NamedTempFile>, RecordingError> {
    keep_stream(path).map_err(|source| RecordingError::NotCopied { name: name_of(path), source })
}

/// What messages call a file that is read.
pub(crate) fn name_of(path: &Path) -> String {
    if path.as_os_str() == "-" { "standard input".into() } else { path.display().to_string() }
}
