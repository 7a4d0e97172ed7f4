//! Reading typed values out of a JSON document, with errors that say where and what.

use serde_json::{Map, Value};

/// What can be wrong with metadata; always names the file and the place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MetadataError {
    /// Not JSON.
    #[error("{name}: line {line}, column {column}: not JSON: {reason}")]
    NotJson {
        /// The file.
        name: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The parser's words.
        reason: String,
    },
    /// JSON, but not metadata.
    #[error("{name}: {path}: expected {expected}, found {found}")]
    Unexpected {
        /// The file.
        name: String,
        /// Where in the document.
        path: String,
        /// What belongs there.
        expected: String,
        /// What is there.
        found: String,
    },
}

/// One object of the document and how to call it in errors.
#[derive(Clone, Copy)]
pub(super) struct Section<'a> {
    pub(super) name: &'a str,
    pub(super) path: &'a str,
    pub(super) object: &'a Map<String, Value>,
}

impl<'a> Section<'a> {
    pub(super) fn error(
        &self,
        key: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> MetadataError {
        let path = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        MetadataError::Unexpected {
            name: self.name.to_owned(),
            path,
            expected: expected.into(),
            found: found.into(),
        }
    }

    fn get(&self, key: &str) -> Option<&'a Value> {
        self.object.get(key).filter(|value| !value.is_null())
    }

    pub(super) fn text(&self, key: &str) -> Result<Option<&'a str>, MetadataError> {
        self.get(key)
            .map(|value| value.as_str().ok_or_else(|| self.error(key, "a string", describe(value))))
            .transpose()
    }

    /// A whole number in a range.
    pub(super) fn integer(
        &self,
        key: &str,
        range: std::ops::RangeInclusive<u64>,
    ) -> Result<Option<u64>, MetadataError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        match value.as_u64() {
            Some(number) if range.contains(&number) => Ok(Some(number)),
            _ => {
                let expected = format!("a whole number from {} to {}", range.start(), range.end());
                Err(self.error(key, expected, describe(value)))
            }
        }
    }

    pub(super) fn number(&self, key: &str) -> Result<Option<f64>, MetadataError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        value.as_f64().map(Some).ok_or_else(|| self.error(key, "a number", describe(value)))
    }

    pub(super) fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>, MetadataError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let list = value.as_array().ok_or_else(|| self.error(key, "a list of numbers", describe(value)))?;
        // gen-1 OS0 metadata nests the angles of four pixels each
        let flat = list.iter().flat_map(|item| match item {
            Value::Array(inner) => inner.iter().collect::<Vec<_>>(),
            _ => vec![item],
        });
        let numbers: Result<Vec<f64>, _> = flat
            .enumerate()
            .map(|(index, item)| {
                item.as_f64()
                    .ok_or_else(|| self.error(&format!("{key}[{index}]"), "a number", describe(item)))
            })
            .collect();
        numbers.map(Some)
    }

    pub(super) fn integers(&self, key: &str) -> Result<Option<Vec<i64>>, MetadataError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let list =
            value.as_array().ok_or_else(|| self.error(key, "a list of whole numbers", describe(value)))?;
        let integers: Result<Vec<i64>, _> = list
            .iter()
            .enumerate()
            .map(|(index, item)| {
                item.as_i64()
                    .ok_or_else(|| self.error(&format!("{key}[{index}]"), "a whole number", describe(item)))
            })
            .collect();
        integers.map(Some)
    }
}

/// A value in a few words, for errors.
pub(super) fn describe(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Object(object) => format!("an object of {} fields", object.len()),
        Value::String(text) => format!("{:?}", text.chars().take(60).collect::<String>()),
        other => other.to_string(),
    }
}
