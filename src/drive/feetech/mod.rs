//! Feetech STS servos as a rig. They have play and no watchdog: when this program is gone they hold where they are.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use firmware_protocol::config::Home;
use firmware_protocol::{LinkCounters, Reading, Sense, Setpoint};

use super::LinkError;
use super::bus_port::BusPort;
use super::hosted::{Actuators, HostedLink, Make, Questions, Sample};

pub(crate) mod packet;

use packet::{Packet, PacketReceiver, Register};

/// How long a servo may take to answer at a megabaud behind a slow USB adapter.
const ANSWER_WITHIN: Duration = Duration::from_millis(30);
/// Rounds between two looks at the torque switch.
const SLOW_ROUNDS: u32 = 10;
/// The degree of play that others measured; the encoder sits on the output and sees it.
const PLAY_URAD: i32 = 17_453;
/// Error of the magnetic encoder's scale: the maker gives none; 0.5 degrees is usual for a 12-bit one off its axis a little
/// (ams AS5045 data sheet, "INLopt").
const ACCURACY_URAD: i32 = 8727;
/// Questions whose echo may still come.
const ECHOES: usize = 8;
/// STS3215 and STS3250.
const MODELS: [u16; 2] = [777, 2825];

/// Opens a bus and finds its two servos; the first is axis 0.
pub(super) fn open(path: &Path, baud: u32, ids: [u8; 2]) -> Result<HostedLink, LinkError> {
    let port = BusPort::open(path, baud)?;
    let mut bus = Bus {
        port,
        receiver: PacketReceiver::default(),
        waiting: VecDeque::new(),
        echoes: VecDeque::new(),
        answers: 0,
    };
    let found = [bus.find(ids[0])?, bus.find(ids[1])?];
    let uid = u64::from(ids[0]) << 8 | u64::from(ids[1]);
    let make = Make {
        uid,
        ranges_urad: found.map(|(range, _)| range),
        accuracy_urad: ACCURACY_URAD,
        resolutions_urad: [packet::COUNT_URAD; 2],
        play_urad: PLAY_URAD,
        lost_motion_urad: 0,
        homes: [Home::Absolute; 2],
    };
    let name = format!("feetech:{}", bus.port.path());
    let servo = |axis: usize| BusServo {
        id: ids[axis],
        sense: Sense::UNREAD,
        between: [Instant::now(); 2],
        questions: Questions::default(),
        error: 0,
        answers_writes: found[axis].1,
        switched_on: false,
    };
    HostedLink::start(name, Feetech { bus, servos: [servo(0), servo(1)] }, &make)
}

/// Questions and answers, each with a time limit.
struct Bus {
    port: BusPort,
    receiver: PacketReceiver,
    waiting: VecDeque<Packet>,
    /// Questions asked lately: half-duplex adapters say them back, some right away and some after a while. No answer looks
    /// like the question of a register.
    echoes: VecDeque<Packet>,
    answers: u32,
}

impl Bus {
    fn ask(&mut self, id: u8, instruction: u8, parameters: Vec<u8>) -> Result<(), LinkError> {
        self.waiting.clear();
        self.receiver.clear();
        self.port.forget()?; // a late answer would be taken for that to this question
        let question = Packet { id, code: instruction, parameters };
        self.port.send(&question.encode())?;
        if self.echoes.len() == ECHOES {
            self.echoes.pop_front();
        }
        self.echoes.push_back(question);
        Ok(())
    }

    /// The next answer of this servo; late ones of others, and echoes, are skipped.
    fn hear(&mut self, id: u8) -> Result<Option<Packet>, LinkError> {
        let end = Instant::now() + ANSWER_WITHIN;
        loop {
            while let Some(packet) = self.waiting.pop_front() {
                if let Some(at) = self.echoes.iter().position(|question| *question == packet) {
                    self.echoes.remove(at);
                } else if packet.id == id {
                    self.answers = self.answers.wrapping_add(1);
                    return Ok(Some(packet));
                }
            }
            match self.port.read(end)? {
                Some(bytes) => self.waiting.extend(self.receiver.push(&bytes)),
                None => return Ok(None),
            }
        }
    }

    fn read(&mut self, id: u8, (address, length): Register) -> Result<Option<(u8, Vec<u8>)>, LinkError> {
        self.ask(id, packet::READ, vec![address, length])?;
        let answer = self.hear(id)?.filter(|answer| answer.parameters.len() == usize::from(length));
        Ok(answer.map(|answer| (answer.code, answer.parameters)))
    }

    fn write(
        &mut self,
        id: u8,
        (address, _): Register,
        values: &[u8],
        answered: bool,
    ) -> Result<Option<u8>, LinkError> {
        self.ask(id, packet::WRITE, [&[address], values].concat())?;
        if !answered {
            return Ok(Some(0));
        }
        Ok(self.hear(id)?.map(|answer| answer.code))
    }

    /// Looks at one servo before anything is told to it; its range, µrad, and whether it answers writes.
    fn find(&mut self, id: u8) -> Result<((i32, i32), bool), LinkError> {
        let path = format!("{}, servo {id}", self.port.path());
        let wrong = |reason: String| LinkError::Open { path: path.clone(), reason };
        let mut register = |register: Register, what: &str| -> Result<Vec<u8>, LinkError> {
            for _ in 0..3 {
                if let Some((_, values)) = self.read(id, register)? {
                    return Ok(values);
                }
            }
            Err(wrong(format!(
                "no answer to a question for its {what}; are id and baud rate right, is it powered?"
            )))
        };
        let model = register(packet::MODEL, "model")?;
        let model = u16::from_le_bytes([model[0], model[1]]);
        if !MODELS.contains(&model) {
            return Err(wrong(format!("model {model} is none of the known {MODELS:?}")));
        }
        let mode = register(packet::MODE, "mode")?[0];
        if mode != 0 {
            return Err(wrong(format!("operating mode {mode}, expected 0 (position)")));
        }
        let limits = register(packet::POSITION_LIMITS, "position limits")?;
        let [low, high] = [0, 2].map(|at| packet::signed(u16::from_le_bytes([limits[at], limits[at + 1]])));
        // both zero is the maker's way to say: none
        let (low, high) = if (low, high) == (0, 0) { (0, 4095) } else { (low, high) };
        let answers_writes = register(packet::ANSWERS_WRITES, "answer level")?[0] != 0;
        Ok(((packet::urad(low), packet::urad(high)), answers_writes))
    }
}

/// One servo, as last heard.
#[derive(Clone, Debug)]
struct BusServo {
    id: u8,
    sense: Sense,
    between: [Instant; 2],
    questions: Questions,
    /// Error bits of its last answer.
    error: u8,
    answers_writes: bool,
    /// Torque was switched on since it was last to be off: should it vanish, it was the servo that dropped it.
    switched_on: bool,
}

impl BusServo {
    fn take(&mut self, answer: Option<&Packet>) {
        self.sense.reading = Reading::Missing;
        let Some(answer) = answer else { return };
        let bytes = &answer.parameters;
        let word = |at: usize| packet::signed(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        self.error = answer.code | bytes[packet::STATUS_AT];
        self.sense.reading = Reading::Measured(packet::urad(word(0)));
        self.sense.supply_mv = u16::from(bytes[packet::VOLTAGE_AT]) * 100;
        self.sense.temperature_c = bytes[packet::TEMPERATURE_AT].min(i8::MAX as u8) as i8;
        self.sense.current_ma = (word(packet::CURRENT_AT).abs() * 13 / 2).min(i16::MAX.into()) as i16;
        if self.error & packet::ENCODER != 0 {
            self.sense.reading = Reading::Invalid;
        }
        if self.error & packet::VOLTAGE != 0 {
            self.sense.supply_mv = 0;
        }
        if self.error & packet::OVERHEAT != 0 {
            self.sense.temperature_c = i8::MAX;
        }
        if self.error & packet::OVERCURRENT != 0 {
            self.sense.current_ma = i16::MAX;
        }
        if self.error & packet::OVERLOAD != 0 {
            self.sense.torque = false;
        }
    }
}

struct Feetech {
    bus: Bus,
    servos: [BusServo; 2],
}

impl Feetech {
    /// A goal switches torque on by itself, so the first one is where the shaft stands.
    fn switch_on(&mut self, axis: usize, goal: &[u8]) -> Result<(), LinkError> {
        let BusServo { id, answers_writes, .. } = self.servos[axis];
        let took = self.bus.write(id, packet::GOAL_POSITION, goal, answers_writes)?;
        if took.is_some() && self.bus.write(id, packet::TORQUE_ENABLE, &[1], answers_writes)?.is_some() {
            let servo = &mut self.servos[axis];
            (servo.sense.torque, servo.switched_on) = (true, true);
        }
        Ok(())
    }
}

impl Actuators for Feetech {
    fn listen(&mut self, round: u32) -> Result<[Sample; 2], LinkError> {
        let ids = self.servos.each_ref().map(|servo| servo.id);
        let (address, length) = packet::MEASURED;
        let asked = Instant::now();
        self.servos.iter_mut().for_each(|servo| servo.questions.ask(asked));
        self.bus.ask(packet::BROADCAST, packet::SYNC_READ, [&[address, length], &ids[..]].concat())?;
        let mut answers = Vec::new();
        for id in ids {
            answers.push(self.bus.hear(id)?.filter(|answer| answer.parameters.len() == usize::from(length)));
        }
        let heard = Instant::now();
        for (servo, answer) in self.servos.iter_mut().zip(&answers) {
            if answer.is_some() {
                servo.between = servo.questions.answer(heard);
            }
            if round.is_multiple_of(SLOW_ROUNDS)
                && let Some((_, values)) = self.bus.read(servo.id, packet::TORQUE_ENABLE)?
            {
                servo.sense.torque = values[0] == 1;
            }
            servo.take(answer.as_ref());
        }
        Ok(self.servos.each_ref().map(|servo| Sample { sense: servo.sense, between: servo.between }))
    }

    fn tell(&mut self, setpoints: [Option<Setpoint>; 2]) -> Result<(), LinkError> {
        let mut goals = vec![packet::GOAL_POSITION.0, packet::GOAL_POSITION.1];
        for (axis, setpoint) in setpoints.into_iter().enumerate() {
            let servo = &mut self.servos[axis];
            let Some(setpoint) = setpoint else {
                servo.switched_on = false;
                continue;
            };
            let goal = packet::counts(setpoint.position_urad).to_le_bytes();
            if servo.sense.torque {
                servo.switched_on = true;
                goals.push(servo.id);
                goals.extend(goal);
            } else if !servo.switched_on {
                self.switch_on(axis, &goal)?;
            }
        }
        if goals.len() == 2 { Ok(()) } else { self.bus.ask(packet::BROADCAST, packet::SYNC_WRITE, goals) }
    }

    fn recover(&mut self) -> Result<(), LinkError> {
        for servo in self.servos.iter_mut().filter(|servo| servo.error != 0) {
            // its protection ends with the next switching on
            self.bus.write(servo.id, packet::TORQUE_ENABLE, &[0], servo.answers_writes)?;
            (servo.switched_on, servo.sense.torque) = (false, false);
        }
        Ok(())
    }

    fn leave(&mut self) {}

    fn errors(&self) -> [Vec<String>; 2] {
        [0, 1].map(|axis: usize| {
            let error = self.servos[axis].error;
            let known = packet::ERRORS.iter().filter(|(bit, _)| error & bit != 0);
            let known = known.map(|(_, name)| (*name).to_owned());
            let named = packet::ERRORS.iter().fold(0, |bits, (bit, _)| bits | bit);
            let others =
                (0..8).filter(|bit| error & !named & 1 << bit != 0).map(|bit| format!("error bit {bit}"));
            known.chain(others).collect()
        })
    }

    fn counters(&self) -> LinkCounters {
        LinkCounters {
            frames: self.bus.answers,
            checksum_errors: self.bus.receiver.damaged,
            ..LinkCounters::default()
        }
    }
}
