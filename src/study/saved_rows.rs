//! What was done for an earlier plan of a study: it is not done again where tasks come or go.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::{Row, StudyError};
use crate::base::files;

const FORMAT: &str = "outrigger-study-kept/1";

/// `kept.json`: rows by task.
#[derive(Serialize, Deserialize)]
pub(super) struct SavedRows {
    format: String,
    /// Of `rows` as they are written, so that damage that leaves them readable is found.
    rows_sha256: String,
    /// By the task as it stands in a plan.
    rows: BTreeMap<String, Vec<Row>>,
}

impl SavedRows {
    /// What a folder holds; nothing where no plan was ever changed.
    pub(crate) fn read(folder: &Path) -> Result<Self, StudyError> {
        let path = folder.join("kept.json");
        let text = match files::read_text(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self { format: FORMAT.into(), rows_sha256: String::new(), rows: BTreeMap::new() });
            }
            text => text.map_err(|error| StudyError::at(&path, error))?,
        };
        let unusable =
            |why: String| StudyError::at(&path, format!("{why}: remove it, and its tasks are done again"));
        let saved: Self = serde_json::from_str(&text).map_err(|error| unusable(error.to_string()))?;
        if saved.format != FORMAT {
            return Err(unusable(format!("format is {:?}, this program reads {FORMAT:?}", saved.format)));
        }
        if sha256_of(&saved.rows) != saved.rows_sha256 {
            return Err(unusable("its rows are not those that were written (checksum)".into()));
        }
        Ok(saved)
    }

    pub(crate) fn keep(&mut self, task: &Value, rows: Vec<Row>) {
        self.rows.insert(task.to_string(), rows);
    }

    /// The rows of a task that was done.
    pub(crate) fn of(&self, task: &Value) -> Option<&Vec<Row>> {
        self.rows.get(&task.to_string())
    }

    /// Writes it, whole or not at all.
    pub(crate) fn write(mut self, folder: &Path) -> Result<(), StudyError> {
        self.rows_sha256 = sha256_of(&self.rows);
        let path = folder.join("kept.json");
        files::write_json(&path, &self).map_err(|error| StudyError::at(&path, error))
    }
}

/// SHA-256 of data as compact JSON, in hexadecimal digits.
pub(super) fn sha256_of(data: &impl Serialize) -> String {
    let text = serde_json::to_string(data).unwrap_or_default();
    files::hexadecimal(&Sha256::digest(text.as_bytes()))
}
