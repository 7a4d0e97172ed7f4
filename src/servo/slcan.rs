//! CAN over a serial adapter in the LAWICEL text protocol (CAN232 manual version 3): `T` + 8 hex digits of identifier +
//! length + data, closed by a carriage return; `\r`, `z\r`, `Z\r` say yes, BEL says no.

use firmware_protocol::{Frame, LinkCounters};

/// What opens the adapter: end of any half line, close, 1 Mbit/s, open.
pub const OPEN: &[u8] = b"\r\r\rC\rS8\rO\r";

/// What closes it again.
pub const CLOSE: &[u8] = b"C\r";

/// Longest line the protocol has: identifier, length, 8 bytes, time stamp.
const LONGEST_LINE: usize = 1 + 8 + 1 + 16 + 4;

/// The line that sends a frame.
pub fn encode(frame: &Frame) -> Vec<u8> {
    let mut line = format!("T{:08X}{}", frame.id.encode(), frame.data().len());
    for byte in frame.data() {
        line += &format!("{byte:02X}");
    }
    line.push('\r');
    line.into_bytes()
}

/// Bytes of an adapter to frames.
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

    /// Takes one byte; a frame when it closed the line of one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                if std::mem::take(&mut self.overlong) {
                    self.counters.overlong += 1;
                    return None;
                }
                self.line_to_frame(&line)
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

    fn line_to_frame(&mut self, line: &[u8]) -> Option<Frame> {
        // answers, and frames with 11 bits or without data, are others' business
        if !matches!(line.first(), Some(b'T')) {
            let known =
                matches!(line.first(), None | Some(b'z' | b'Z' | b't' | b'r' | b'R' | b'F' | b'V' | b'N'));
            self.counters.malformed += u32::from(!known);
            return None;
        }
        let Some((identifier, data)) = parse(line) else {
            self.counters.malformed += 1;
            return None;
        };
        let frame = Frame::from_can(identifier, &data)?;
        self.counters.frames += 1;
        Some(frame)
    }
}

fn parse(line: &[u8]) -> Option<(u32, Vec<u8>)> {
    let text = std::str::from_utf8(line).ok()?;
    if !text.bytes().skip(1).all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let identifier = u32::from_str_radix(text.get(1..9)?, 16).ok()?;
    let length = text.get(9..10)?.parse::<usize>().ok().filter(|length| *length <= 8)?;
    let rest = text.get(10..)?;
    // with time stamps switched on, four digits follow
    if rest.len() != 2 * length && rest.len() != 2 * length + 4 {
        return None;
    }
    let data = (0..length)
        .map(|at| u8::from_str_radix(&rest[2 * at..2 * at + 2], 16).ok())
        .collect::<Option<_>>()?;
    Some((identifier, data))
}

#[cfg(test)]
mod tests {
    use firmware_protocol::{Command, Order};
    use proptest::prelude::*;

    use super::*;

    fn hear(receiver: &mut SlcanReceiver, bytes: &[u8]) -> Vec<Frame> {
        bytes.iter().filter_map(|byte| receiver.push(*byte)).collect()
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

    proptest! {
        #[test]
        fn takes_any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            hear(&mut SlcanReceiver::default(), &bytes);
        }
    }
}
