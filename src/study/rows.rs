//! Rows as plain data.

use serde::Serialize;
use serde_json::{Map, Value};

/// One row: names to numbers, texts, lists. Names are in alphabetical order.
pub type Row = Map<String, Value>;

/// The field of a row that stands for a task which failed: why.
pub(super) const FAILED: &str = "failed";

/// A number of a row; none where the field is missing or something else.
pub fn number(row: &Row, name: &str) -> Option<f64> {
    row.get(name)?.as_f64()
}

/// A text of a row; empty where the field is missing or something else.
pub fn text<'a>(row: &'a Row, name: &str) -> &'a str {
    row.get(name).and_then(Value::as_str).unwrap_or_default()
}

/// The fields of plain data as a row.
pub(super) fn row_of(data: &impl Serialize) -> Row {
    match serde_json::to_value(data) {
        Ok(Value::Object(row)) => row,
        _ => Row::new(),
    }
}

/// Rows in which every named field has the given text.
pub(super) fn chosen<'a>(rows: &'a [Row], wanted: &[(&str, &str)]) -> Vec<&'a Row> {
    rows.iter().filter(|row| wanted.iter().all(|(name, value)| text(row, name) == *value)).collect()
}

/// The numbers of a field, in the order of the rows.
pub(super) fn numbers(rows: &[&Row], name: &str) -> Vec<f64> {
    rows.iter().filter_map(|row| number(row, name)).collect()
}

/// The numbers of a field that is a list; none where it is missing.
pub(super) fn list(row: &Row, name: &str) -> Vec<f64> {
    let values = row.get(name).and_then(serde_json::Value::as_array);
    values.into_iter().flatten().filter_map(serde_json::Value::as_f64).collect()
}
