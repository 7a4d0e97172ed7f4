//! Dynamixel X servos, and MX servos with Protocol 2.0. Their bus watchdog stops them when this program is gone.

use std::time::Duration;

use firmware_protocol::{Reading, Sense};

use super::LinkError;
use super::bus_servos::{Answer, Bus, Register, TURN_COUNTS, Table, Wire, refuse};

pub(crate) mod models;
pub(crate) mod packet;
pub(crate) mod table;

use models::Model;
use packet::{Packet, PacketReceiver};
use table::hardware_error;

/// How long a servo takes to start.
const START: Duration = Duration::from_millis(300);
/// 0.25 degrees (e-Manual, "Backlash").
const PLAY_URAD: i32 = 4363;
/// Every register that is read.
#[cfg(test)]
pub(super) const READ: [Register; 8] = [
    table::PING,
    table::MODES,
    table::VOLTAGE_LIMITS,
    table::POSITION_LIMITS,
    table::TORQUE_TO_ERROR,
    table::STATUS_RETURN_LEVEL,
    table::MEASURED,
    table::FENCE,
];

/// One servo, as found and as last read.
pub(super) struct Dynamixel {
    model: &'static Model,
    limits: (i32, i32),
    supply_limits: (u16, u16),
    /// What its hardware error register had last.
    error: u8,
    /// What its status return level was last; it is in RAM, and others may change it.
    status_return_level: u8,
}

fn int(bytes: &[u8]) -> i32 {
    bytes.try_into().map_or(0, i32::from_le_bytes)
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

impl Table for Dynamixel {
    type Wire = PacketWire;
    const NAME: &'static str = "dynamixel";
    const PLAY_URAD: i32 = PLAY_URAD;
    const FENCE: Register = table::FENCE;
    const MEASURED: Register = table::MEASURED;
    const POSITION: Register = (132, 4);
    const TORQUE: Register = table::TORQUE_TO_ERROR;
    const GOAL: Register = table::GOAL_POSITION;
    // a watchdog that bit keeps goals read-only until it is cleared
    const PREPARE: &'static [(Register, &'static [u8])] =
        &[(table::BUS_WATCHDOG, &[0]), (table::PROFILE, &[0; 8])];
    const WATCHDOG: Option<(Register, u8)> = Some((table::BUS_WATCHDOG, 25)); // half a second
    const LIMITS: &'static str = "registers 52 and 48";
    const OUTSIDE: &'static str =
        "register 20 (homing offset), which shifts the position, and at these limits (DYNAMIXEL Wizard)";

    fn find(bus: &mut Bus<PacketWire>, id: u8) -> Result<Self, LinkError> {
        let path = bus.path().to_owned();
        let open = |reason: String| LinkError::Open { path: format!("{path}, servo {id}"), reason };
        let wrong = |register: &str, found: i64, expected: &str, advice: &str| {
            refuse(&path, id, register, found, expected, advice)
        };
        let pong = bus.ping(id, table::PING.1)?.ok_or_else(|| {
            open("no answer to a ping; are id, baud rate and protocol (2.0) right, is it powered?".into())
        })?;
        let number = word(&pong, 0);
        let model = models::find(number).map_err(|expected| {
            let advice = "use one of the models that this program knows";
            wrong("register 0 (model number)", number.into(), &expected, advice)
        })?;
        let level = find_level(bus, id, model)?;
        let mut read = |register: Register, name: &str| {
            bus.read_patiently(id, register)?
                .ok_or_else(|| open(format!("no answer to a question for register {} ({name})", register.0)))
        };
        let modes = read(table::MODES, "drive mode")?;
        check_modes([modes[0], modes[1]], wrong)?;
        let limits = read(table::POSITION_LIMITS, "position limits")?;
        let (high, low) = (int(&limits[..4]), int(&limits[4..]));
        if low >= high || !TURN_COUNTS.contains(&low) || !TURN_COUNTS.contains(&high) {
            return Err(open(format!(
                "registers 52 and 48 (lowest and highest position) are {low} and {high}, expected two rising counts from 0 to \
                 4095; set them (DYNAMIXEL Wizard, torque off)"
            )));
        }
        let supply = read(table::VOLTAGE_LIMITS, "voltage limits")?;
        Ok(Self {
            model,
            limits: (low, high),
            supply_limits: (word(&supply, 2), word(&supply, 0)),
            error: 0,
            status_return_level: level,
        })
    }

    fn limits(&self) -> (i32, i32) {
        self.limits
    }

    fn supply_limits(&self) -> (u16, u16) {
        self.supply_limits
    }

    fn answers_writes(&self) -> bool {
        true
    }

    fn position(measured: &[u8]) -> i32 {
        int(&measured[table::POSITION_AT..table::POSITION_AT + 4])
    }

    fn goal(counts: i32) -> Vec<u8> {
        counts.to_le_bytes().to_vec()
    }

    fn take(&mut self, measured: Option<&Answer>, slow: Option<&[u8]>, sense: &mut Sense) {
        if let Some(Answer { data, .. }) = measured {
            let current = i32::from(word(data, table::CURRENT_AT) as i16).abs();
            sense.current_ma = (current * self.model.current_ua / 1000).min(i16::MAX.into()) as i16;
            sense.supply_mv = word(data, table::VOLTAGE_AT).saturating_mul(100);
            sense.temperature_c = data[table::TEMPERATURE_AT].min(i8::MAX as u8) as i8;
        }
        if let Some(bytes) = slow {
            let at = |register: Register| bytes[usize::from(register.0 - table::TORQUE_TO_ERROR.0)];
            self.error = at(table::HARDWARE_ERROR);
            self.status_return_level = at(table::STATUS_RETURN_LEVEL);
        }
        if self.error & hardware_error::ENCODER != 0 {
            sense.reading = Reading::Invalid;
        }
        if self.error & hardware_error::OVERHEAT != 0 {
            sense.temperature_c = i8::MAX;
        }
        if self.error & hardware_error::VOLTAGE != 0 {
            sense.supply_mv = 0;
        }
    }

    fn refusal(&self, error: u8) -> Option<String> {
        // bit 7 is an alert about the hardware, not about this write
        let code = usize::from(error & 0x7F);
        let name = table::ANSWER_ERRORS.get(code.wrapping_sub(1)).copied().unwrap_or("an unknown reason");
        (code != 0).then(|| format!("refused a write: {name}"))
    }

    fn reset(&mut self, bus: &mut Bus<PacketWire>, id: u8) -> Result<Option<Duration>, LinkError> {
        if std::mem::take(&mut self.error) == 0 {
            return Ok(None);
        }
        bus.reboot(id)?;
        Ok(Some(START))
    }

    fn errors(&self) -> Vec<String> {
        let hardware = hardware_error::NAMES.iter().filter(|(bit, _)| self.error & bit != 0);
        let level = (self.status_return_level != 2).then(|| {
            format!("register 68 (status return level) was set to {}, expected 2", self.status_return_level)
        });
        hardware.map(|(_, name)| format!("shutdown: {name}")).chain(level).collect()
    }
}

/// The status return level, which must be 2. At 0 a servo answers a ping and no question for a register.
fn find_level(bus: &mut Bus<PacketWire>, id: u8, model: &Model) -> Result<u8, LinkError> {
    let level = bus.read_patiently(id, table::STATUS_RETURN_LEVEL)?.map(|values| values[0]);
    let name = format!("register 68 (status return level) of this {}", model.name);
    let (register, found, symptom) = match level {
        Some(2) => return Ok(2),
        Some(level) => (name, level, ""),
        None if bus.ping(id, table::PING.1)?.is_some() => {
            (name, 0, "it answers pings and no question for a register; ")
        }
        None => {
            let path = format!("{}, servo {id}", bus.path());
            return Err(LinkError::Open {
                path,
                reason: "it answered a ping, and then nothing any more".into(),
            });
        }
    };
    let advice = format!(
        "{symptom}set it to 2 (DYNAMIXEL Wizard), or switch the servo off and on, which sets it to 2"
    );
    Err(refuse(bus.path(), id, &register, found.into(), "2 (answers pings, reads and writes)", &advice))
}

/// Position control, on its own motor. A reversed direction is the wiring of the rig, and goals and positions agree on it.
fn check_modes(
    [drive, operating]: [u8; 2],
    wrong: impl Fn(&str, i64, &str, &str) -> LinkError,
) -> Result<(), LinkError> {
    if drive & table::DRIVE_MODE_SLAVE != 0 {
        let expected = "bit 1 (slave of another servo) off";
        let advice = "set it (DYNAMIXEL Wizard, torque off): a slave takes no goal of its own";
        return Err(wrong("register 10 (drive mode)", drive.into(), expected, advice));
    }
    if ![3, 5].contains(&operating) {
        let expected = "3 (position) or 5 (position with current limit)";
        let advice = if operating == 4 {
            "4 (extended position) counts turns, and a shaft may stand where no angle of one turn leads: set it to 3 (DYNAMIXEL \
             Wizard, torque off)"
        } else {
            "set it to 3 (DYNAMIXEL Wizard, torque off)"
        };
        return Err(wrong("register 11 (operating mode)", operating.into(), expected, advice));
    }
    Ok(())
}

/// Packets with their status.
#[derive(Default)]
pub(super) struct PacketWire(PacketReceiver);

impl Wire for PacketWire {
    fn number(value: u16) -> Vec<u8> {
        value.to_le_bytes().to_vec()
    }

    fn question(&mut self, id: u8, instruction: u8, parameters: Vec<u8>) -> Vec<u8> {
        Packet { id, instruction, parameters }.encode()
    }

    fn push(&mut self, bytes: &[u8]) -> Vec<Answer> {
        let answers = self.0.push(bytes).into_iter().filter_map(|packet| {
            let (error, data) = packet.answer()?;
            // a question that was refused has no data
            let data = if error & 0x7F == 0 { data.to_vec() } else { Vec::new() };
            Some(Answer { id: packet.id, error, data })
        });
        answers.collect()
    }

    fn clear(&mut self) {
        self.0.clear();
    }

    fn damaged(&self) -> u32 {
        self.0.damaged
    }
}
