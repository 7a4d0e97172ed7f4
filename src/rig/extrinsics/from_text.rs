//! 4x4 matrices as text: four lines of four numbers each, row by row, in metres: where a sensor sits on the platform.
//! A word alone above a matrix is the sensor's name; without one it is that of the file.

use super::{Extrinsics, Known, matrix};

pub(super) fn parse(text: &str, stem: &str) -> Result<Extrinsics, String> {
    let mut found = Extrinsics::default();
    let mut name: Option<String> = None;
    let mut rows: Vec<f64> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line_number = index + 1;
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let words =
            line.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|word| !word.is_empty());
        let numbers: Result<Vec<f64>, _> = words.map(str::parse::<f64>).collect();
        match numbers {
            Ok(numbers) if numbers.len() == 4 || (numbers.len() == 16 && rows.is_empty()) => {
                rows.extend(numbers)
            }
            Err(_) if rows.is_empty() && !line.contains(char::is_whitespace) => {
                name = Some(line.trim_end_matches(':').to_owned());
            }
            Ok(numbers) => {
                return Err(format!(
                    "line {line_number}: {} numbers, expected 4 of a row of a 4x4 matrix",
                    numbers.len()
                ));
            }
            Err(_) => {
                return Err(format!(
                    "line {line_number}: {line:?}, expected four numbers of a 4x4 matrix, or a name alone above one"
                ));
            }
        }
        if let Ok(numbers) = <&[f64; 16]>::try_from(&rows[..]) {
            let (pose, notice) =
                matrix::pose(numbers).map_err(|reason| format!("line {line_number}: {reason}"))?;
            let name = name.take().unwrap_or_else(|| stem.to_owned());
            found.notices.extend(notice.map(|notice| format!("{name}: {notice}")));
            found.put(&name, pose);
            found.known.insert(name, Known::default());
            rows.clear();
        }
    }
    if !rows.is_empty() {
        return Err(format!("ends after {} of the 16 numbers of a 4x4 matrix", rows.len()));
    }
    if found.links.is_empty() {
        return Err("has no 4x4 matrix: expected four lines of four numbers".into());
    }
    Ok(found)
}
