//! Dynamixel Protocol 2.0 packets (ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0"):
//! `FF FF FD 00 | id | length u16 | instruction | parameters, FD stuffed after FF FF FD | CRC-16`.

/// The instruction of an answer.
pub const STATUS: u8 = 0x55;
const HEADER: [u8; 4] = [0xFF, 0xFF, 0xFD, 0x00];
/// No packet of the servos used here is longer.
const LONGEST: usize = 256;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Its addressee, or the servo that answers.
    pub id: u8,
    /// What it asks; [`STATUS`] for answers.
    pub instruction: u8,
    /// Parameters; an answer begins with its error byte.
    pub parameters: Vec<u8>,
}

/// CRC-16 with polynomial 0x8005, highest bit first, starting at zero.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0u16, |crc, byte| {
        (0..8).fold(
            crc ^ u16::from(*byte) << 8,
            |crc, _| {
                if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x8005 }
            },
        )
    })
}

impl Packet {
    /// A packet.
    pub(crate) fn new(id: u8, instruction: u8, parameters: &[u8]) -> Self {
        Self { id, instruction, parameters: parameters.to_vec() }
    }

    /// The bytes on the line.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut body = vec![self.instruction];
        for byte in &self.parameters {
            body.push(*byte);
            if body.ends_with(&[0xFF, 0xFF, 0xFD]) {
                body.push(0xFD);
            }
        }
        let mut bytes = HEADER.to_vec();
        bytes.push(self.id);
        bytes.extend((body.len() as u16 + 2).to_le_bytes());
        bytes.extend(body);
        bytes.extend(crc16(&bytes).to_le_bytes());
        bytes
    }

    /// Error byte and data of an answer; `None` when it is none.
    pub(crate) fn answer(&self) -> Option<(u8, &[u8])> {
        let (error, data) = self.parameters.split_first()?;
        (self.instruction == STATUS).then_some((*error, data))
    }
}

/// Bytes to packets. Damaged ones are dropped and counted.
#[derive(Clone, Debug, Default)]
pub struct PacketReceiver {
    buffer: Vec<u8>,
    /// Packets with a wrong checksum or length.
    pub damaged: u32,
}

impl PacketReceiver {
    /// Forgets half a packet: a new question was asked.
    pub(crate) fn clear(&mut self) {
        self.buffer.clear();
    }

    /// Takes bytes; the packets that they complete.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> Vec<Packet> {
        self.buffer.extend_from_slice(bytes);
        let mut packets = Vec::new();
        while let Some((packet, used)) = self.next() {
            self.buffer.drain(..used);
            packets.extend(packet);
        }
        packets
    }

    /// What the buffer begins with, and how many bytes that takes; `None` when more bytes are needed.
    fn next(&mut self) -> Option<(Option<Packet>, usize)> {
        let garbage = (0..self.buffer.len())
            .find(|at| HEADER.starts_with(&self.buffer[*at..(*at + 4).min(self.buffer.len())]))
            .unwrap_or(self.buffer.len());
        if garbage > 0 {
            return Some((None, garbage));
        }
        let [_, _, _, _, id, low, high, ..] = self.buffer[..] else { return None };
        let length = usize::from(u16::from_le_bytes([low, high]));
        if !(3..=LONGEST).contains(&length) {
            self.damaged += 1;
            return Some((None, 1));
        }
        let whole = self.buffer.get(..7 + length)?;
        let (checked, crc) = whole.split_at(whole.len() - 2);
        if crc16(checked).to_le_bytes() != crc {
            self.damaged += 1;
            return Some((None, 1));
        }
        let mut parameters: Vec<u8> = Vec::new();
        let mut skip = false;
        for (at, byte) in checked.iter().enumerate().skip(8) {
            if std::mem::take(&mut skip) {
                continue;
            }
            parameters.push(*byte);
            skip = *byte == 0xFD && checked[7..=at].ends_with(&[0xFF, 0xFF, 0xFD]);
        }
        Some((Some(Packet { id, instruction: checked[7], parameters }), 7 + length))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::drive::bus_servos::instruction;

    fn hex(text: &str) -> Vec<u8> {
        let text = text.replace(' ', "");
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
    }

    /// Bytes exchanged with the vendor's own servo library.
    #[test]
    fn speaks_as_the_vendors_servo() {
        let status = |parameters: &[u8]| Packet::new(1, STATUS, parameters);
        let read = |address: u16, length: u16| {
            Packet::new(1, instruction::READ, &[address.to_le_bytes(), length.to_le_bytes()].concat())
        };
        let write = |address: u16, values: &[u8]| {
            Packet::new(1, instruction::WRITE, &[&address.to_le_bytes(), values].concat())
        };
        let vectors = [
            (Packet::new(1, instruction::PING, &[]), "FFFFFD00 01 0300 01 194E"),
            (status(&[0, 0xFC, 0x03, 0x01]), "FFFFFD00 01 0700 55 00 FC0301 FCC3"),
            (read(132, 4), "FFFFFD00 01 0700 02 8400 0400 1D15"),
            (status(&[0, 0, 8, 0, 0]), "FFFFFD00 01 0800 55 00 00080000 1C38"),
            (write(116, &1000u32.to_le_bytes()), "FFFFFD00 01 0900 03 7400 E8030000 F0A9"),
            (status(&[7]), "FFFFFD00 01 0400 55 07 B08C"),
            (write(64, &[1]), "FFFFFD00 01 0600 03 4000 01 DB66"),
            (status(&[0]), "FFFFFD00 01 0400 55 00 A10C"),
            (write(116, &2332u32.to_le_bytes()), "FFFFFD00 01 0900 03 7400 1C090000 53B9"),
            (status(&[0, 0x1C, 9, 0, 0]), "FFFFFD00 01 0800 55 00 1C090000 0D08"),
        ];
        for (packet, bytes) in vectors {
            assert_eq!(packet.encode(), hex(bytes), "{packet:?}");
            assert_eq!(PacketReceiver::default().push(&hex(bytes)), [packet]);
        }
    }

    proptest! {
        #[test]
        fn round_trips_in_pieces_after_garbage(
            id: u8,
            instruction: u8,
            parameters in proptest::collection::vec(prop_oneof![Just(0xFFu8), Just(0xFD), any::<u8>()], 0..100),
            garbage in proptest::collection::vec(prop_oneof![3 => Just(0xFFu8), 1 => 0u8..0xFD], 0..30),
            piece in 1usize..50,
        ) {
            let packet = Packet { id, instruction, parameters };
            let bytes = [garbage, packet.encode()].concat();
            let mut receiver = PacketReceiver::default();
            let decoded: Vec<_> = bytes.chunks(piece).flat_map(|chunk| receiver.push(chunk)).collect();
            prop_assert_eq!(decoded, [packet]);
        }

        #[test]
        fn takes_any_bytes_and_keeps_few(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut receiver = PacketReceiver::default();
            bytes.chunks(7).for_each(|chunk| drop(receiver.push(chunk)));
            prop_assert!(receiver.buffer.len() <= 7 + LONGEST);
        }
    }
}
