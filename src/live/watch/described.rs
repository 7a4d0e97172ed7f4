//! What is known of a sensor before its first packet.

use std::io;
use std::path::{Path, PathBuf};

use sensors::ouster::{Metadata, MetadataError};

use super::FirstLook;
use crate::live::config::Stream;
use crate::live::receive::{Listen, is_auxiliary};

/// A check of a sensor's first packets; auxiliary streams are not checked.
pub(crate) fn first_look(sensor: &Stream, metadata: Option<&str>, listens: &[Listen]) -> Option<FirstLook> {
    if is_auxiliary(&sensor.listen.name, listens.iter().map(|listen| listen.name.as_str())) {
        return None;
    }
    let name = match (&sensor.metadata, &sensor.host) {
        (Some(path), _) => path.display().to_string(),
        (None, host) => host.clone().unwrap_or_default(),
    };
    let metadata = metadata.and_then(|text| Metadata::parse(text, &name).ok());
    Some(FirstLook::new(sensor.model.clone(), metadata.map(|metadata| (metadata, name))))
}

/// Why a metadata file is of no use.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MetadataFileError {
    #[error("metadata {}", path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Metadata(#[from] MetadataError),
}

/// The text of a metadata file, which can be read.
pub(crate) fn read_metadata(path: &Path) -> Result<String, MetadataFileError> {
    let text = crate::base::files::read_text(path)
        .map_err(|source| MetadataFileError::Unreadable { path: path.to_owned(), source })?;
    Metadata::parse(&text, &path.display().to_string())?;
    Ok(text)
}
