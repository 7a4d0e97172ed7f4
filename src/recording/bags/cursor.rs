//! The fields of a message in order, as ROS 1 packs them and as ROS 2 aligns them (CDR).

/// How the messages of a topic are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// ROS 1: packed, little-endian.
    Ros1,
    /// ROS 2: CDR, each number aligned to its size, counted from behind the first four bytes.
    Cdr,
    /// Another encoding: its messages are not read.
    Other,
}

/// Reads one message; nothing where it ends too early or its encoding is unknown.
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
    is_big_endian: bool,
    /// 4 in XCDR2, otherwise 8.
    most_alignment: usize,
}

/// A message's stamp and frame.
pub(crate) struct Header<'a> {
    pub stamp_ns: u64,
    /// Without the leading slash of ROS 1.
    pub frame_id: &'a str,
}

impl<'a> Cursor<'a> {
    pub fn new(encoding: Encoding, data: &'a [u8]) -> Option<Self> {
        let packed = Self { encoding, ..Self::packed(data) };
        match encoding {
            Encoding::Ros1 => return Some(packed),
            Encoding::Cdr => {}
            Encoding::Other => return None,
        }
        let (start, bytes) = data.split_at_checked(4)?;
        let (is_big_endian, most_alignment) = match start[..2] {
            [0, 0] => (true, 8),
            [0, 1] => (false, 8),
            [0, 6] => (true, 4),
            [0, 7] => (false, 4),
            _ => return None, // parameter lists and delimited types: no type here is written so
        };
        Some(Self { bytes, is_big_endian, most_alignment, ..packed })
    }

    /// Fields without any alignment, little-endian.
    pub fn packed(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, encoding: Encoding::Ros1, is_big_endian: false, most_alignment: 8 }
    }

    /// What comes behind the fields read so far.
    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The next bytes as they are.
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let bytes = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(N.min(self.most_alignment));
        }
        let mut bytes = *self.take(N)?.first_chunk::<N>()?;
        if self.is_big_endian {
            bytes.reverse();
        }
        Some(bytes)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Option<f32> {
        self.number().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    /// Number of elements of a sequence, each of which has at least so many bytes: no more than there can be.
    pub fn count(&mut self, least_bytes: usize) -> Option<usize> {
        let count = self.u32()? as usize;
        (count.checked_mul(least_bytes)? <= self.bytes.len() - self.at).then_some(count)
    }

    /// `uint8[]`.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let count = self.count(1)?;
        self.take(count)
    }

    pub fn string(&mut self) -> Option<&'a str> {
        let bytes = self.bytes()?;
        let text = match self.encoding {
            Encoding::Ros1 | Encoding::Other => bytes,
            Encoding::Cdr => bytes.strip_suffix(&[0]).unwrap_or(bytes), // its closing zero is counted
        };
        std::str::from_utf8(text).ok()
    }

    /// A time, ns.
    pub fn time_ns(&mut self) -> Option<u64> {
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        Some(u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds))
    }

    pub fn header(&mut self) -> Option<Header<'a>> {
        if self.encoding == Encoding::Ros1 {
            self.u32()?; // seq
        }
        let stamp_ns = self.time_ns()?;
        let frame_id = self.string()?;
        Some(Header { stamp_ns, frame_id: frame_id.strip_prefix('/').unwrap_or(frame_id) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cdr_aligns_from_behind_its_first_four_bytes() {
        let data = [0, 1, 0, 0, 7, 0, 0, 0, 2, 0, 0, 0, b'a', 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f];
        let mut cursor = Cursor::new(Encoding::Cdr, &data).unwrap();
        assert_eq!((cursor.u8(), cursor.string(), cursor.f64()), (Some(7), Some("a"), None));
        let mut longer = data[..16].to_vec();
        longer.extend([0, 0, 0, 0]);
        longer.extend(1_f64.to_le_bytes());
        let mut cursor = Cursor::new(Encoding::Cdr, &longer).unwrap();
        assert_eq!((cursor.u8(), cursor.string(), cursor.f64()), (Some(7), Some("a"), Some(1.0)));
        let big = [0, 0, 0, 0, 0, 0, 0, 5];
        assert_eq!(Cursor::new(Encoding::Cdr, &big).unwrap().u32(), Some(5));
        assert!(Cursor::new(Encoding::Cdr, &[0, 3, 0, 0]).is_none());
    }

    #[test]
    fn ros1_is_packed_and_a_count_is_no_larger_than_its_message() {
        let data = [7, 1, 0, 0, 0, b'/', 0xff, 0xff, 0xff, 0xff];
        let mut cursor = Cursor::new(Encoding::Ros1, &data).unwrap();
        assert_eq!((cursor.u8(), cursor.string(), cursor.count(1)), (Some(7), Some("/"), None));
    }
}
