//! Metadata of Ousters: read from files, held against each other, found in a session.

use std::path::{Path, PathBuf};

use sensors::ouster::Metadata;
use sensors::router::SourceFilter;

use super::RecordingError;
use crate::recording::assigned_file::AssignedFile;
use crate::recording::{Manifest, SensorEntry};

/// Metadata of an Ouster.
pub(crate) struct MetadataFile {
    pub metadata: Metadata,
    /// The same as it was read.
    pub text: String,
    /// What messages call them.
    pub name: String,
    /// Which unit's they are, where somebody says.
    pub source_filter: Option<SourceFilter>,
}

/// The port that the sensor of a metadata file of a session was recorded from.
pub(super) fn recorded_from(manifest: &Manifest, dir: &Path, file: &Path) -> Option<SourceFilter> {
    let is_of =
        |entry: &&SensorEntry| entry.metadata.as_ref().is_some_and(|relative| dir.join(relative) == file);
    let mut entries = manifest.sensors.iter().filter(|entry| !manifest.is_auxiliary(entry)).filter(is_of);
    match (entries.next(), entries.next()) {
        (Some(entry), None) => entry.address.map(|address| SourceFilter::Port(address.port())),
        _ => None,
    }
}

/// The metadata in some files; what describes a unit as another file does counts once. What cannot be read goes to `tell`.
pub(super) fn metadata_of(
    files: &[AssignedFile],
    tell: &mut dyn FnMut(RecordingError) -> Result<(), RecordingError>,
) -> Result<Vec<MetadataFile>, RecordingError> {
    let mut known: Vec<MetadataFile> = Vec::with_capacity(files.len());
    for AssignedFile { source_filter, path } in files {
        let name = path.display().to_string();
        let (text, metadata) = match read(path, &name) {
            Ok(read) => read,
            Err(error) => {
                tell(error)?;
                continue;
            }
        };
        let same_unit = |other: &&MetadataFile| {
            let serial = metadata.serial_number();
            let is_one = serial.is_some_and(|serial| other.metadata.serial_number() == Some(serial));
            is_one
                && other.source_filter == *source_filter
                && other.metadata.packet_format() == metadata.packet_format()
        };
        match known.iter().find(same_unit) {
            Some(other) if as_decoded(&other.metadata) == as_decoded(&metadata) => {}
            Some(other) => {
                return Err(RecordingError::MetadataDiffer {
                    first: other.name.clone(),
                    second: name,
                    serial: metadata.serial,
                });
            }
            None => known.push(MetadataFile { metadata, text, name, source_filter: *source_filter }),
        }
    }
    Ok(known)
}

fn read(path: &Path, name: &str) -> Result<(String, Metadata), RecordingError> {
    let unreadable = |source| RecordingError::Unreadable { name: name.to_owned(), source };
    let text = crate::base::files::read_text(path).map_err(unreadable)?;
    let metadata = Metadata::parse(&text, name)?;
    Ok((text, metadata))
}

/// What decoding takes from metadata: not when it was switched on, what it runs and where it sends.
pub(super) fn as_decoded(metadata: &Metadata) -> Metadata {
    let firmware = String::new();
    let (lidar_port, imu_port, zone_port, destination) = (None, None, None, None);
    Metadata { init_id: 0, firmware, lidar_port, imu_port, zone_port, destination, ..metadata.clone() }
}

/// The metadata files of a session; none of what is no session.
pub(crate) fn session_metadata(session: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    json_files(&session.join(crate::recording::file::METADATA))
}

pub(super) fn json_files(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let refused = |source| RecordingError::File { name: folder.display().to_string(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if path.extension().is_some_and(|extension| extension == "json") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
