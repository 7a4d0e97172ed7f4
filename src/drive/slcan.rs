//! CAN over a serial adapter in the LAWICEL text protocol (CAN232 manual version 3): `T` + 8 hex digits of identifier +
//! length + data, closed by a carriage return; `\r`, `z\r`, `Z\r` say yes, BEL says no.

use std::fmt;
use std::io::{ErrorKind, Read as _, Write as _};
use std::str::FromStr;
use std::time::{Duration, Instant};

use firmware_protocol::{Frame, LinkCounters};
use serialport::{SerialPort as _, TTYPort};

use super::LinkError;

/// What closes it again.
pub const CLOSE: &[u8] = b"C\r";

/// Longest line the protocol has: identifier, length, 8 bytes, time stamp.
const LONGEST_LINE: usize = 1 + 8 + 1 + 16 + 4;

/// What an adapter says no with.
const BEL: u8 = 0x07;
/// How long an adapter may take to answer a command; there are some that answer none.
const ANSWER_WITHIN: Duration = Duration::from_millis(200);
/// No answer still comes after so long a silence: three times the latency of a usual USB serial port.
const QUIET: Duration = Duration::from_millis(50);
/// When every message was refused for this long, none will be accepted.
const REFUSED_FOR: Duration = Duration::from_millis(100);

/// Bit rates of the protocol; their place is the digit of the command `S`.
const BIT_RATES: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];

/// A bit rate that the protocol has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRate(usize);

impl Default for BitRate {
    /// 1 Mbit/s: the rig's own.
    fn default() -> Self {
        Self(BIT_RATES.len() - 1)
    }
}

impl FromStr for BitRate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let place = BIT_RATES.iter().position(|rate| text == rate.to_string());
        place.map(Self).ok_or_else(|| {
            let rates = BIT_RATES.map(|rate| rate.to_string()).join(", ");
            format!("`{text}` is no bit rate of a LAWICEL adapter, expected one of {rates}")
        })
    }
}

impl fmt::Display for BitRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bit/s", BIT_RATES[self.0])
    }
}

/// Ends any half line, closes the channel, sets the bit rate, opens the channel; the answer to each command is waited for.
pub(super) fn open_channel(port: &mut TTYPort, name: &str, rate: BitRate) -> Result<(), LinkError> {
    let refused = |command: &str, what: String, advice: &str| LinkError::AdapterRefused {
        path: name.to_owned(),
        command: format!("`{command}` ({what})"),
        advice: advice.to_owned(),
    };
    // a half line is an error, and a channel that is closed cannot be closed: these may be refused
    for command in ["\r\r", "C"] {
        ask(port, name, command)?;
        wait_for_quiet(port, name)?; // two half lines have two answers: none is left for the next command
    }
    let set = format!("S{}", rate.0);
    if ask(port, name, &set)? == Some(BEL) {
        let advice = "it has no such bit rate, or its channel stays open: name another (PATH@BITRATE), or plug it in again";
        return Err(refused(&set, format!("bit rate {rate}"), advice));
    }
    if ask(port, name, "O")? == Some(BEL) {
        let advice =
            "it takes no part in the bus: another program has it open, or it is at fault; plug it in again";
        return Err(refused("O", format!("open the channel at {rate}"), advice));
    }
    Ok(())
}

/// Reads until nothing came for a while: no late answer is mistaken for that to the next command.
fn wait_for_quiet(port: &mut TTYPort, name: &str) -> Result<(), LinkError> {
    let end = Instant::now() + ANSWER_WITHIN;
    let mut bytes = [0; 256];
    while Instant::now() < end && read_within(port, name, QUIET, &mut bytes)? > 0 {}
    Ok(())
}

/// Sends one command; what it was answered with, `None` for nothing in time.
fn ask(port: &mut TTYPort, name: &str, command: &str) -> Result<Option<u8>, LinkError> {
    let _ = port.clear(serialport::ClearBuffer::Input); // messages of a channel that was left open
    port.write_all(format!("{command}\r").as_bytes()).map_err(|error| hung_up(name, &error))?;
    let end = Instant::now() + ANSWER_WITHIN;
    let mut bytes = [0; 256];
    loop {
        let left = end.saturating_duration_since(Instant::now());
        let count = if left.is_zero() { 0 } else { read_within(port, name, left, &mut bytes)? };
        // what follows the message of another is the answer
        let answer = bytes[..count].iter().rev().copied().find(|byte| [b'\r', BEL].contains(byte));
        if answer.is_some() || count == 0 {
            return Ok(answer);
        }
    }
}

/// Bytes that came within a time, 0 for none.
fn read_within(port: &mut TTYPort, name: &str, time: Duration, bytes: &mut [u8]) -> Result<usize, LinkError> {
    let usual = port.timeout();
    let _ = port.set_timeout(time); // a setting of this program: cannot fail
    let outcome = loop {
        match port.read(bytes) {
            Ok(0) => break Err(hung_up(name, &ErrorKind::UnexpectedEof.into())),
            Ok(count) => break Ok(count),
            Err(error) if error.kind() == ErrorKind::TimedOut => break Ok(0),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => break Err(hung_up(name, &error)),
        }
    };
    let _ = port.set_timeout(usual);
    outcome
}

fn hung_up(name: &str, error: &std::io::Error) -> LinkError {
    LinkError::HungUp { path: name.to_owned(), reason: error.to_string() }
}

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
pub(crate) fn encode(frame: &Frame) -> Vec<u8> {
    line(format!("T{:08X}", frame.id.encode()), frame.data())
}

/// The line that sends a message with an 11-bit identifier.
pub(crate) fn encode_standard(identifier: u16, data: &[u8]) -> Vec<u8> {
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
    /// Messages refused since one was accepted: when the first and the last were, and how many.
    refused: Option<(Instant, Instant, u32)>,
}

impl SlcanReceiver {
    /// What was seen so far. The bus has its own checksum; what fails here is text that is none.
    pub(crate) fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// An error when the adapter takes no messages any more.
    pub(super) fn refuse_refusals(&self, name: &str) -> Result<(), LinkError> {
        let Some((first, last, count)) = self.refused else { return Ok(()) };
        let lasted = last.duration_since(first);
        if lasted < REFUSED_FOR {
            return Ok(());
        }
        Err(LinkError::AdapterRefused {
            path: name.to_owned(),
            command: format!("{count} messages in a row (`t`, `T`: send) within {lasted:.1?}"),
            advice: "its buffer is full and no device on the bus acknowledges, or its channel was closed: check the bit rate \
                     (PATH@BITRATE), cable and termination"
                .into(),
        })
    }

    /// The same for a rig's frames; messages of others are passed over.
    pub(crate) fn push_frame(&mut self, byte: u8) -> Option<Frame> {
        let message = self.push(byte).filter(|message| message.extended)?;
        let frame = Frame::from_can(message.identifier, &message.data)?;
        self.counters.frames += 1;
        Some(frame)
    }

    /// Takes one byte; a message when it closed the line of one.
    pub(crate) fn push(&mut self, byte: u8) -> Option<Message> {
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                if std::mem::take(&mut self.overlong) {
                    self.counters.overlong += 1;
                    return None;
                }
                self.line_to_message(&line)
            }
            BEL => {
                // a full buffer for a moment is no harm: what matters is repeated
                self.line.clear();
                let now = Instant::now();
                let (first, _, count) = self.refused.unwrap_or((now, now, 0));
                self.refused = Some((first, now, count + 1));
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
        if matches!(line.first(), Some(b'z' | b'Z')) {
            self.refused = None;
        }
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
        let messages: Vec<_> = line.iter().filter_map(|byte| receiver.push(*byte)).collect();
        assert_eq!(messages, [Message { identifier: 0x581, extended: false, data: vec![0x43, 0, 0x10] }]);
    }

    #[test]
    fn an_adapter_that_takes_nothing_any_more_is_an_error() {
        let mut receiver = SlcanReceiver::default();
        hear(&mut receiver, b"\x07");
        std::thread::sleep(REFUSED_FOR);
        hear(&mut receiver, b"z\r\x07\x07");
        receiver.refuse_refusals("slcan:a").unwrap();
        std::thread::sleep(REFUSED_FOR);
        hear(&mut receiver, b"\x07");
        let message = receiver.refuse_refusals("slcan:a").unwrap_err().to_string();
        assert!(
            message.contains("slcan:a") && message.contains("3 messages") && message.contains("bit rate"),
            "{message}"
        );
    }

    #[test]
    fn bit_rates_are_those_of_the_protocol() {
        let digits = ["10000", "125000", "500000", "1000000"].map(|text| text.parse::<BitRate>().unwrap().0);
        assert_eq!(digits, [0, 4, 6, 8]);
        let message = "300000".parse::<BitRate>().unwrap_err();
        assert!(message.contains("`300000`") && message.contains("250000, 500000"), "{message}");
    }

    proptest! {
        #[test]
        fn takes_any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            hear(&mut SlcanReceiver::default(), &bytes);
        }
    }
}
