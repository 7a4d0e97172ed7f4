//! PCD 0.5 to 0.7: text, binary, compressed. Source: Point Cloud Library, "The PCD file format".

use super::lzf::decompress;
use super::{CloudPoint, Fault, point, slot};

struct Field {
    /// Which of a point's numbers it is.
    slot: Option<usize>,
    size: usize,
    kind: char,
    count: usize,
}

#[derive(Default)]
struct Header {
    names: Vec<String>,
    sizes: Vec<usize>,
    kinds: Vec<char>,
    counts: Vec<usize>,
    points: Option<usize>,
    /// Width times height, where the number of points is not stated.
    width: usize,
    height: usize,
}

pub(super) fn read(bytes: &[u8], take: &mut dyn FnMut(CloudPoint)) -> Result<(), Fault> {
    let mut header = Header { height: 1, ..Header::default() };
    let mut start = 0;
    for number in 1.. {
        let rest = &bytes[start..];
        let Some(length) = rest.iter().position(|byte| *byte == b'\n') else {
            return Err(Fault::line(number, "the header ends without a line DATA"));
        };
        let line = String::from_utf8_lossy(&rest[..length]);
        start += length + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some((key, values)) = words.split_first() else { continue };
        if *key == "DATA" {
            let (fields, points) = header.check(number)?;
            let data = &bytes[start..];
            return match values {
                ["ascii"] => read_text(data, number, &fields, points, take),
                ["binary"] => read_binary(data, start, &fields, points, take),
                ["binary_compressed"] => read_compressed(data, start, &fields, points, take),
                _ => {
                    Err(Fault::line(number, format!("{line:?}, expected ascii, binary or binary_compressed")))
                }
            };
        }
        header.read(key, values).map_err(|what| Fault::line(number, format!("{line:?}: {what}")))?;
    }
    unreachable!("lines end before numbers do")
}

impl Header {
    fn read(&mut self, key: &str, values: &[&str]) -> Result<(), String> {
        let numbers = || -> Result<Vec<usize>, String> {
            values.iter().map(|text| text.parse().map_err(|_| format!("{text:?} is no number"))).collect()
        };
        let one = || match numbers()?[..] {
            [number] => Ok(number),
            _ => Err("expected one number".to_owned()),
        };
        match key {
            "FIELDS" => self.names = values.iter().map(|name| (*name).to_owned()).collect(),
            "SIZE" => self.sizes = numbers()?,
            "TYPE" => self.kinds = values.iter().filter_map(|kind| kind.chars().next()).collect(),
            "COUNT" => self.counts = numbers()?,
            "WIDTH" => self.width = one()?,
            "HEIGHT" => self.height = one()?,
            "POINTS" => self.points = Some(one()?),
            // comments, the version, the viewpoint
            _ => {}
        }
        Ok(())
    }

    fn check(&self, line: usize) -> Result<(Vec<Field>, usize), Fault> {
        let ones = vec![1; self.names.len()];
        let counts = if self.counts.is_empty() { &ones } else { &self.counts };
        if [self.sizes.len(), self.kinds.len(), counts.len()].iter().any(|len| *len != self.names.len()) {
            return Err(Fault::line(line, "FIELDS, SIZE, TYPE and COUNT differ in length"));
        }
        let field = |at: usize| Field {
            slot: slot(&self.names[at]),
            size: self.sizes[at],
            kind: self.kinds[at],
            count: counts[at],
        };
        let fields: Vec<Field> = (0..self.names.len()).map(field).collect();
        for (name, wanted) in [("x", 0), ("y", 1), ("z", 2)] {
            if !fields.iter().any(|field| field.slot == Some(wanted) && field.count > 0) {
                return Err(Fault::line(line, format!("FIELDS without {name}")));
            }
        }
        for (field, name) in fields.iter().zip(&self.names).filter(|(field, _)| field.slot.is_some()) {
            if number(field, &[0; 8]).is_none() {
                return Err(Fault::line(
                    line,
                    format!("field {name}: no numbers of type {} with {} bytes", field.kind, field.size),
                ));
            }
        }
        let stated = self.points.or_else(|| self.width.checked_mul(self.height));
        Ok((fields, stated.ok_or_else(|| Fault::line(line, "more points than can be counted"))?))
    }
}

fn read_text(
    data: &[u8],
    line: usize,
    fields: &[Field],
    points: usize,
    take: &mut dyn FnMut(CloudPoint),
) -> Result<(), Fault> {
    let text = std::str::from_utf8(data).map_err(|error| {
        Fault::byte(error.valid_up_to(), "no text behind DATA ascii (counted from the line after it)")
    })?;
    let mut found = 0;
    for (number, row) in (line + 1..).zip(text.lines()).filter(|(_, row)| !row.trim().is_empty()) {
        let mut words = row.split_whitespace();
        let mut numbers = [f64::NAN; 9];
        for field in fields {
            for part in 0..field.count {
                let word = words.next().ok_or_else(|| Fault::line(number, "fewer numbers than fields"))?;
                if let (Some(slot), 0) = (field.slot, part) {
                    let value = word.parse();
                    numbers[slot] =
                        value.map_err(|_| Fault::line(number, format!("{word:?} is no number")))?;
                }
            }
        }
        take(point(&numbers));
        found += 1;
    }
    if found != points {
        return Err(Fault::at("header", format!("{points} points, the file holds {found}")));
    }
    Ok(())
}

fn read_binary(
    data: &[u8],
    start: usize,
    fields: &[Field],
    points: usize,
    take: &mut dyn FnMut(CloudPoint),
) -> Result<(), Fault> {
    let bytes = record_bytes(fields, points, start)?;
    if data.len() < bytes {
        return Err(Fault::byte(
            start + data.len(),
            format!("the file ends, {} bytes of points are missing", bytes - data.len()),
        ));
    }
    let each = bytes / points.max(1);
    give(&data[..bytes], fields, points, |index, before, _| index * each + before, take);
    Ok(())
}

/// Two lengths, then field after field of all points, compressed.
fn read_compressed(
    data: &[u8],
    start: usize,
    fields: &[Field],
    points: usize,
    take: &mut dyn FnMut(CloudPoint),
) -> Result<(), Fault> {
    let length = |at: usize| {
        let bytes = data.get(at..at + 4).and_then(|bytes| <[u8; 4]>::try_from(bytes).ok());
        bytes.map(u32::from_le_bytes).map(|length| length as usize)
    };
    let cut = || Fault::byte(start + data.len(), "the file ends in the compressed points");
    let (packed, plain) = length(0).zip(length(4)).ok_or_else(cut)?;
    let packed = data.get(8..).and_then(|data| data.get(..packed)).ok_or_else(cut)?;
    let bytes = record_bytes(fields, points, start)?;
    if plain != bytes {
        let reason = format!("{plain} bytes of points, expected {bytes} by the header");
        return Err(Fault::byte(start + 4, reason));
    }
    let columns = decompress(packed, plain)
        .ok_or_else(|| Fault::byte(start + 8, "the compressed points are damaged"))?;
    give(&columns, fields, points, |index, before, each| before * points + index * each, take);
    Ok(())
}

/// Every point, with the place of a field given by the point's number, the bytes of the fields before it and its own.
fn give(
    bytes: &[u8],
    fields: &[Field],
    points: usize,
    place: impl Fn(usize, usize, usize) -> usize,
    take: &mut dyn FnMut(CloudPoint),
) {
    for index in 0..points {
        let mut numbers = [f64::NAN; 9];
        let mut before = 0;
        for field in fields {
            let each = field.size * field.count;
            if let (Some(slot), 1..) = (field.slot, field.count) {
                let at = place(index, before, each);
                numbers[slot] = number(field, &bytes[at..]).unwrap_or(f64::NAN);
            }
            before += each;
        }
        take(point(&numbers));
    }
}

fn record_bytes(fields: &[Field], points: usize, start: usize) -> Result<usize, Fault> {
    let each =
        fields.iter().try_fold(0_usize, |sum, field| sum.checked_add(field.size.checked_mul(field.count)?));
    let all = each.and_then(|each| each.checked_mul(points));
    all.ok_or_else(|| Fault::byte(start, "more bytes of points than can be counted"))
}

fn number(field: &Field, bytes: &[u8]) -> Option<f64> {
    fn first<const N: usize>(bytes: &[u8]) -> Option<[u8; N]> {
        bytes.get(..N)?.try_into().ok()
    }
    Some(match (field.kind, field.size) {
        ('F', 4) => f64::from(f32::from_le_bytes(first(bytes)?)),
        ('F', 8) => f64::from_le_bytes(first(bytes)?),
        ('U', 1) => f64::from(bytes.first()?.to_owned()),
        ('U', 2) => f64::from(u16::from_le_bytes(first(bytes)?)),
        ('U', 4) => f64::from(u32::from_le_bytes(first(bytes)?)),
        ('U', 8) => u64::from_le_bytes(first(bytes)?) as f64,
        ('I', 1) => f64::from(bytes.first()?.to_owned() as i8),
        ('I', 2) => f64::from(i16::from_le_bytes(first(bytes)?)),
        ('I', 4) => f64::from(i32::from_le_bytes(first(bytes)?)),
        ('I', 8) => i64::from_le_bytes(first(bytes)?) as f64,
        _ => return None,
    })
}
