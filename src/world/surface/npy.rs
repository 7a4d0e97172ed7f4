//! NumPy's array file, as far as it holds points: format 1 to 3, little-endian f4 or f8, shape (n, 3), C order
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).

use std::path::Path;

use glam::DVec3;

const MAGIC: &[u8] = b"\x93NUMPY";

/// Points of an `.npy` file's bytes.
///
/// # Errors
/// The byte where the file ends or stops being such an array, with what was found and expected.
pub fn read_points(bytes: &[u8]) -> Result<Vec<DVec3>, NpyError> {
    if !bytes.starts_with(MAGIC) {
        return Err(NpyError { byte: 0, reason: "no NumPy array file: the magic is missing".into() });
    }
    let short = |byte: usize| NpyError { byte, reason: "the file ends inside the array's header".into() };
    let version = *bytes.get(6).ok_or_else(|| short(bytes.len()))?;
    let (start, length): (usize, usize) = match version {
        1 => {
            let two = bytes.get(8..10).ok_or_else(|| short(bytes.len()))?;
            (10, usize::from(u16::from_le_bytes([two[0], two[1]])))
        }
        2 | 3 => {
            let four = bytes.get(8..12).ok_or_else(|| short(bytes.len()))?;
            (12, u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
        }
        _ => return Err(NpyError { byte: 6, reason: format!("format {version}, expected 1, 2 or 3") }),
    };
    let header = start.checked_add(length).and_then(|end| bytes.get(start..end));
    let header = String::from_utf8_lossy(header.ok_or_else(|| short(bytes.len()))?);
    let fault = |reason: String| NpyError { byte: start, reason };
    let size = match field(&header, "descr").trim_matches(['\'', '"']) {
        "<f4" => 4,
        "<f8" => 8,
        other => return Err(fault(format!("numbers of type {other:?}, expected <f4 or <f8"))),
    };
    if field(&header, "fortran_order") != "False" {
        return Err(fault("Fortran order, expected C order".into()));
    }
    let shape =
        header.split("'shape':").nth(1).and_then(|rest| rest.split(['(', ')']).nth(1)).unwrap_or_default();
    let sides: Vec<usize> = shape.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    let [count, 3] = sides[..] else {
        return Err(fault(format!("shape ({shape}), expected (n, 3)")));
    };
    let body = &bytes[start + length..];
    let expected = count.checked_mul(3 * size);
    if expected != Some(body.len()) {
        let reason = format!("{} bytes of numbers, expected {count} x 3 x {size}", body.len());
        return Err(NpyError { byte: bytes.len(), reason });
    }
    let number = |bytes: &[u8]| match bytes {
        [a, b, c, d] => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
        _ => bytes.first_chunk().map_or(f64::NAN, |eight| f64::from_le_bytes(*eight)),
    };
    let point =
        |row: &[u8]| DVec3::new(number(&row[..size]), number(&row[size..2 * size]), number(&row[2 * size..]));
    Ok(body.chunks_exact(3 * size).map(point).collect())
}

/// The value of a key of the header's dictionary up to the next comma.
fn field<'a>(header: &'a str, key: &str) -> &'a str {
    let quoted = format!("'{key}':");
    header
        .split(quoted.as_str())
        .nth(1)
        .and_then(|rest| rest.split([',', '}']).next())
        .unwrap_or_default()
        .trim()
}

/// Why bytes are no array of points.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("byte {byte}: {reason}")]
pub struct NpyError {
    /// Where.
    pub byte: usize,
    /// What was found and what was expected.
    pub reason: String,
}

/// Writes flags, eight to a byte as `numpy.packbits` does, whole or not at all.
pub(crate) fn write_flags(path: &Path, flags: &[bool]) -> std::io::Result<()> {
    let packed: Vec<u8> = flags
        .chunks(8)
        .map(|eight| {
            eight.iter().enumerate().fold(0, |byte, (bit, flag)| byte | u8::from(*flag) << (7 - bit))
        })
        .collect();
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({},), }}", packed.len());
    // the data begin at a multiple of 64
    let padding = 63 - (10 + header.len()) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    let mut bytes = [MAGIC, &[1, 0]].concat();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(packed);
    crate::base::files::write_whole(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(body);
        bytes
    }

    #[test]
    fn reads_both_widths() {
        let body: Vec<u8> = [1.0_f32, 2.0, -3.5].iter().flat_map(|n| n.to_le_bytes()).collect();
        let narrow = file("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }", &body);
        assert_eq!(read_points(&narrow).unwrap(), [DVec3::new(1.0, 2.0, -3.5)]);
        let body: Vec<u8> = [0.1_f64, 2.0, -3.5].iter().flat_map(|n| n.to_le_bytes()).collect();
        let wide = file("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 3), }", &body);
        assert_eq!(read_points(&wide).unwrap(), [DVec3::new(0.1, 2.0, -3.5)]);
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }";
        let error = |bytes: &[u8]| read_points(bytes).unwrap_err().to_string();
        assert!(error(b"PK\x03\x04").contains("magic"));
        assert!(error(&file(good, &[0; 11])).contains("11 bytes of numbers"));
        assert!(error(&file(&good.replace("<f4", ">f4"), &[0; 12])).contains(">f4"));
        assert!(error(&file(&good.replace("False", "True"), &[0; 12])).contains("Fortran"));
        assert!(error(&file(&good.replace("(1, 3)", "(3,)"), &[0; 12])).contains("(3,)"));
        assert!(
            error(&file(&good.replace("(1, 3)", "(9999999999999999999, 3)"), &[0; 12])).contains("expected")
        );
        let whole = file(good, &[0; 12]);
        for end in 0..whole.len() {
            assert!(read_points(&whole[..end]).is_err(), "cut at {end}");
        }
    }
}
