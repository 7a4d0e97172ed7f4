//! Reading mount files: our own format, and the published program's export.

use std::collections::BTreeMap;
use std::path::Path;

use super::{MountFile, MountFileError, published_export};
use crate::base::files;

impl MountFile {
    /// Reads a file, or the published program's export. Everything in it is checked: format, frame, names, models,
    /// finite numbers.
    pub fn read(path: &Path) -> Result<Self, MountFileError> {
        let text = crate::base::files::read_text(path)
            .map_err(|source| MountFileError::Unreadable { path: path.to_owned(), source })?;
        let mut file = Self::from_json(&text)
            .map_err(|reason| MountFileError::Wrong { path: path.to_owned(), reason })?;
        for calibration in file.calibrations.iter_mut().flat_map(BTreeMap::values_mut) {
            *calibration = files::folder_of(path).join(&*calibration);
        }
        Ok(file)
    }

    /// The same with its sensors in the order of a rig's axes.
    pub(crate) fn read_by_axis(path: &Path, names: &[String]) -> Result<Self, MountFileError> {
        Self::read(path)?.by_axis(names).map_err(|reason| MountFileError::Wrong {
            path: path.to_owned(),
            reason: format!("--sensors {}: {reason}", names.join(",")),
        })
    }

    pub(super) fn from_json(text: &str) -> Result<Self, String> {
        if published_export::is_published(text) {
            let file = published_export::mount_file(text)?;
            file.check()?;
            return Ok(file);
        }
        let reader = &mut serde_json::Deserializer::from_str(text);
        let file: Self = serde_path_to_error::deserialize(&mut *reader).map_err(|error| {
            let place = match error.path().to_string() {
                path if path == "." => String::new(),
                path => format!("at {path}: "),
            };
            format!("{place}{}; the fields are described under docs/design-a-mount.md", error.inner())
        })?;
        reader.end().map_err(|error| format!("{error}; a mount file is one JSON object"))?;
        file.check()?;
        Ok(file)
    }
}
