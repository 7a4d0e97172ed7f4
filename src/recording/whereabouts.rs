//! Whether a session still lies where its name says: folders are moved, deleted and unmounted while someone records.

use std::fs::{self, File, Metadata};
use std::io;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nix::errno::Errno;

use super::file;

/// The files that stay open while a session is written, in this order.
pub(super) const OPEN_FILES: [&str; 3] = [file::PACKETS, file::SERVO, file::EVENTS];

/// The open folder of a session and its open files.
#[derive(Debug)]
pub(super) struct Whereabouts {
    dir: PathBuf,
    folder: File,
    files: [File; 3],
    /// Some file systems give a file a new number at each request: nothing can be concluded there.
    has_stable_numbers: bool,
}

/// What should lie in the folder.
pub(super) struct Expected {
    /// Bytes of the open files.
    pub bytes: [u64; 3],
    /// Paths of the closed ones, in the session.
    pub closed: Vec<String>,
}

/// Files that were removed from a session while it was being written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Displaced {
    /// What happened, in words.
    pub words: String,
    /// Where the folder can be written to now; none where it is gone.
    pub(super) home: Option<PathBuf>,
    /// What became of the packets that were written.
    pub(super) packets: PacketsLeft,
}

/// How much of packets.pcapng is left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PacketsLeft {
    /// The whole folder lies elsewhere, and nothing is missing in it.
    WholeSession,
    /// All packets; another file of the session is missing.
    All,
    /// What the file that was cut still holds.
    Some,
    None,
}

impl Whereabouts {
    /// Of a folder and its files, just made.
    pub(crate) fn new(dir: &Path, files: [File; 3]) -> io::Result<Self> {
        let mut made =
            Self { dir: dir.to_owned(), folder: File::open(dir)?, files, has_stable_numbers: true };
        made.has_stable_numbers = made.check(&Expected { bytes: [0; 3], closed: Vec::new() }).is_none();
        Ok(made)
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Asks the disk to have what was written.
    pub(crate) fn sync(&self) -> io::Result<()> {
        self.files.iter().try_for_each(File::sync_data)
    }

    /// The files that were removed, if any were.
    pub(crate) fn check(&self, expected: &Expected) -> Option<Displaced> {
        if !self.has_stable_numbers {
            return None;
        }
        let folder = self.folder.metadata().ok()?;
        match fs::metadata(&self.dir) {
            Ok(found) if is_same(&found, &folder) => {}
            Err(error) if !leads_nowhere(&error) => return None, // the system does not say
            _ => return Some(self.without_folder(&folder)),
        }
        let open = OPEN_FILES.iter().zip(&self.files).zip(expected.bytes);
        let of_open = open.filter_map(|((name, file), bytes)| self.check_file(name, file, bytes)).next();
        of_open.or_else(|| {
            let is_absent = |name: &&String| matches!(self.dir.join(name).try_exists(), Ok(false));
            let name = expected.closed.iter().find(is_absent)?;
            Some(self.of_file(name, "was deleted or moved".into(), PacketsLeft::All))
        })
    }

    fn without_folder(&self, folder: &Metadata) -> Displaced {
        let (shown, link) = (self.dir.display(), link_of(&self.folder));
        let target = fs::read_link(&link).unwrap_or_default();
        if fs::metadata(&target).is_ok_and(|found| is_same(&found, folder)) {
            let words = format!("{shown} was moved to {} while recording", target.display());
            return Displaced { words, home: Some(target), packets: PacketsLeft::WholeSession };
        }
        if is_deleted(folder, &target) {
            let words = format!("{shown} was deleted while recording, or moved to another disk");
            return Displaced { words, home: None, packets: PacketsLeft::None };
        }
        let words = format!(
            "{shown} cannot be reached any more: its disk was unmounted, or another one mounted over it, while recording"
        );
        Displaced { words, home: Some(link), packets: PacketsLeft::WholeSession }
    }

    fn check_file(&self, name: &str, file: &File, bytes: u64) -> Option<Displaced> {
        let open = file.metadata().ok()?;
        let left = |all: PacketsLeft| if name == file::PACKETS { all } else { PacketsLeft::All };
        let how = match fs::metadata(self.dir.join(name)) {
            Ok(found) if is_same(&found, &open) => {
                let how = format!("was cut to {} of {bytes} bytes", open.len());
                return (open.len() < bytes).then(|| self.of_file(name, how, left(PacketsLeft::Some)));
            }
            Ok(_) => "was replaced by another file",
            Err(error) if leads_nowhere(&error) => "was deleted",
            Err(_) => return None,
        };
        let target = fs::read_link(link_of(file)).unwrap_or_default();
        if is_deleted(&open, &target) {
            return Some(self.of_file(name, how.into(), left(PacketsLeft::None)));
        }
        let how = format!("was moved to {}", target.display());
        Some(self.of_file(name, how, left(PacketsLeft::All)))
    }

    fn of_file(&self, name: &str, how: String, packets: PacketsLeft) -> Displaced {
        let words = format!("{} {how} while recording", self.dir.join(name).display());
        Displaced { words, home: Some(self.dir.clone()), packets }
    }
}

/// A path that leads to an open file wherever that lies.
fn link_of(file: &File) -> PathBuf {
    format!("/proc/self/fd/{}", file.as_raw_fd()).into()
}

fn is_same(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Not every file system counts the names of a folder: the system marks the path, too.
fn is_deleted(file: &Metadata, target: &Path) -> bool {
    file.nlink() == 0 || target.to_string_lossy().ends_with(" (deleted)")
}

fn leads_nowhere(error: &io::Error) -> bool {
    let errno = error.raw_os_error().map(Errno::from_raw);
    matches!(errno, Some(Errno::ENOENT | Errno::ENOTDIR | Errno::ELOOP))
}
