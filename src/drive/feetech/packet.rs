//! Feetech STS packets and registers (Feetech "Communication protocol manual", STS3215 memory table):
//! `FF FF | id | length | instruction or error | parameters | inverted sum`.

/// The id that every servo listens to.
pub const BROADCAST: u8 = 0xFE;
/// Read registers.
pub const READ: u8 = 0x02;
/// Write registers.
pub const WRITE: u8 = 0x03;
/// Read the same registers of many servos; they answer in turn.
pub const SYNC_READ: u8 = 0x82;
/// Write the same registers of many servos; nobody answers.
pub const SYNC_WRITE: u8 = 0x83;

/// Address and length of a register.
pub type Register = (u8, u8);

/// Model, two bytes.
pub const MODEL: Register = (3, 2);
/// Whether a write is answered.
pub const ANSWERS_WRITES: Register = (8, 1);
/// Lowest and highest position, counts.
pub const POSITION_LIMITS: Register = (9, 4);
/// 0 is position control.
pub const MODE: Register = (33, 1);
/// 1 drives the shaft. Writing a goal does so too.
pub const TORQUE_ENABLE: Register = (40, 1);
/// Acceleration, goal, time, speed: all that a move needs in one write.
pub const GOAL_POSITION: Register = (42, 2);
/// Position to current: all that is measured in one read.
pub const MEASURED: Register = (56, 15);
/// Within [`MEASURED`]: supply, 0.1 V.
pub const VOLTAGE_AT: usize = 6;
/// Within [`MEASURED`]: temperature, °C.
pub const TEMPERATURE_AT: usize = 7;
/// Within [`MEASURED`]: error bits, as in every answer.
pub const STATUS_AT: usize = 9;
/// Within [`MEASURED`]: current, 6.5 mA.
pub const CURRENT_AT: usize = 13;

/// Supply outside its limits.
pub const VOLTAGE: u8 = 1 << 0;
/// No valid position.
pub const ENCODER: u8 = 1 << 1;
/// Too hot.
pub const OVERHEAT: u8 = 1 << 2;
/// Too much current.
pub const OVERCURRENT: u8 = 1 << 3;
/// Overload: the servo takes its torque back.
pub const OVERLOAD: u8 = 1 << 5;
/// Every error bit of an answer with its name (scservo SDK, `ERRBIT_*`).
pub const ERRORS: [(u8, &str); 5] = [
    (VOLTAGE, "input voltage"),
    (ENCODER, "angle sensor"),
    (OVERHEAT, "overheating"),
    (OVERCURRENT, "over-current"),
    (OVERLOAD, "overload"),
];

/// One packet, either way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Whom it is for, or whose answer it is.
    pub id: u8,
    /// What it asks, or the error bits of an answer.
    pub code: u8,
    /// Parameters.
    pub parameters: Vec<u8>,
}

fn checksum(body: &[u8]) -> u8 {
    !body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte))
}

impl Packet {
    /// The bytes on the line.
    pub fn encode(&self) -> Vec<u8> {
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
    /// Packets whose checksum or length is wrong.
    pub damaged: u32,
}

impl PacketReceiver {
    /// Forgets half a packet: a new question was asked.
    pub fn clear(&mut self) {
        self.buffer.clear();
    }

    /// Takes bytes; the packets that they complete.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Packet> {
        self.buffer.extend_from_slice(bytes);
        let mut packets = Vec::new();
        loop {
            let garbage = self.buffer.windows(2).position(|pair| pair == [0xFF, 0xFF]);
            let keep = usize::from(self.buffer.last() == Some(&0xFF));
            self.buffer.drain(..garbage.unwrap_or(self.buffer.len() - keep));
            // a third FF begins the header anew: no servo has that id
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

/// Position at the middle of the horn's turn, counts.
const CENTRE: i32 = 2048;
/// Counts of a turn.
const COUNTS: i64 = 4096;
/// A turn, µrad.
const TURN_URAD: i64 = 6_283_185;
/// One count, µrad, rounded up.
pub const COUNT_URAD: i32 = (TURN_URAD / COUNTS) as i32 + 1;

/// Sign and magnitude: the highest of 16 bits is the sign.
pub fn signed(word: u16) -> i32 {
    let magnitude = i32::from(word & 0x7FFF);
    if word & 0x8000 == 0 { magnitude } else { -magnitude }
}

/// Counts to an angle from the centre, µrad.
pub fn urad(counts: i32) -> i32 {
    (i64::from(counts - CENTRE) * TURN_URAD / COUNTS) as i32
}

/// An angle from the centre to the nearest count of the turn.
pub fn counts(urad: i32) -> u16 {
    let scaled = i64::from(urad) * COUNTS;
    let half = if scaled < 0 { -TURN_URAD / 2 } else { TURN_URAD / 2 };
    (i64::from(CENTRE) + (scaled + half) / TURN_URAD).clamp(0, COUNTS - 1) as u16
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Ping of servo 1 and its answer, as the manual prints them.
    #[test]
    fn agrees_with_the_manual() {
        let ping = Packet { id: 1, code: 1, parameters: vec![] };
        assert_eq!(ping.encode(), [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]);
        let answer = Packet { id: 1, code: 0, parameters: vec![] };
        assert_eq!(PacketReceiver::default().push(&[0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]), [answer]);
        let read = Packet { id: 1, code: READ, parameters: vec![0x38, 0x02] };
        assert_eq!(read.encode(), [0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE]);
    }

    #[test]
    fn counts_and_angles_agree() {
        assert_eq!((urad(2048), urad(3072), signed(0x8005)), (0, 1_570_796, -5));
        for count in 0..4096 {
            assert_eq!(i32::from(counts(urad(count))), count);
        }
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
            let heard: Vec<_> = bytes.chunks(piece).flat_map(|chunk| receiver.push(chunk)).collect();
            prop_assert_eq!(heard, [packet]);
        }

        #[test]
        fn takes_any_bytes_and_keeps_few(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut receiver = PacketReceiver::default();
            bytes.chunks(7).for_each(|chunk| drop(receiver.push(chunk)));
            prop_assert!(receiver.buffer.len() <= 4 + 255);
        }
    }
}
