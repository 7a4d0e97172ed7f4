//! Consistent Overhead Byte Stuffing (doi:10.1109/90.769765): a frame without zero bytes, so zero can end it.

/// Stuffs `data` into `out` and returns how many bytes that took, or `None` when `out` is too short.
pub fn encode(data: &[u8], out: &mut [u8]) -> Option<usize> {
    let (mut code_at, mut at, mut code) = (0, 1, 1u8);
    *out.first_mut()? = 0;
    for (index, byte) in data.iter().enumerate() {
        if *byte != 0 {
            *out.get_mut(at)? = *byte;
            at += 1;
            code += 1;
        }
        let full = code == 0xFF && index + 1 < data.len();
        if *byte == 0 || full {
            out[code_at] = code;
            code_at = at;
            *out.get_mut(at)? = 0;
            at += 1;
            code = 1;
        }
    }
    out[code_at] = code;
    Some(at)
}

/// Unstuffs a frame (without its closing zero) in place and returns how many bytes it holds, or `None` when a code
/// byte points past the end or a zero stands inside.
pub fn decode(frame: &mut [u8]) -> Option<usize> {
    let (mut read, mut write) = (0, 0);
    while read < frame.len() {
        let code = frame[read];
        let end = read + usize::from(code);
        if code == 0 || end > frame.len() {
            return None;
        }
        for from in read + 1..end {
            if frame[from] == 0 {
                return None;
            }
            frame[write] = frame[from];
            write += 1;
        }
        read = end;
        if code < 0xFF && read < frame.len() {
            frame[write] = 0;
            write += 1;
        }
    }
    Some(write)
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use proptest::prelude::*;

    #[test]
    fn agrees_with_the_published_examples() {
        let long: Vec<u8> = (1..=254).collect();
        let mut long_stuffed = vec![0xFF];
        long_stuffed.extend(&long);
        let (longer, mut longer_stuffed) = ([&long[..], &[7, 8]].concat(), long_stuffed.clone());
        longer_stuffed.extend([3, 7, 8]);
        let examples: &[(&[u8], &[u8])] = &[
            (&[], &[1]),
            (&[0], &[1, 1]),
            (&[0, 0], &[1, 1, 1]),
            (&[0x11, 0x22, 0, 0x33], &[3, 0x11, 0x22, 2, 0x33]),
            (&[0x11, 0, 0, 0], &[2, 0x11, 1, 1, 1]),
            (&long, &long_stuffed),
            (&longer, &longer_stuffed),
        ];
        for (data, stuffed) in examples {
            let mut out = [0; 300];
            let length = super::encode(data, &mut out).unwrap();
            assert_eq!(&out[..length], *stuffed);
            let length = super::decode(&mut out[..length]).unwrap();
            assert_eq!(&out[..length], *data);
        }
    }

    proptest! {
        #[test]
        fn round_trips(data in proptest::collection::vec(prop_oneof![Just(0u8), any::<u8>()], 0..600)) {
            let mut out = [0; 700];
            let length = super::encode(&data, &mut out).unwrap();
            prop_assert!(!out[..length].contains(&0));
            let back = super::decode(&mut out[..length]).unwrap();
            prop_assert_eq!(&out[..back], &data[..]);
        }

        #[test]
        fn takes_any_bytes(mut bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            if let Some(length) = super::decode(&mut bytes) {
                prop_assert!(length < bytes.len().max(1));
            }
        }
    }
}
