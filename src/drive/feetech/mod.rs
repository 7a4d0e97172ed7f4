//! Feetech STS servos. They have play and no watchdog: when this program is gone they go to their last goal and hold.

use std::collections::VecDeque;
use std::time::Duration;

use firmware_protocol::{Reading, Sense};

use super::LinkError;
use super::bus_servos::{Answer, Bus, Register, TURN_COUNTS, Table, Wire, refuse};

pub(crate) mod packet;
pub(crate) mod table;

use packet::{Packet, PacketReceiver};

/// The degree of play that others measured.
const PLAY_URAD: i32 = 17_453;
/// Questions with an echo that may still come.
const ECHOES: usize = 8;
/// Where settings are changed.
const TOOL: &str = "with Feetech's FD program, torque off";
/// Every register that is read.
#[cfg(test)]
pub(super) const READ: [Register; 4] = [table::FENCE, table::SETUP, table::TORQUE_ENABLE, table::MEASURED];

/// One servo, as found and as last read.
pub(super) struct Feetech {
    limits: (i32, i32),
    supply_limits: (u16, u16),
    answers_writes: bool,
    /// Error bits of its last answer.
    error: u8,
}

impl Table for Feetech {
    type Wire = PacketWire;
    const NAME: &'static str = "feetech";
    const PLAY_URAD: i32 = PLAY_URAD;
    const FENCE: Register = table::FENCE;
    const MEASURED: Register = table::MEASURED;
    const POSITION: Register = (56, 2);
    const TORQUE: Register = table::TORQUE_ENABLE;
    const GOAL: Register = table::GOAL_POSITION;
    const PREPARE: &'static [(Register, &'static [u8])] = &[];
    const WATCHDOG: Option<(Register, u8)> = None;
    const LIMITS: &'static str = "registers 9 and 11";
    const OUTSIDE: &'static str = "register 31 (position offset), which shifts the position, and at these limits (Feetech's FD program)";

    fn find(bus: &mut Bus<PacketWire>, id: u8) -> Result<Self, LinkError> {
        let path = bus.path().to_owned();
        let setup = bus.read_patiently(id, table::SETUP)?.ok_or_else(|| LinkError::Open {
            path: format!("{path}, servo {id}"),
            reason: "no answer to a question for its model and settings (registers 3 to 33); are id and baud rate right, is \
                     it powered?"
                .into(),
        })?;
        let byte = |address: u16| setup[usize::from(address - table::SETUP.0)];
        let word = |address: u16| table::signed(byte(address), byte(address + 1));
        let wrong = |register: &str, found: i64, expected: &str, advice: &str| {
            refuse(&path, id, register, found, expected, advice)
        };
        check_model(u16::from_le_bytes([byte(3), byte(4)]), wrong)?;
        let mode = byte(table::MODE);
        if mode != 0 {
            let expected = "0 (position)";
            return Err(wrong(
                "register 33 (operating mode)",
                mode.into(),
                expected,
                &format!("set it to 0 {TOOL}"),
            ));
        }
        let phase = byte(table::PHASE);
        if phase & table::COUNTS_TURNS != 0 {
            let single = phase & !table::COUNTS_TURNS;
            let expected = format!("{single} (bit 4 off: positions within one turn)");
            let advice =
                format!("a servo that counts turns may stand where no goal leads: set it to {single} {TOOL}");
            return Err(wrong("register 18 (phase)", phase.into(), &expected, &advice));
        }
        let resolution = byte(table::RESOLUTION);
        if resolution > 1 {
            let expected = "1 (4096 counts to the turn)";
            let advice = format!("set it to 1 {TOOL}");
            return Err(wrong("register 30 (angular resolution)", resolution.into(), expected, &advice));
        }
        let limits = (word(table::LOWEST), word(table::HIGHEST));
        if limits.0 >= limits.1 || !TURN_COUNTS.contains(&limits.0) || !TURN_COUNTS.contains(&limits.1) {
            let reason = format!(
                "registers 9 and 11 (lowest and highest position) are {} and {}, expected two rising counts from 0 to 4095; \
                 0 and 0 let it count turns; set them {TOOL}",
                limits.0, limits.1
            );
            return Err(LinkError::Open { path: format!("{path}, servo {id}"), reason });
        }
        let supply_limits = (byte(table::LOWEST_SUPPLY).into(), byte(table::HIGHEST_SUPPLY).into());
        Ok(Self { limits, supply_limits, answers_writes: byte(table::ANSWER_LEVEL) != 0, error: 0 })
    }

    fn limits(&self) -> (i32, i32) {
        self.limits
    }

    fn supply_limits(&self) -> (u16, u16) {
        self.supply_limits
    }

    fn answers_writes(&self) -> bool {
        self.answers_writes
    }

    fn position(measured: &[u8]) -> i32 {
        table::signed(measured[0], measured[1])
    }

    /// Goals lie within the turn, so none has a sign.
    fn goal(counts: i32) -> Vec<u8> {
        (counts.clamp(*TURN_COUNTS.start(), *TURN_COUNTS.end()) as u16).to_le_bytes().to_vec()
    }

    fn take(&mut self, measured: Option<&Answer>, _slow: Option<&[u8]>, sense: &mut Sense) {
        let Some(Answer { error, data, .. }) = measured else { return };
        let current = table::signed(data[table::CURRENT_AT], data[table::CURRENT_AT + 1]).abs();
        self.error = error | data[table::STATUS_AT];
        sense.supply_mv = u16::from(data[table::VOLTAGE_AT]) * 100;
        sense.temperature_c = data[table::TEMPERATURE_AT].min(i8::MAX as u8) as i8;
        sense.current_ma = (current * 13 / 2).min(i16::MAX.into()) as i16;
        if self.error & table::ENCODER != 0 {
            sense.reading = Reading::Invalid;
        }
        if self.error & table::VOLTAGE != 0 {
            sense.supply_mv = 0;
        }
        if self.error & table::OVERHEAT != 0 {
            sense.temperature_c = i8::MAX;
        }
        if self.error & table::OVERCURRENT != 0 {
            sense.current_ma = i16::MAX;
        }
        if self.error & table::OVERLOAD != 0 {
            sense.torque = false;
        }
    }

    /// Its error bits tell of the servo, not of the write.
    fn refusal(&self, _error: u8) -> Option<String> {
        None
    }

    /// Its protection ends with the next switching on.
    fn reset(&mut self, bus: &mut Bus<PacketWire>, id: u8) -> Result<Option<Duration>, LinkError> {
        if self.error == 0 {
            return Ok(None);
        }
        if self.answers_writes {
            bus.write(id, table::TORQUE_ENABLE, &[0])?;
        } else {
            bus.write_unanswered(id, table::TORQUE_ENABLE, &[0])?;
        }
        Ok(Some(Duration::ZERO))
    }

    fn errors(&self) -> Vec<String> {
        let known = table::ERRORS.iter().filter(|(bit, _)| self.error & bit != 0);
        let known = known.map(|(_, name)| (*name).to_owned());
        let named = table::ERRORS.iter().fold(0, |bits, (bit, _)| bits | bit);
        let others = (0..8).filter(|bit| self.error & !named & 1 << bit != 0);
        known.chain(others.map(|bit| format!("error bit {bit}"))).collect()
    }
}

fn check_model(found: u16, wrong: impl Fn(&str, i64, &str, &str) -> LinkError) -> Result<(), LinkError> {
    if table::MODELS.iter().any(|(number, _)| *number == found) {
        return Ok(());
    }
    let known: Vec<_> = table::MODELS.iter().map(|(number, name)| format!("{number} {name}")).collect();
    // a make that sends the high byte first sends its model so, too
    let other = table::OTHERS.iter().find(|(number, _)| *number == found || number.swap_bytes() == found);
    let advice = other.map_or("registers of other models mean something else", |(_, what)| *what);
    Err(wrong("register 3 (model)", found.into(), &format!("one of {}", known.join(", ")), advice))
}

/// Packets; questions look like answers.
#[derive(Default)]
pub(super) struct PacketWire {
    receiver: PacketReceiver,
    /// Questions asked lately: half-duplex adapters say them back, some right away and some after a while. No answer looks
    /// like the question of a register.
    echoes: VecDeque<Packet>,
}

impl Wire for PacketWire {
    /// Registers and lengths are one byte.
    fn number(value: u16) -> Vec<u8> {
        vec![value as u8]
    }

    fn question(&mut self, id: u8, instruction: u8, parameters: Vec<u8>) -> Vec<u8> {
        let question = Packet { id, code: instruction, parameters };
        let bytes = question.encode();
        if self.echoes.len() == ECHOES {
            self.echoes.pop_front();
        }
        self.echoes.push_back(question);
        bytes
    }

    fn push(&mut self, bytes: &[u8]) -> Vec<Answer> {
        let mut answers = Vec::new();
        for packet in self.receiver.push(bytes) {
            if let Some(at) = self.echoes.iter().position(|question| *question == packet) {
                self.echoes.remove(at);
            } else {
                answers.push(Answer { id: packet.id, error: packet.code, data: packet.parameters });
            }
        }
        answers
    }

    fn clear(&mut self) {
        self.receiver.clear();
    }

    fn damaged(&self) -> u32 {
        self.receiver.damaged
    }
}
