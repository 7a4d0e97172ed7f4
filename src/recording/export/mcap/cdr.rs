//! ROS 2 messages in CDR, little-endian. Source: OMG DDSI-RTPS 2.3, section 10 (plain CDR, XCDR1).

/// A message under construction. Values are aligned to their size, counted from after the 4-byte encapsulation.
pub(super) struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    pub(super) fn new() -> Self {
        Self { bytes: vec![0, 1, 0, 0] }
    }

    pub(super) fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn f64(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn string(&mut self, value: &str) {
        self.u32(value.len() as u32 + 1); // names of fields and frames
        self.bytes.extend_from_slice(value.as_bytes());
        self.bytes.push(0);
    }

    /// A sequence of bytes, filled in by the caller.
    pub(super) fn byte_sequence(&mut self, length: u32, fill: impl FnOnce(&mut Vec<u8>)) {
        self.u32(length);
        let end = self.bytes.len() + length as usize;
        fill(&mut self.bytes);
        self.bytes.resize(end, 0);
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, to: usize) {
        let body = self.bytes.len() - 4;
        self.bytes.resize(4 + body.next_multiple_of(to), 0);
    }
}
