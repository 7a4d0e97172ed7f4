//! Reading typed values out of a JSON document, with errors that say where and what.

use std::borrow::Cow;

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

/// JSON as people keep it: without the byte order mark of editors (RFC 8259, section 8.1) and with comments turned into
/// spaces, so that lines and columns stay what they are.
pub(super) fn without_comments(text: &str) -> Cow<'_, str> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if !text.contains("//") && !text.contains("/*") {
        return Cow::Borrowed(text);
    }
    let mut clean = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(next) = rest.chars().next() {
        let (text_bytes, comment) = match next {
            '"' => (string_bytes(rest), 0),
            '/' if rest.starts_with("//") => (0, rest.find('\n').unwrap_or(rest.len())),
            '/' if rest.starts_with("/*") => {
                (0, rest[2..].find("*/").map_or(rest.len(), |end| end + "/**/".len()))
            }
            _ => (next.len_utf8(), 0),
        };
        clean.push_str(&rest[..text_bytes]);
        clean.extend(
            rest[text_bytes..text_bytes + comment].chars().map(|c| if c == '\n' { '\n' } else { ' ' }),
        );
        rest = &rest[text_bytes + comment..];
    }
    Cow::Owned(clean)
}

/// Bytes of the string that a text begins with, quotes included.
fn string_bytes(text: &str) -> usize {
    let mut is_escaped = false;
    for (at, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = true,
            b'"' => return at + 1,
            _ => {}
        }
    }
    text.len()
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

#[cfg(test)]
mod tests {
    use super::without_comments;

    #[test]
    fn comments_become_spaces_and_strings_stay() {
        let text = "\u{feff}{ // one\r\n\"a\": \"http://x/*y*/\\\"//\", /* two\nlines */ \"b\": 1 }";
        let clean = without_comments(text);
        let value: serde_json::Value = serde_json::from_str(&clean).unwrap();
        assert_eq!(value, serde_json::json!({"a": "http://x/*y*/\"//", "b": 1}));
        assert_eq!(clean.lines().count(), text.lines().count());
        assert!(serde_json::from_str::<serde_json::Value>(&without_comments("{ /* no end")).is_err());
    }
}
