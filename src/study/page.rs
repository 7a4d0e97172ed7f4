//! Findings as a page, rows and tables as CSV.

use std::collections::BTreeSet;

use serde_json::Value;

use super::{Figure, Findings, Row, Study};
use crate::report::Report;

/// Rows as CSV (RFC 4180): every field that any row has, in alphabetical order; lists as JSON.
pub fn csv(rows: &[Row]) -> String {
    let columns: BTreeSet<&str> = rows.iter().flat_map(|row| row.keys().map(String::as_str)).collect();
    let mut text = line(columns.iter().map(|name| (*name).to_owned()));
    for row in rows {
        text += &line(columns.iter().map(|name| match row.get(*name) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        }));
    }
    text
}

/// One line of CSV.
pub(super) fn line(cells: impl Iterator<Item = String>) -> String {
    let quoted = cells.map(|cell| {
        if cell.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell
        }
    });
    quoted.collect::<Vec<_>>().join(",") + "\r\n"
}

/// The page of a study.
pub(crate) fn findings_page(study: &dyn Study, findings: &Findings, command: &str) -> Report {
    let mut page = Report::new(&format!("Study: {}", study.name()), &findings.summary, command);
    page.paragraph(study.about());
    page.paragraph(&format!("Made by {command}"));
    if !findings.claims.is_empty() {
        page.heading("Claims");
        let rows: Vec<Vec<String>> = findings
            .claims
            .iter()
            .map(|claim| vec![claim.claim.clone(), claim.verdict.words().into(), claim.because.clone()])
            .collect();
        page.table(&["claim", "verdict", "because"], &rows);
    }
    for Figure { svg, caption } in &findings.figures {
        page.figure(svg, caption);
    }
    for table in &findings.tables {
        page.heading(&table.title);
        if !table.note.is_empty() {
            page.paragraph(&table.note);
        }
        page.table(&table.columns.iter().map(String::as_str).collect::<Vec<_>>(), &table.rows);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_would_break_a_line_and_fills_gaps() {
        let row = |text: &str| serde_json::from_str::<Row>(text).unwrap();
        let rows = [row(r#"{"b": "x,\"y\"", "a": 1.5}"#), row(r#"{"c": [1, 2], "b": null}"#)];
        assert_eq!(csv(&rows), "a,b,c\r\n1.5,\"x,\"\"y\"\"\",\r\n,,\"[1,2]\"\r\n");
    }
}
