//! Message numbers on the wire, the same on both link layers: a 29-bit CAN identifier.
//!
//! `priority 3 | tag 5 (0b10110) | major 5 | message 8 | direction 1 | node 7`: extended identifiers share a bus with
//! drives that use 11 bits. Node 0 is everyone, 1..=126 are devices, 127 has no number yet. On CAN the payload is the
//! frame's data; on a serial line [`crate::link`] carries the identifier and the payload.

/// Marks the rig's identifiers among others on the bus.
const TAG: u32 = 0b10110;

/// Version of the identifier's layout and the messages under it.
pub const MAJOR: u8 = 1;

/// The node number that means every device.
pub const BROADCAST: u8 = 0;

/// Direction of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the host.
    ToDevice,
    /// From the device.
    ToHost,
}

/// What an identifier says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageId {
    /// 0..=7, lower wins the bus.
    pub priority: u8,
    /// 0..=31.
    pub major: u8,
    /// Message number.
    pub message: u8,
    /// From or to the host.
    pub direction: Direction,
    /// 0..=127.
    pub node: u8,
}

impl MessageId {
    /// The identifier of a message in this version, with its priority: 0 for e-stop and faults, 2 for commands, 4 for
    /// telemetry, 6 for what is sent once.
    pub fn new(message: u8, direction: Direction, node: u8) -> Self {
        let priority = match (direction, message) {
            (Direction::ToDevice, 0x16) | (Direction::ToHost, 0x32) => 0,
            (Direction::ToDevice, _) | (Direction::ToHost, 0x20 | 0x33) => 2,
            (Direction::ToHost, 0x02 | 0x06 | 0x07 | 0x21) => 6,
            (Direction::ToHost, _) => 4,
        };
        Self { priority, major: MAJOR, message, direction, node: node & 0x7F }
    }

    /// The 29 bits.
    pub fn encode(self) -> u32 {
        let direction = u32::from(self.direction == Direction::ToHost);
        u32::from(self.priority & 7) << 26
            | TAG << 21
            | u32::from(self.major & 31) << 16
            | u32::from(self.message) << 8
            | direction << 7
            | u32::from(self.node & 0x7F)
    }

    /// What 29 bits say, or `None` when they are not a rig's.
    pub fn decode(bits: u32) -> Option<Self> {
        if bits >> 29 != 0 || bits >> 21 & 31 != TAG {
            return None;
        }
        let direction = if bits >> 7 & 1 == 1 { Direction::ToHost } else { Direction::ToDevice };
        Some(Self {
            priority: (bits >> 26) as u8,
            major: (bits >> 16 & 31) as u8,
            message: (bits >> 8 & 0xFF) as u8,
            direction,
            node: (bits & 0x7F) as u8,
        })
    }

    /// Whether a receiver of this version may read the message: version negotiation is readable in every version.
    pub fn readable(self) -> bool {
        self.major == MAJOR || matches!((self.direction, self.message), (_, 0x01 | 0x02))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    #[allow(clippy::unusual_byte_groupings)] // the groups are the fields
    fn lays_bits_out_as_written() {
        let id = MessageId::new(0x12, Direction::ToDevice, 5);
        assert_eq!(id.encode(), 0b010_10110_00001_00010010_0_0000101);
        let fault = MessageId::new(0x32, Direction::ToHost, 1);
        assert_eq!(fault.encode(), 0b000_10110_00001_00110010_1_0000001);
    }

    proptest! {
        #[test]
        fn every_identifier_round_trips(bits in 0u32..1 << 29) {
            if let Some(id) = MessageId::decode(bits) {
                prop_assert_eq!(id.encode(), bits);
            } else {
                prop_assert_ne!(bits >> 21 & 31, TAG);
            }
        }
    }
}
