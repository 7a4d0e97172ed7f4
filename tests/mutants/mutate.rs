//! Mutants of a file that know a little of its structure: numbers in text become extremes, fields go missing, lines and
//! chunks move, counts and offsets in binary data take the values at which arithmetic goes wrong.

use outrigger::base::rng::Rng;
use serde_json::Value;

/// What text has in place of a number or a word.
const WORDS: &[&str] = &[
    "0",
    "-1",
    "1",
    "2",
    "-0",
    "NaN",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-308",
    "1e400",
    "1e30",
    "1e9",
    "-1e9",
    "1e7",
    "1e5",
    "1e-9",
    "0.5",
    "127",
    "128",
    "255",
    "256",
    "65535",
    "65536",
    "100000",
    "1000000",
    "100000000",
    "2147483647",
    "2147483648",
    "-2147483649",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "18446744073709551616",
    "0x10",
    "00",
    "x",
    "",
    "null",
    "true",
    "\"\"",
    "[]",
    "{}",
    "é",
];

/// What a whole number in binary data becomes; `length` is that of the file.
fn extreme(rng: &mut Rng, before: u64, length: u64) -> u64 {
    let f32s = [f32::NAN, f32::INFINITY, 1e30, -1e30, 1e-40];
    match rng.below(10) {
        0 => before.wrapping_add(1),
        1 => before.wrapping_sub(1),
        2 => before.wrapping_mul(2),
        3 => [length, length.wrapping_sub(1), length + 1, 2 * length][rng.below(4) as usize],
        4 => u64::from(f32s[rng.below(5) as usize].to_bits()),
        5 => [f64::NAN, f64::INFINITY, 1e308, -1e9, 1e7][rng.below(5) as usize].to_bits(),
        6 => u64::MAX,
        7 => 1 << rng.below(64),
        8 => (1 << (1 + rng.below(63))) - 1,
        _ => rng.below(4),
    }
}

/// One mutant; the same seed and number give the same.
pub fn mutant(seed: &[u8], number: u64) -> Vec<u8> {
    let mut rng = Rng::new(number, 0x6d75_7461);
    let mut bytes = seed.to_vec();
    for _ in 0..1 + rng.below(3) {
        bytes = once(&bytes, &mut rng);
    }
    bytes
}

fn once(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    // a binary file may begin with a text of its own
    let text = bytes.iter().take_while(|byte| matches!(byte, b'\t' | b'\n' | b'\r' | 0x20..=0x7e)).count();
    let is_text = text == bytes.len();
    if bytes.is_empty() {
        return vec![rng.below(256) as u8];
    }
    match rng.below(10) {
        0..=3 if is_text && let Ok(mut value) = serde_json::from_slice(bytes) => {
            json(&mut value, rng);
            serde_json::to_vec_pretty(&value).unwrap()
        }
        0..=3 if text > 20 => words(bytes, text, rng),
        4 | 5 if text > 20 => lines(bytes, text, rng),
        6 => truncated(bytes, rng),
        7 => chunk(bytes, rng),
        _ if is_text => words(bytes, text, rng),
        _ => number(bytes, rng),
    }
}

/// A word or a number of a text becomes another one of the file, or an extreme.
fn words(bytes: &[u8], text: usize, rng: &mut Rng) -> Vec<u8> {
    let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b"_.+-".contains(&byte);
    let mut places = Vec::new();
    let mut at = 0;
    while at < text {
        let length = bytes[at..text].iter().take_while(|byte| is_part(**byte)).count();
        if length > 0 {
            places.push(at..at + length);
        }
        at += length.max(1);
    }
    if places.is_empty() {
        return truncated(bytes, rng);
    }
    let place = places[rng.below(places.len() as u64) as usize].clone();
    let digits = "7".repeat(400);
    let new: &[u8] = match rng.below(12) {
        0 => &bytes[places[rng.below(places.len() as u64) as usize].clone()],
        1 => digits.as_bytes(),
        _ => WORDS[rng.below(WORDS.len() as u64) as usize].as_bytes(),
    };
    [&bytes[..place.start], new, &bytes[place.end..]].concat()
}

/// A line goes missing, comes twice, comes a thousand times, or changes places with another.
fn lines(bytes: &[u8], text: usize, rng: &mut Rng) -> Vec<u8> {
    let mut lines: Vec<&[u8]> = bytes[..text].split_inclusive(|byte| *byte == b'\n').collect();
    let [at, other] = [0, 1].map(|_| rng.below(lines.len() as u64) as usize);
    match rng.below(4) {
        0 => drop(lines.remove(at)),
        1 => lines.insert(other, lines[at]),
        2 => lines.swap(at, other),
        _ => {
            let copies = vec![lines[at]; 1000];
            lines.splice(at..at, copies);
        }
    }
    [&lines.concat(), &bytes[text..]].concat()
}

fn truncated(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    bytes[..rng.below(bytes.len() as u64) as usize].to_vec()
}

/// A chunk goes missing, comes again elsewhere, or becomes zeros.
fn chunk(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let start = rng.below(bytes.len() as u64) as usize;
    let length = (1 << rng.below(12)).min(bytes.len() - start);
    let (head, rest) = bytes.split_at(start);
    let (chunk, tail) = rest.split_at(length);
    match rng.below(3) {
        0 => [head, tail].concat(),
        1 => [head, chunk, chunk, tail].concat(),
        _ => [head, &vec![0; length], tail].concat(),
    }
}

/// A number of 1, 2, 4 or 8 bytes becomes an extreme; headers lie in front, and are met as often as all the rest.
fn number(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let within = [bytes.len(), bytes.len().min(512)][rng.below(2) as usize];
    let width = (1_usize << rng.below(4)).min(bytes.len());
    let step = width.min(2);
    let at = (rng.below(within as u64) as usize / step * step).min(bytes.len() - width);
    let mut before = [0; 8];
    before[..width].copy_from_slice(&bytes[at..at + width]);
    let new = extreme(rng, u64::from_le_bytes(before), bytes.len() as u64);
    let mut new = new.to_le_bytes()[..width].to_vec();
    if rng.below(4) == 0 {
        new.reverse();
    }
    bytes[at..at + width].copy_from_slice(&new);
    bytes
}

/// Somewhere in a document a value becomes an extreme or of another type, a field gets another name or goes missing, or
/// an element comes a thousand times.
fn json(value: &mut Value, rng: &mut Rng) {
    let inside = match value {
        Value::Array(list) => list.len(),
        Value::Object(fields) => fields.len(),
        _ => 0,
    };
    if inside > 0 && rng.below(8) > 0 {
        let at = rng.below(inside as u64) as usize;
        match (value, rng.below(6)) {
            (Value::Array(list), 0) => drop(list.remove(at)),
            (Value::Array(list), 1) => {
                let copies = vec![list[at].clone(); [1, 1000][rng.below(2) as usize]];
                list.splice(at..at, copies);
            }
            (Value::Object(fields), change @ 0..2) => {
                let key = fields.keys().nth(at).unwrap().clone();
                let taken = fields.remove(&key).unwrap();
                if change == 1 {
                    fields.insert(format!("{key}_"), taken);
                }
            }
            (Value::Array(list), _) => json(&mut list[at], rng),
            (Value::Object(fields), _) => json(fields.values_mut().nth(at).unwrap(), rng),
            _ => unreachable!("only these hold others"),
        }
        return;
    }
    *value = match rng.below(16) {
        0 => Value::Null,
        1 => "x".repeat(1 << rng.below(17)).into(),
        2 => (0..300).fold(value.take(), |inner, _| vec![inner].into()),
        3 => Value::Array(Vec::new()),
        4 => true.into(),
        5 => u64::MAX.into(),
        6 => i64::MIN.into(),
        7 => vec![value.take(); 5].into(),
        _ => match value.as_f64() {
            Some(before) => [
                -before,
                before + 1.0,
                before - 1.0,
                0.0,
                before * 2.0,
                1e308,
                -1e308,
                1e-308,
                1e9,
                1e-9,
                4294967296.0,
                before * 1e4,
            ][rng.below(12) as usize]
                .into(),
            None => WORDS[rng.below(WORDS.len() as u64) as usize].into(),
        },
    };
    // most fields that count something refuse a fraction
    if let Some(number) = value.as_f64().filter(|number| number.fract() == 0.0 && number.abs() < 9e15)
        && value.is_f64()
        && rng.below(4) > 0
    {
        *value = (number as i64).into();
    }
}
