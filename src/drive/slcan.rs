//! CAN over a serial adapter in the LAWICEL text protocol (CAN232 manual version 3): `T` + 8 hex digits of identifier +
//! length + data, closed by a carriage return; `\r`, `z\r`, `Z\r` say yes, BEL says no.

use firmware_protocol::{Frame, LinkCounters};

/// What opens the adapter: end of any half line, close, 1 Mbit/s, open.
pub const OPEN: &[u8] = b"\r\r\rC\rS8\rO\r";

/// What closes it again.
pub const CLOSE: &[u8] = b"C\r";

/// Longest line the protocol has: identifier, length, 8 bytes, time stamp.
const LONGEST_LINE: usize = 1 + 8 + 1 + 16 + 4;

/// One message on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// 11 or 29 bits.
    pub identifier: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// At most 8 bytes.
    pub data: Vec<u8>,
}

/// The line that sends a frame.
pub fn encode(frame: &Frame) -> Vec<u8> {
    line(format!("T{:08X}", frame.id.encode()), frame.data())
}

/// The line that sends a message with an 11-bit identifier.
pub fn encode_standard(identifier: u16, data: &[u8]) -> Vec<u8> {
    line(format!("t{identifier:03X}"), data)
}

fn line(mut line: String, data: &[u8]) -> Vec<u8> {
    line += &data.len().to_string();
    for byte in data {
        line += &format!("{byte:02X}");
    }
    line.push('\r');
    line.into_bytes()
}

/// Bytes of an adapter to messages.
#[derive(Clone, Debug, Default)]
pub struct SlcanReceiver {
    line: Vec<u8>,
    overlong: bool,
    counters: LinkCounters,
}

impl SlcanReceiver {
    /// What was seen so far. The bus has its own checksum; what fails here is text that is none.
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// The same for a rig's frames; messages of others are passed over.
    pub fn push_frame(&mut self, byte: u8) -> Option<Frame> {
        let message = self.push(byte).filter(|message| message.extended)?;
        let frame = Frame::from_can(message.identifier, &message.data)?;
        self.counters.frames += 1;
        Some(frame)
    }

    /// Takes one byte; a message when it closed the line of one.
    pub fn push(&mut self, byte: u8) -> Option<Message> {
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                if std::mem::take(&mut self.overlong) {
                    self.counters.overlong += 1;
                    return None;
                }
                self.line_to_message(&line)
            }
            0x07 => {
                // the adapter said no: a full buffer, a closed channel, nobody else on the bus; the order is repeated
                self.line.clear();
                None
            }
            _ if self.line.len() < LONGEST_LINE => {
                self.line.push(byte);
                None
            }
            _ => {
                self.overlong = true;
                None
            }
        }
    }

    fn line_to_message(&mut self, line: &[u8]) -> Option<Message> {
        // answers, and requests without data, are others' business
        if !matches!(line.first(), Some(b'T' | b't')) {
            let known = matches!(line.first(), None | Some(b'z' | b'Z' | b'r' | b'R' | b'F' | b'V' | b'N'));
            self.counters.malformed += u32::from(!known);
            return None;
        }
        let message = parse(line);
        self.counters.malformed += u32::from(message.is_none());
        message
    }
}

fn parse(line: &[u8]) -> Option<Message> {
    let text = std::str::from_utf8(line).ok()?;
    if !text.bytes().skip(1).all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let extended = text.starts_with('T');
    let at = if extended { 9 } else { 4 };
    let identifier = u32::from_str_radix(text.get(1..at)?, 16).ok()?;
    let length = text.get(at..at + 1)?.parse::<usize>().ok().filter(|length| *length <= 8)?;
    let rest = text.get(at + 1..)?;
    // with time stamps switched on, four digits follow
    if rest.len() != 2 * length && rest.len() != 2 * length + 4 {
        return None;
    }
    let data = (0..length)
        .map(|at| u8::from_str_radix(&rest[2 * at..2 * at + 2], 16).ok())
        .collect::<Option<_>>()?;
    Some(Message { identifier, extended, data })
}

#[cfg(test)]
mod tests {
    use firmware_protocol::{Command, Order};
    use proptest::prelude::*;

    use super::*;

    fn hear(receiver: &mut SlcanReceiver, bytes: &[u8]) -> Vec<Frame> {
        bytes.iter().filter_map(|byte| receiver.push_frame(*byte)).collect()
    }

    #[test]
    fn a_line_has_the_manuals_shape_and_comes_back() {
        let command = Command::Order { id: 4, order: Order::MovePair { a_urad: 436_332, b_urad: -436_332 } };
        let frame = Frame::command(0, 5, &command);
        let line = encode(&frame);
        assert_eq!(line, b"T0AC11205804006CA80694".iter().chain(b"57F9\r").copied().collect::<Vec<u8>>());
        let mut receiver = SlcanReceiver::default();
        assert_eq!(hear(&mut receiver, &line), [frame]);
        let stamped = [&line[..line.len() - 1], b"0A1F\r"].concat();
        assert_eq!(hear(&mut receiver, &stamped), [frame]);
        assert_eq!(hear(&mut receiver, b"\rZ\rz\rt1232AABB\r\x07"), []);
        assert_eq!(receiver.counters().malformed, 0);
        assert_eq!(hear(&mut receiver, b"T0AC112059\rT0AC1120G0\rT12\r?\r"), []);
        assert_eq!(receiver.counters().malformed, 4);
        assert_eq!(hear(&mut receiver, &[b"T".repeat(100), b"\r".to_vec(), line].concat()), [frame]);
    }

    #[test]
    fn short_identifiers_come_back_too() {
        let line = encode_standard(0x581, &[0x43, 0, 0x10]);
        assert_eq!(line, b"t5813430010\r");
        let mut receiver = SlcanReceiver::default();
        let heard: Vec<_> = line.iter().filter_map(|byte| receiver.push(*byte)).collect();
        assert_eq!(heard, [Message { identifier: 0x581, extended: false, data: vec![0x43, 0, 0x10] }]);
    }

    proptest! {
        #[test]
        fn takes_any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            hear(&mut SlcanReceiver::default(), &bytes);
        }
    }
}
