//! Points as text, one a line: x, y, z and whatever comes behind; or the columns that a header names.

use super::{CloudPoint, Fault, NAMES, point, slot};
use crate::base::text;

/// Reads every line that is not a comment.
pub(super) fn read(bytes: &[u8], take: &mut dyn FnMut(CloudPoint)) -> Result<(), Fault> {
    let lines = text::lines(bytes).map_err(|reason| Fault::at("text", reason))?;
    let (mut columns, mut is_begun) = (vec![Some(0), Some(1), Some(2)], false);
    for (number, line) in lines {
        let trimmed = line.trim();
        let comment = ["#", "//", "%"].iter().find_map(|mark| trimmed.strip_prefix(mark));
        let fields: Vec<&str> = split(comment.unwrap_or(trimmed));
        let is_header = !is_begun && fields.iter().any(|field| slot(field) == Some(0));
        if is_header && fields.iter().all(|field| field.parse::<f64>().is_err()) {
            columns = header(&fields, number)?;
            continue;
        }
        if comment.is_some() || fields.is_empty() {
            continue;
        }
        // .pts begins with the number of points
        if !is_begun && fields.len() == 1 && fields[0].parse::<u64>().is_ok() {
            continue;
        }
        is_begun = true;
        let mut numbers = [f64::NAN; NAMES.len()];
        for (field, column) in fields.iter().zip(&columns) {
            let Some(column) = column else { continue };
            numbers[*column] = field.parse().map_err(|_| {
                Fault::line(number, format!("{field:?} where {} is expected", NAMES[*column]))
            })?;
        }
        let last = columns.iter().rposition(|column| column.is_some_and(|column| column < 3)).unwrap_or(2);
        if fields.len() <= last {
            let reason = format!("{} numbers, expected {} or more: x y z", fields.len(), last + 1);
            return Err(Fault::line(number, reason));
        }
        take(point(&numbers));
    }
    Ok(())
}

fn header(fields: &[&str], number: usize) -> Result<Vec<Option<usize>>, Fault> {
    let columns: Vec<Option<usize>> = fields.iter().map(|field| slot(field)).collect();
    match (0..3).find(|axis| !columns.contains(&Some(*axis))) {
        Some(axis) => Err(Fault::line(number, format!("a header without {}", NAMES[axis]))),
        None => Ok(columns),
    }
}

fn split(line: &str) -> Vec<&str> {
    let separator = |letter: char| letter == ',' || letter == ';' || letter.is_whitespace();
    line.split(separator).map(|field| field.trim_matches('"')).filter(|field| !field.is_empty()).collect()
}
