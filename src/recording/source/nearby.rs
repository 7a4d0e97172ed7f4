//! Metadata files that lie in the folder of a capture.

use std::path::{Path, PathBuf};

use sensors::ouster::Metadata;

use super::found_metadata::OustersMet;
use super::metadata::{MetadataFile, as_decoded, json_files, metadata_of};
use super::{Recording, look_first};
use crate::recording::assigned_file::AssignedFile;
use crate::recording::packet_reader::PacketReader;

/// Metadata files looked at when none was given.
const MAX_NEARBY_FILES: usize = 200;
const MOST_METADATA_BYTES: u64 = 1 << 20;

impl Recording {
    /// Metadata files in the folder of the capture that describe one of these sensors, or that bear its name; with packets
    /// of one of these lengths, where any is known, and none of whom others are given. What says the same counts once.
    pub(crate) fn nearby_metadata(&self, serials: &[u64], packet_bytes: &[usize]) -> Vec<PathBuf> {
        let Some(stem) = self.path.file_stem().and_then(|stem| stem.to_str()) else { return Vec::new() };
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let Ok(files) = json_files(folder.unwrap_or(Path::new("."))) else { return Vec::new() };
        let named = |path: &PathBuf| {
            let name = path.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
            name.strip_prefix(stem).is_some_and(|rest| ["", "_0", ".0", "_1", ".1", ".2"].contains(&rest))
        };
        let is_given = |path: &Path| {
            self.metadata.iter().any(|given| crate::base::files::is_same(path, Path::new(&given.name)))
        };
        let of_given =
            |serial: u64| self.metadata.iter().any(|given| given.metadata.serial_number() == Some(serial));
        let mut known: Vec<Metadata> = Vec::new();
        let mut describes = |path: &PathBuf| {
            let small = std::fs::metadata(path).is_ok_and(|file| file.len() < MOST_METADATA_BYTES);
            let text =
                if small { crate::base::files::read_text(path).unwrap_or_default() } else { String::new() };
            // what does not read as metadata is not what is looked for
            let Ok(metadata) = Metadata::parse(&text, "") else { return false };
            let length = metadata.packet_format().packet_bytes();
            let is_wanted = match metadata.serial_number() {
                Some(serial) if serials.contains(&serial) => true,
                Some(serial) if of_given(serial) => false,
                _ => named(path),
            };
            let metadata = as_decoded(&metadata);
            if !is_wanted
                || is_given(path)
                || !(packet_bytes.is_empty() || packet_bytes.contains(&length))
                || known.contains(&metadata)
            {
                return false;
            }
            known.push(metadata);
            true
        };
        files.into_iter().take(MAX_NEARBY_FILES).filter(|path| describes(path)).collect()
    }

    /// Metadata that lie next to it and describe its sensors, where none were given.
    pub(super) fn metadata_found(&self) -> Vec<MetadataFile> {
        let is_looked_for = self.metadata.is_empty() && self.session.is_none();
        if !is_looked_for || !(self.path.is_file() || self.bag.is_some()) {
            return Vec::new();
        }
        let Ok(mut reader) = PacketReader::open(&self.path, &self.name) else { return Vec::new() };
        let mut met = OustersMet::default();
        look_first(|| {
            met.add(&reader.next().ok()??);
            Some(true)
        });
        if met.is_empty() {
            return Vec::new();
        }
        let nearby = self.nearby_metadata(&met.serials, &met.lengths);
        let chosen =
            met.choose(nearby, &self.path).into_iter().map(|path| AssignedFile { source_filter: None, path });
        metadata_of(&chosen.collect::<Vec<_>>(), &mut |_| Ok(())).unwrap_or_default()
    }
}
