//! The position packet, 512 bytes: GPS sentence, state of the pulse per second, time.

use super::wire::POSITION_PACKET_BYTES;

/// One position packet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Position {
    /// Host arrival time, ns since 1970.
    pub host_time_ns: u64,
    /// Microseconds since the top of the hour, as sent.
    pub stamp_us: u32,
}

impl Position {
    /// Reads a position packet.
    pub fn parse(payload: &[u8; POSITION_PACKET_BYTES], host_time_ns: u64) -> Self {
        let stamp_us = u32::from_le_bytes([payload[198], payload[199], payload[200], payload[201]]);
        Self { host_time_ns, stamp_us }
    }
}
