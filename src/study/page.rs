//! Findings as a report, rows and tables as CSV.

use std::collections::BTreeSet;

use serde_json::Value;

use super::{Claim, Figure, Findings, Row};
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

/// What a study found.
pub(crate) fn findings_report(name: &str, about: &str, findings: &Findings) -> Report {
    let mut report = Report::new(&format!("Study: {name}"), &findings.summary);
    report.detail("");
    report.note(about);
    if !findings.claims.is_empty() {
        report.heading("Claims");
        let row =
            |claim: &Claim| vec![claim.claim.clone(), claim.verdict.words().into(), claim.because.clone()];
        report.table(&["claim", "verdict", "because"], findings.claims.iter().map(row).collect());
    }
    report.heading("");
    for Figure { svg, caption } in &findings.figures {
        report.chart(svg, caption);
    }
    for table in &findings.tables {
        report.heading(&table.title);
        if !table.note.is_empty() {
            report.note(&table.note);
        }
        let columns: Vec<&str> = table.columns.iter().map(String::as_str).collect();
        report.table(&columns, table.rows.clone());
    }
    report
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
