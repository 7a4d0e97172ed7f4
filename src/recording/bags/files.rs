//! Which files a path names: one bag, or the folder of a ROS 2 bag with its parts in order. Whole files that are packed are
//! unpacked to temporary ones.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tempfile::{NamedTempFile, TempPath};

use super::unpack::{self, Lz4Frames};
use super::{BagError, Losses};
use crate::base::files::{self, inside, read_text};

/// What rosbag2 writes next to the files of a bag.
const METADATA: &str = "metadata.yaml";
/// Files of one bag.
const MOST_FILES: usize = 100_000;
/// No recording of packets packs better: what does is a trap.
const MOST_PACKING_RATIO: u64 = 1000;
/// First bytes of an LZ4 frame.
const LZ4: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];

pub(super) const ROS1_MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// What every bag of ROS 1 begins with, also those of formats before 2.0.
const ANY_ROS1_MAGIC: &[u8] = b"#ROSBAG V";
pub(super) const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
const DB3_MAGIC: &[u8] = b"SQLite format 3\0";

/// The formats of a bag's files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Ros1,
    Mcap,
    Db3,
}

impl Kind {
    pub fn of(start: &[u8]) -> Option<Self> {
        let kinds = [(ANY_ROS1_MAGIC, Self::Ros1), (MCAP_MAGIC, Self::Mcap), (DB3_MAGIC, Self::Db3)];
        kinds.into_iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, kind)| kind)
    }

    #[cfg(not(all(feature = "mcap", feature = "db3")))]
    pub fn left_out(self, name: &str) -> BagError {
        BagError::Unsupported {
            name: name.to_owned(),
            found: format!("a bag of kind {self:?}"),
            instead: "this program was built without it (features `mcap` and `db3`)",
        }
    }
}

/// How a whole file is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packed {
    Zstd,
    Lz4,
}

impl Packed {
    pub fn of(start: &[u8]) -> Option<Self> {
        match start {
            start if start.starts_with(&unpack::ZSTD) => Some(Self::Zstd),
            start if start.starts_with(&LZ4) => Some(Self::Lz4),
            _ => None,
        }
    }

    /// Its content.
    pub fn open(self, read: impl Read + Send + 'static) -> io::Result<Box<dyn Read + Send>> {
        Ok(match self {
            Self::Zstd => Box::new(zstd::Decoder::new(read)?),
            Self::Lz4 => Box::new(Lz4Frames::new(read)?),
        })
    }
}

/// Number of bytes that identify a format.
pub(crate) const START_BYTES: usize = 16;

/// The first bytes of a stream.
pub(crate) fn start_of(read: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut start = Vec::with_capacity(START_BYTES);
    read.take(START_BYTES as u64).read_to_end(&mut start)?;
    Ok(start)
}

/// Whether a file begins as a bag does.
pub(crate) fn is_bag(start: &[u8]) -> bool {
    Kind::of(start).is_some()
}

/// Whether a folder is that of a ROS 2 bag.
pub(crate) fn is_bag_folder(folder: &Path) -> bool {
    folder.join(METADATA).is_file() || bags_in(folder).is_ok_and(|files| !files.is_empty())
}

/// Whether a path leads to a bag, packed or not. What cannot be read is none.
pub(crate) fn is_bag_at(path: &Path) -> bool {
    if path.is_dir() {
        return is_bag_folder(path);
    }
    if !path.is_file() {
        return false;
    }
    let Ok(mut file) = files::open(path) else { return false };
    let Ok(start) = start_of(&mut file) else { return false };
    is_bag(&start) || holds_bag(&start, file)
}

/// Whether what is packed in a file, of which the start was read, is a bag.
fn holds_bag(start: &[u8], rest: File) -> bool {
    let Some(packed) = Packed::of(start) else { return false };
    let content = packed.open(io::Cursor::new(start.to_vec()).chain(rest));
    content.and_then(|mut content| start_of(&mut content)).is_ok_and(|start| is_bag(&start))
}

/// The files of a bag, in order.
#[derive(Default)]
pub(super) struct BagFiles {
    pub files: Vec<BagFile>,
    /// What is missing already.
    pub losses: Losses,
    /// Those that were unpacked to be read.
    unpacked: Vec<TempPath>,
}

/// One file of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct BagFile {
    /// Where it is read from.
    pub path: PathBuf,
    /// What messages call it.
    pub name: String,
}

impl BagFile {
    pub fn io(&self, doing: &'static str, source: io::Error) -> BagError {
        BagError::Io { name: self.name.clone(), doing, source }
    }
}

pub(super) fn find(path: &Path, name: &str) -> Result<BagFiles, BagError> {
    let mut found = BagFiles::default();
    let listed = match path.is_dir() {
        true => listed_in(path, &mut found.losses)?,
        false => vec![path.to_owned()],
    };
    for file in listed {
        let name = if file == path { name.to_owned() } else { file.display().to_string() };
        let mut file = BagFile { path: file, name };
        let start = files::open(&file.path).and_then(|mut opened| start_of(&mut opened));
        let start = start.map_err(|source| file.io("cannot be read", source))?;
        if let Some(packed) = Packed::of(&start) {
            let content = unpack_file(&file.path, packed);
            let content = content.map_err(|source| file.io("cannot be unpacked", source))?;
            file.path = content.to_path_buf();
            found.unpacked.push(content);
        }
        found.files.push(file);
    }
    Ok(found)
}

/// The file in a temporary one, unpacked.
fn unpack_file(path: &Path, packed: Packed) -> io::Result<TempPath> {
    let file = files::open(path)?;
    let most = file.metadata()?.len().saturating_mul(MOST_PACKING_RATIO);
    let mut content = NamedTempFile::new()?;
    let unpacked = io::copy(&mut packed.open(file)?.take(most + 1), &mut content)?;
    if unpacked > most {
        let words =
            format!("it holds more than {MOST_PACKING_RATIO} times its size: no recording packs so well");
        return Err(io::Error::new(io::ErrorKind::InvalidData, words));
    }
    Ok(content.into_temp_path())
}

/// What metadata.yaml says.
#[derive(Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    #[serde(default)]
    relative_file_paths: Vec<String>,
}

/// The files that metadata.yaml lists, otherwise those of a folder that look like parts of a bag.
fn listed_in(folder: &Path, losses: &mut Losses) -> Result<Vec<PathBuf>, BagError> {
    let io = |source| BagError::io(folder, "cannot be read", source);
    let metadata = folder.join(METADATA);
    let mut files = Vec::new();
    if metadata.is_file() {
        let text =
            read_text(&metadata).map_err(|source| BagError::io(&metadata, "cannot be read", source))?;
        let names = match serde_saphyr::from_str::<Metadata>(&text) {
            Ok(metadata) => metadata.rosbag2_bagfile_information.relative_file_paths,
            Err(error) => {
                losses.push(format!(
                    "{}: {error}; the bag's files are read by their names",
                    metadata.display()
                ));
                Vec::new()
            }
        };
        for name in names.iter().take(MOST_FILES) {
            // its compressor may have renamed it since, and older ones list it with the folder's name
            let short = Path::new(name).file_name().map(PathBuf::from).unwrap_or_default();
            let candidates = [name.into(), format!("{name}.zstd").into(), short];
            let there: Option<PathBuf> =
                candidates.iter().find_map(|name: &PathBuf| inside(folder, name).ok());
            match there {
                Some(path) => files.push(path),
                None => losses.push(format!(
                    "{}: the file {name}, which {METADATA} lists, is missing",
                    folder.display()
                )),
            }
        }
    }
    if files.is_empty() {
        files = bags_in(folder).map_err(io)?;
    }
    if files.is_empty() {
        return Err(BagError::Unsupported {
            name: folder.display().to_string(),
            found: "a folder without a bag's files".into(),
            instead: "expected .mcap or .db3 files (also .zstd) in it",
        });
    }
    Ok(files)
}

/// Files of a folder that are named as parts of a ROS 2 bag, in the order of their numbers.
fn bags_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)?.take(MOST_FILES) {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let plain = name.strip_suffix(".zstd").unwrap_or(&name);
        if (plain.ends_with(".mcap") || plain.ends_with(".db3")) && path.is_file() {
            files.push(path);
        }
    }
    files.sort_by_cached_key(|path| by_number(&path.file_name().unwrap_or_default().to_string_lossy()));
    Ok(files)
}

/// A name as a key that sorts its numbers as numbers.
fn by_number(name: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0_u64)];
    let mut in_number = false;
    for letter in name.chars() {
        match letter.to_digit(10) {
            Some(digit) => {
                in_number = true;
                if let Some((_, number)) = parts.last_mut() {
                    *number = number.saturating_mul(10).saturating_add(u64::from(digit));
                }
            }
            None => {
                if std::mem::take(&mut in_number) {
                    parts.push((String::new(), 0));
                }
                if let Some((text, _)) = parts.last_mut() {
                    text.push(letter);
                }
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_sort_by_their_numbers() {
        let mut names = ["walk_10.db3", "walk_2.db3", "walk_0.db3", "a_3.db3"];
        names.sort_by_key(|name| by_number(name));
        assert_eq!(names, ["a_3.db3", "walk_0.db3", "walk_2.db3", "walk_10.db3"]);
    }

    #[test]
    fn a_file_that_unpacks_to_too_much_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bomb.mcap.zstd");
        std::fs::write(&path, zstd::encode_all(&vec![0; 32 << 20][..], 1).unwrap()).unwrap();
        let error = find(&path, &path.display().to_string()).map(drop).unwrap_err().to_string();
        assert!(
            error.contains("bomb.mcap.zstd: cannot be unpacked: it holds more than 1000 times"),
            "{error}"
        );
    }

    #[test]
    fn a_list_that_leads_out_of_the_folder_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let list =
            "rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n    - ../secret.db3\n";
        std::fs::write(folder.path().join(METADATA), list).unwrap();
        assert!(find(folder.path(), "bag").is_err());
        std::fs::write(folder.path().join("own_0.db3"), "no bag").unwrap();
        let found = find(folder.path(), "bag").unwrap();
        assert_eq!(found.files.len(), 1);
        assert_eq!(found.files[0].path, folder.path().join("own_0.db3"));
        assert_eq!(found.losses.words.len(), 1);
    }
}
