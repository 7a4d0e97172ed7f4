//! Feetech packets (Feetech "Communication protocol manual"):
//! `FF FF | id | length | instruction or error | parameters | inverted sum`.

/// One packet, in either direction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Its addressee, or the servo that answers.
    pub id: u8,
    /// What it asks, or the error bits of an answer.
    pub code: u8,
    pub parameters: Vec<u8>,
}

fn checksum(body: &[u8]) -> u8 {
    !body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte))
}

impl Packet {
    /// The bytes on the line.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![0xFF, 0xFF, self.id, self.parameters.len() as u8 + 2, self.code];
        bytes.extend(&self.parameters);
        bytes.push(checksum(&bytes[2..]));
        bytes
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
        loop {
            let garbage = self.buffer.windows(2).position(|pair| pair == [0xFF, 0xFF]);
            let keep = usize::from(self.buffer.last() == Some(&0xFF));
            self.buffer.drain(..garbage.unwrap_or(self.buffer.len() - keep));
            // a third FF begins the header again: no servo has that id
            if self.buffer.get(2) == Some(&0xFF) {
                self.buffer.remove(0);
                continue;
            }
            let [_, _, id, length, code, ..] = self.buffer[..] else { return packets };
            let end = 4 + usize::from(length);
            if length < 2 {
                self.damaged += 1;
                self.buffer.drain(..2);
                continue;
            }
            let Some(whole) = self.buffer.get(..end) else { return packets };
            if checksum(&whole[2..end - 1]) != whole[end - 1] {
                self.damaged += 1;
                self.buffer.drain(..2);
                continue;
            }
            packets.push(Packet { id, code, parameters: whole[5..end - 1].to_vec() });
            self.buffer.drain(..end);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::drive::bus_servos::instruction;

    /// Ping of servo 1 and its answer, as the manual prints them.
    #[test]
    fn agrees_with_the_manual() {
        let ping = Packet { id: 1, code: 1, parameters: vec![] };
        assert_eq!(ping.encode(), [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]);
        let answer = Packet { id: 1, code: 0, parameters: vec![] };
        assert_eq!(PacketReceiver::default().push(&[0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]), [answer]);
        let read = Packet { id: 1, code: instruction::READ, parameters: vec![0x38, 0x02] };
        assert_eq!(read.encode(), [0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE]);
    }

    proptest! {
        #[test]
        fn round_trips_in_pieces_after_garbage(
            id in 0u8..=0xFE,
            code: u8,
            parameters in proptest::collection::vec(any::<u8>(), 0..60),
            garbage in proptest::collection::vec(0u8..0xFF, 0..20),
            piece in 1usize..20,
        ) {
            let packet = Packet { id, code, parameters };
            let mut receiver = PacketReceiver::default();
            let bytes = [garbage, packet.encode()].concat();
            let decoded: Vec<_> = bytes.chunks(piece).flat_map(|chunk| receiver.push(chunk)).collect();
            prop_assert_eq!(decoded, [packet]);
        }

        #[test]
        fn takes_any_bytes_and_keeps_few(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut receiver = PacketReceiver::default();
            bytes.chunks(7).for_each(|chunk| drop(receiver.push(chunk)));
            prop_assert!(receiver.buffer.len() <= 4 + 255);
        }
    }
}
