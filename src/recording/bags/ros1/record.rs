//! Records of a ROS 1 bag: a header of named fields, and data.

pub(super) mod op {
    pub const MESSAGE: u8 = 2;
    pub const BAG_HEADER: u8 = 3;
    pub const INDEX: u8 = 4;
    pub const CHUNK: u8 = 5;
    pub const CHUNK_INFO: u8 = 6;
    pub const CONNECTION: u8 = 7;
}

/// Fields of a record's header.
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn get(&self, wanted: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((length, behind)) = rest.split_first_chunk::<4>() {
            let (field, next) = behind.split_at_checked(u32::from_le_bytes(*length) as usize)?;
            let equals = field.iter().position(|byte| *byte == b'=')?;
            if &field[..equals] == wanted.as_bytes() {
                return Some(&field[equals + 1..]);
            }
            rest = next;
        }
        None
    }

    pub fn op(&self) -> Option<u8> {
        self.get("op")?.first().copied()
    }

    pub fn u32(&self, name: &str) -> Option<u32> {
        Some(u32::from_le_bytes(*self.get(name)?.first_chunk()?))
    }

    pub fn u64(&self, name: &str) -> Option<u64> {
        Some(u64::from_le_bytes(*self.get(name)?.first_chunk()?))
    }

    pub fn text(&self, name: &str) -> Option<&'a str> {
        std::str::from_utf8(self.get(name)?).ok()
    }

    pub fn time_ns(&self, name: &str) -> Option<u64> {
        let (seconds, rest) = self.get(name)?.split_first_chunk::<4>()?;
        let nanoseconds = u32::from_le_bytes(*rest.first_chunk()?);
        Some(u64::from(u32::from_le_bytes(*seconds)) * 1_000_000_000 + u64::from(nanoseconds))
    }
}

/// Header and data of a record that lies in memory, and where the next begins.
pub(super) fn record(bytes: &[u8], at: usize) -> Option<(Fields<'_>, std::ops::Range<usize>)> {
    let (header, data) = part(bytes, at)?;
    let (content, _) = part(bytes, data)?;
    Some((Fields(&bytes[header]), content))
}

/// The counted bytes at a place, and where they end.
fn part(bytes: &[u8], at: usize) -> Option<(std::ops::Range<usize>, usize)> {
    let length = u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?) as usize;
    let end = (at + 4).checked_add(length).filter(|end| *end <= bytes.len())?;
    Some((at + 4..end, end))
}
