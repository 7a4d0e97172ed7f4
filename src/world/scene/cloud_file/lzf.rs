//! LZF, the compression of binary PCD files. Source: M. Lehmann, LibLZF 3.6, `lzf_d.c` (the format).

/// What was compressed, `length` bytes; none where the data are damaged.
pub(super) fn decompress(data: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(length.min(64 * data.len()));
    let mut rest = data.iter().copied();
    while let Some(control) = rest.next() {
        let control = usize::from(control);
        if control < 32 {
            let start = out.len();
            out.extend(rest.by_ref().take(control + 1));
            if out.len() != start + control + 1 {
                return None;
            }
            continue;
        }
        let mut run = control >> 5;
        if run == 7 {
            run += usize::from(rest.next()?);
        }
        let back = ((control & 31) << 8 | usize::from(rest.next()?)) + 1;
        let from = out.len().checked_sub(back)?;
        if out.len() + run + 2 > length {
            return None;
        }
        // a run may repeat what it has just written
        for at in from..from + run + 2 {
            out.push(out[at]);
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_runs() {
        assert_eq!(decompress(b"\x02abc", 3).unwrap(), b"abc");
        // "ab", then 6 bytes from 2 back; a long run from 1 back
        assert_eq!(decompress(b"\x01ab\x80\x01", 8).unwrap(), b"abababab");
        assert_eq!(decompress(b"\x00a\xe0\x05\x00", 15).unwrap(), [b'a'; 15]);
        for damaged in [&b"\x02ab"[..], b"\x01ab\x80", b"\x01ab\x80\x05", b"\x01ab"] {
            assert_eq!(decompress(damaged, 8), None);
        }
    }
}
