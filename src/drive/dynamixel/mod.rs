//! Dynamixel X servos as a rig. The servos' own bus watchdog stops them when this program is gone; torque is switched on by
//! arming and never off.

use std::path::Path;
use std::time::{Duration, Instant};

use firmware_protocol::config::Home;
use firmware_protocol::{LinkCounters, Reading, Sense, Setpoint};

use super::LinkError;
use super::hosted::{Actuators, HostedLink, Make, Questions, Sample};

mod bus;
pub(crate) mod packet;
pub(crate) mod table;

use bus::Bus;
use table::hardware_error;

/// Rounds between two looks at torque switch and hardware error.
const SLOW_ROUNDS: u32 = 10;
/// Silence after which a servo stops by itself, in its unit of 20 ms.
const BUS_WATCHDOG_20_MS: u8 = 25;
/// How long a servo takes to start.
const START: Duration = Duration::from_millis(300);
/// 0.25 degrees of play (e-Manual, "Backlash"). The encoder sits on the output and sees it.
const PLAY_URAD: i32 = 4363;
/// The encoder's integral non-linearity: 0.5 degrees at room temperature (ams AS5045 data sheet, "INLopt").
const ACCURACY_URAD: i32 = 8727;

/// Opens a bus and finds its two servos; the first is axis 0.
pub(super) fn open(path: &Path, baud: u32, ids: [u8; 2]) -> Result<HostedLink, LinkError> {
    let mut bus = Bus::open(path, baud)?;
    let ranges_urad = [find(&mut bus, ids[0])?, find(&mut bus, ids[1])?];
    let uid = u64::from(ids[0]) << 8 | u64::from(ids[1]);
    let make = Make {
        uid,
        ranges_urad,
        accuracy_urad: ACCURACY_URAD,
        resolutions_urad: [table::COUNT_URAD; 2],
        play_urad: PLAY_URAD,
        lost_motion_urad: 0,
        homes: [Home::Absolute; 2],
    };
    let name = format!("dynamixel:{}", bus.path());
    let servos = ids.map(BusServo::new);
    HostedLink::start(name, Dynamixel { bus, servos }, &make)
}

/// Looks at one servo before anything is told to it; its lowest and highest angle, µrad.
fn find(bus: &mut Bus, id: u8) -> Result<(i32, i32), LinkError> {
    let path = format!("{}, servo {id}", bus.path());
    let wrong = |reason: String| LinkError::Open { path: path.clone(), reason };
    let mut model = None;
    for _ in 0..3 {
        model = model.or(bus.ping(id)?);
    }
    let model = model.ok_or_else(|| wrong("no answer; are id and baud rate right, is it powered?".into()))?;
    if !table::MODELS.contains(&model) {
        return Err(wrong(format!("model {model} is none of the known {:?}", table::MODELS)));
    }
    let mut register = |register: table::Register| -> Result<Vec<u8>, LinkError> {
        for _ in 0..3 {
            if let Some(values) = bus.read(id, register)? {
                return Ok(values);
            }
        }
        Err(wrong(format!("register {} cannot be read", register.0)))
    };
    let mode = register(table::OPERATING_MODE)?[0];
    if ![3, 5].contains(&mode) {
        return Err(wrong(format!(
            "operating mode {mode}, expected 3 (position) or 5 (position with current limit)"
        )));
    }
    let low = int(&register(table::MIN_POSITION)?);
    let high = int(&register(table::MAX_POSITION)?);
    // a watchdog that bit before keeps goals read-only until it is cleared
    bus.write(id, table::BUS_WATCHDOG, &[0])?;
    Ok((table::urad(low), table::urad(high)))
}

fn int(bytes: &[u8]) -> i32 {
    bytes.try_into().map_or(0, i32::from_le_bytes)
}

/// One servo, as last heard.
#[derive(Clone, Debug)]
struct BusServo {
    id: u8,
    sense: Sense,
    between: [Instant; 2],
    questions: Questions,
    /// What its hardware error register said last.
    error: u8,
    /// What it last answered to a write that it refused.
    refused: Option<u8>,
    /// Torque was switched on since it was last to be off: should it vanish, it was the servo that dropped it.
    switched_on: bool,
}

struct Dynamixel {
    bus: Bus,
    servos: [BusServo; 2],
}

impl Dynamixel {
    fn ids(&self) -> [u8; 2] {
        self.servos.each_ref().map(|servo| servo.id)
    }

    /// Whether the servo took the value; a refusal is kept for those who ask.
    fn write(&mut self, axis: usize, register: table::Register, values: &[u8]) -> Result<bool, LinkError> {
        let answer = self.bus.write(self.servos[axis].id, register, values)?;
        self.servos[axis].refused = answer.filter(|error| *error != 0);
        Ok(answer == Some(0))
    }

    /// The goal first: with torque on, the shaft goes where the goal register happens to say.
    fn switch_on(&mut self, axis: usize, goal: &[u8]) -> Result<(), LinkError> {
        if self.write(axis, table::GOAL_POSITION, goal)?
            && self.write(axis, table::TORQUE_ENABLE, &[1])?
            && self.write(axis, table::BUS_WATCHDOG, &[BUS_WATCHDOG_20_MS])?
        {
            let servo = &mut self.servos[axis];
            (servo.sense.torque, servo.switched_on) = (true, true);
        }
        Ok(())
    }
}

impl BusServo {
    fn new(id: u8) -> Self {
        let (sense, questions) = (Sense::UNREAD, Questions::default());
        let between = [Instant::now(); 2];
        Self { id, sense, between, questions, error: 0, refused: None, switched_on: false }
    }

    fn take(&mut self, measured: Option<&[u8]>, slow: Option<&[u8]>) {
        self.sense.reading = Reading::Missing;
        if let Some(bytes) = measured {
            let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
            let position = int(&bytes[table::POSITION_AT..table::POSITION_AT + 4]);
            let current = i32::from(word(table::CURRENT_AT) as i16).abs() * 269 / 100;
            self.sense.reading = Reading::Measured(table::urad(position));
            self.sense.current_ma = current.min(i16::MAX.into()) as i16;
            self.sense.supply_mv = word(table::VOLTAGE_AT).saturating_mul(100);
            self.sense.temperature_c = bytes[table::TEMPERATURE_AT].min(i8::MAX as u8) as i8;
        }
        if let Some(bytes) = slow {
            self.sense.torque = bytes[0] == 1;
            self.error = bytes[usize::from(table::HARDWARE_ERROR.0 - table::TORQUE_TO_ERROR.0)];
        }
        if self.error & hardware_error::ENCODER != 0 {
            self.sense.reading = Reading::Invalid;
        }
        if self.error & hardware_error::OVERHEAT != 0 {
            self.sense.temperature_c = i8::MAX;
        }
        if self.error & hardware_error::VOLTAGE != 0 {
            self.sense.supply_mv = 0;
        }
    }

    fn errors(&self) -> Vec<String> {
        let hardware = hardware_error::NAMES.iter().filter(|(bit, _)| self.error & bit != 0);
        let refused = self.refused.map(|code| {
            let name = table::ANSWER_ERRORS.get(usize::from(code).wrapping_sub(1));
            format!("refused a write: {}", name.copied().unwrap_or("an unknown reason"))
        });
        hardware.map(|(_, name)| format!("shutdown: {name}")).chain(refused).collect()
    }
}

impl Actuators for Dynamixel {
    fn listen(&mut self, round: u32) -> Result<[Sample; 2], LinkError> {
        let ids = self.ids();
        let asked = Instant::now();
        self.servos.iter_mut().for_each(|servo| servo.questions.ask(asked));
        let measured = self.bus.sync_read(&ids, table::MEASURED)?;
        let heard = Instant::now();
        let slow = if round.is_multiple_of(SLOW_ROUNDS) {
            self.bus.sync_read(&ids, table::TORQUE_TO_ERROR)?
        } else {
            vec![None; ids.len()]
        };
        for ((servo, measured), slow) in self.servos.iter_mut().zip(&measured).zip(&slow) {
            servo.take(measured.as_deref(), slow.as_deref());
            if measured.is_some() {
                servo.between = servo.questions.answer(heard);
            }
        }
        Ok(self.servos.each_ref().map(|servo| Sample { sense: servo.sense, between: servo.between }))
    }

    fn tell(&mut self, setpoints: [Option<Setpoint>; 2]) -> Result<(), LinkError> {
        let mut goals = Vec::new();
        for (axis, setpoint) in setpoints.into_iter().enumerate() {
            let servo = &mut self.servos[axis];
            let Some(setpoint) = setpoint else {
                servo.switched_on = false;
                continue;
            };
            let goal = table::counts(setpoint.position_urad).to_le_bytes();
            if servo.sense.torque {
                servo.switched_on = true;
                goals.push((servo.id, goal.to_vec()));
            } else if !servo.switched_on {
                self.switch_on(axis, &goal)?;
            }
        }
        if goals.is_empty() { Ok(()) } else { self.bus.sync_write(table::GOAL_POSITION, &goals) }
    }

    fn recover(&mut self) -> Result<(), LinkError> {
        let shut_down = self.servos.each_ref().map(|servo| servo.error != 0);
        for (servo, _) in self.servos.iter_mut().zip(shut_down).filter(|(_, shut_down)| *shut_down) {
            self.bus.reboot(servo.id)?;
            (servo.switched_on, servo.error, servo.refused) = (false, 0, None);
        }
        if shut_down.contains(&true) {
            std::thread::sleep(START);
        }
        Ok(())
    }

    fn leave(&mut self) {
        for id in self.ids() {
            let _ = self.bus.write(id, table::BUS_WATCHDOG, &[0]); // a bus that is gone needs no farewell
        }
    }

    fn errors(&self) -> [Vec<String>; 2] {
        [self.servos[0].errors(), self.servos[1].errors()]
    }

    fn counters(&self) -> LinkCounters {
        LinkCounters {
            frames: self.bus.answers,
            checksum_errors: self.bus.damaged(),
            ..LinkCounters::default()
        }
    }
}
