//! Files that appear under their name only when they are whole, files that another file names, text files, and checksums as
//! text.

use std::fs::{File, FileType};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::{Component, Path, PathBuf};

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use tempfile::NamedTempFile;

/// A nameless file in the folder of `path`, as readable as the user's umask makes other files; persist it to `path`
/// when it is whole.
pub(crate) fn temporary_near(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".outrigger-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the user's umask
    builder.tempfile_in(folder_of(path)).map_err(as_the_system_says)
}

/// Without the name of the temporary file, which tells a user nothing.
fn as_the_system_says(error: io::Error) -> io::Error {
    match error.to_string().split_once(" at path ") {
        Some((reason, _)) => io::Error::new(error.kind(), reason.to_owned()),
        None => error,
    }
}

/// Looks whether a file could be put under its name, before the work is done that it is to hold.
pub(crate) fn check_place(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Err(io::Error::new(
            io::ErrorKind::IsADirectory,
            "it is a folder, expected the name of a file",
        ));
    }
    temporary_near(path).map(drop)
}

/// Looks whether files could be put into a folder, which is made when there is something to put there.
pub(crate) fn check_folder(folder: &Path) -> io::Result<()> {
    let nearest = folder.ancestors().find(|at| at.exists()).unwrap_or(Path::new("."));
    temporary_near(&nearest.join("file")).map(drop)
}

/// Puts a file under its name whole or not at all, and on the disk.
pub(crate) fn write_whole(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = temporary_near(path)?;
    file.as_file_mut().write_all(content)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    sync_folder(folder_of(path))
}

/// Opens a file on a disk; anything else (a folder, a pipe, a device) is an error, and never waited for.
pub fn open(path: &Path) -> io::Result<File> {
    let (file, kind) = open_at_once(path)?;
    if kind.is_fifo() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a pipe, expected a file"));
    }
    Ok(file)
}

/// Reads a file, or a pipe that someone writes to (a shell's `<(command)`); a pipe without a writer would be waited for
/// for ever, and a device may never end.
pub(crate) fn read(path: &Path) -> io::Result<Vec<u8>> {
    let (mut file, kind) = open_at_once(path)?;
    let mut content = Vec::new();
    if kind.is_fifo() {
        let mut start = [0; 4096];
        match file.read(&mut start) {
            Ok(0) => {
                let words = "it is a pipe without a writer, expected a file";
                return Err(io::Error::new(io::ErrorKind::InvalidInput, words));
            }
            Ok(count) => content.extend_from_slice(&start[..count]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {} // its writer is not so far
            Err(error) => return Err(error),
        }
        fcntl(&file, FcntlArg::F_SETFL(OFlag::empty()))?;
    }
    file.read_to_end(&mut content)?;
    Ok(content)
}

/// Opens what can be read to its end: a file or a pipe, without waiting for a pipe's writer.
fn open_at_once(path: &Path) -> io::Result<(File, FileType)> {
    let file = File::options().read(true).custom_flags(OFlag::O_NONBLOCK.bits()).open(path)?;
    let kind = file.metadata()?.file_type();
    if kind.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder, expected a file"));
    }
    if !kind.is_file() && !kind.is_fifo() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a device, expected a file"));
    }
    Ok((file, kind))
}

/// The path of a file that another file in `folder` names. Who wrote that may be anyone: the name may not lead out of the
/// folder, be it by itself or by a link.
pub(crate) fn inside(folder: &Path, named: &Path) -> io::Result<PathBuf> {
    ensure_inside(named)?;
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let path = folder.join(named);
    let real = path.canonicalize()?;
    if !real.starts_with(folder.canonicalize()?) {
        let words =
            format!("it is a link out of its folder, to {}; expected a file in the folder", real.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, words));
    }
    Ok(path)
}

/// Whether a name can be that of a file in a folder: it is no absolute path and has no `..`.
pub(crate) fn ensure_inside(named: &Path) -> io::Result<()> {
    let is_inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    if named.as_os_str().is_empty() || !named.components().all(is_inside) {
        let words =
            format!("{:?} leads out of the folder; expected a path in it, without `..`", named.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, words));
    }
    Ok(())
}

/// Opens the file that another file in `folder` names, as [`inside`] and [`open`] allow.
pub(crate) fn open_inside(folder: &Path, named: impl AsRef<Path>) -> io::Result<File> {
    open(&inside(folder, named.as_ref())?)
}

/// Reads that file.
pub(crate) fn read_inside(folder: &Path, named: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    open_inside(folder, named)?.read_to_end(&mut content)?;
    Ok(content)
}

/// Reads a text file.
///
/// # Errors
/// What the system says, or the first byte that is no text: some other file was named.
pub fn read_text(path: impl AsRef<Path>) -> io::Result<String> {
    text(read(path.as_ref())?)
}

/// Bytes as text; UTF-16 with its byte order mark too, as shells of Windows write it.
///
/// # Errors
/// The first byte that is none.
pub fn text(bytes: Vec<u8>) -> io::Result<String> {
    let in_words = |from: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| from([pair[0], pair[1]])).collect();
        String::from_utf16(&words).map_err(|_| {
            let words = "expected text in UTF-16, as its first two bytes say, found half of a character";
            io::Error::new(io::ErrorKind::InvalidData, words)
        })
    };
    match bytes.first_chunk() {
        Some([0xff, 0xfe]) => return in_words(u16::from_le_bytes),
        Some([0xfe, 0xff]) => return in_words(u16::from_be_bytes),
        _ => {}
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let byte = error.as_bytes()[at];
        let words = format!("expected text in UTF-8, found {byte:#04x} at byte {at}: another kind of file?");
        io::Error::new(io::ErrorKind::InvalidData, words)
    })
}

/// Puts a JSON document under its name whole or not at all.
pub(crate) fn write_json(path: &Path, document: &impl serde::Serialize) -> io::Result<()> {
    let mut text = serde_json::to_vec_pretty(document).map_err(io::Error::other)?;
    text.push(b'\n');
    write_whole(path, &text)
}

/// Descriptors that a runtime, its sockets and a session take at most.
const DESCRIPTORS: usize = 16;

/// Refuses to go on where hardly any file can be opened any more: the library that waits for sockets and signals panics then.
pub(crate) fn ensure_descriptors() -> io::Result<()> {
    let opened: io::Result<Vec<File>> = (0..DESCRIPTORS).map(|_| File::open("/dev/null")).collect();
    opened.map(drop).map_err(|error| {
        let words = format!(
            "fewer than {DESCRIPTORS} more files can be opened ({error}): raise the limit (`ulimit -n 1024`)"
        );
        io::Error::new(error.kind(), words)
    })
}

/// Brings the names in a folder to the disk.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// What a file's name says about its format: the extension in small letters, empty where there is none.
pub(crate) fn ending(path: &Path) -> String {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// Whether two paths lead to one file that is there.
pub(crate) fn is_same(one: &Path, other: &Path) -> bool {
    let real = std::fs::canonicalize(one).ok();
    real.is_some() && real == std::fs::canonicalize(other).ok()
}

/// The folder a path lies in; the current one for a bare name.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Bytes as hexadecimal digits.
pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // a String takes everything
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_whole_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let existing = folder.path().join("existing");
        std::fs::create_dir(&existing).unwrap();
        assert!(write_whole(&existing, b"x").is_err() && check_place(&existing).is_err());
        let message = check_place(&folder.path().join("absent/a.json")).unwrap_err().to_string();
        assert!(!message.contains(".outrigger-"), "{message}");
        assert!(check_place(&folder.path().join("absent/a.json")).is_err());
        check_place(&folder.path().join("a.json")).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let path = folder.path().join("a.json");
        write_json(&path, &[1, 2]).unwrap();
        assert_eq!(read_text(path).unwrap(), "[\n  1,\n  2\n]\n");
    }

    #[test]
    fn bytes_that_are_no_text_are_named_with_their_offset() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcap");
        std::fs::write(&path, b"ab\xd4\xc3").unwrap();
        let message = read_text(&path).unwrap_err().to_string();
        assert!(message.contains("0xd4 at byte 2"), "{message}");
        assert_eq!(read_text(folder.path().join("absent")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
