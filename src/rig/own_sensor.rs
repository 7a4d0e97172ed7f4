//! Sensors that the user types: names of the catalogue, and files of their own.

use std::path::{Path, PathBuf};

use sensors::catalogue;

use super::{Unit, UnitChoice, UnitError};

/// The model that gives limits and housing to a table of beams without a model.
const LIKE: &str = "vlp-16";

impl Unit {
    /// A sensor as it is typed (a name of the catalogue, a file, or MODEL:FILE) and its file.
    ///
    /// # Errors
    /// No such name, and as `calibrated`.
    pub(crate) fn typed(text: &str) -> Result<(Self, Option<PathBuf>), UnitError> {
        match text.parse().map_err(UnitError::NotTyped)? {
            UnitChoice { sensor: Some(name), .. } => Err(UnitError::NotTyped(format!(
                "{text:?} names a sensor {name:?}, expected a model or a file"
            ))),
            UnitChoice { model, file: Some(file), .. } => {
                Ok((Self::calibrated(&file, model.as_deref())?, Some(file)))
            }
            UnitChoice { model, .. } => Ok((Self::nominal(model.as_deref().unwrap_or(text))?, None)),
        }
    }

    /// A sensor of which the user has a model file, a table of beams or a pattern.
    pub(super) fn of_own_file(
        path: &Path,
        text: &str,
        is_model: bool,
        stated: Option<&str>,
    ) -> Result<Self, UnitError> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let wrong = |source| UnitError::Own { path: path.to_owned(), source };
        if is_model {
            return Ok(Self::of_entry(catalogue::from_toml(&stem, text).map_err(wrong)?));
        }
        // a name that the catalogue lacks was made of the file's own
        let stated = stated.filter(|stated| catalogue::nominal(stated).is_ok());
        let base = catalogue::entry(stated.unwrap_or(LIKE))?;
        let mut unit =
            Self::of_entry(catalogue::from_csv(stated.unwrap_or(&stem), text, &base).map_err(wrong)?);
        if stated.is_none() {
            let path = path.display();
            unit.notice = Some(format!(
                "{path}: has beams only; limits and housing are {LIKE}'s; MODEL:{path} takes another's"
            ));
        }
        Ok(unit)
    }
}
