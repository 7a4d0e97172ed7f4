//! Lines of text files as people have them: UTF-8 with or without its mark, Latin-1, line ends of every system.

use std::borrow::Cow;

/// The lines of a text, with their numbers from 1.
#[derive(Clone, Debug)]
pub(crate) struct Lines<'a> {
    rest: Option<&'a [u8]>,
    number: usize,
}

/// Lines of a text file. A byte order mark is passed over; bytes that are not UTF-8 are read as Latin-1, in which every byte
/// is a character: names may hold them, numbers never do.
///
/// # Errors
/// Text of 16 bits per character, by its mark.
pub(crate) fn lines(bytes: &[u8]) -> Result<Lines<'_>, String> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err("text in UTF-16, expected UTF-8: save the file again as UTF-8".into());
    }
    Ok(Lines { rest: Some(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)), number: 0 })
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, Cow<'a, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.rest?;
        self.number += 1;
        let end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let line = &rest[..end.unwrap_or(rest.len())];
        self.rest = end.map(|end| match rest[end..] {
            [b'\r', b'\n', ..] => &rest[end + 2..],
            _ => &rest[end + 1..],
        });
        Some((self.number, decoded(line)))
    }
}

fn decoded(line: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(line) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(line.iter().map(|byte| char::from(*byte)).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_end_counts_once_and_marks_are_no_text() {
        let all = |bytes: &'static [u8]| {
            lines(bytes).unwrap().map(|(number, line)| format!("{number}{line}")).collect::<Vec<_>>()
        };
        assert_eq!(all(b"\xef\xbb\xbfa\r\nb\rc\n\nd"), ["1a", "2b", "3c", "4", "5d"]);
        assert_eq!(all(b"W\xe4nde\n"), ["1W\u{e4}nde", "2"]);
        assert!(lines(b"\xff\xfev\0").unwrap_err().contains("UTF-16"));
    }
}
