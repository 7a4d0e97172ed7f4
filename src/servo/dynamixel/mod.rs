//! Dynamixel X servos as a rig: the host runs the one state machine itself, on actuators at the end of a bus.
//!
//! [`DynamixelLink`] speaks the rig's own messages, so everything above it stays the same. The servos' own bus watchdog
//! stops them when this program is gone; torque is switched on by arming and never off.

use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use firmware_protocol::{
    AxisConfig, Command, Config, Controller, Direction, Frame, LinkCounters, Reading, Report, ResetCause,
    Sense, Servo, Setpoint,
};

use super::link::Clock;
use super::{Link, LinkError, Received};

mod bus;
pub(crate) mod packet;
pub(crate) mod table;

use bus::Bus;
use table::hardware_error;

/// Shortest time between two rounds on the bus.
const ROUND: Duration = Duration::from_millis(5);
/// Rounds between two looks at torque switch and hardware error.
const SLOW_ROUNDS: u32 = 10;
/// Silence after which a servo stops by itself, in its unit of 20 ms.
const BUS_WATCHDOG_20_MS: u8 = 25;
const WAITING_FRAMES: usize = 4096;

/// One servo, as last heard and as told.
#[derive(Clone, Copy, Debug)]
struct BusServo {
    sense: Sense,
    setpoint: Option<Setpoint>,
    /// What its hardware error register said last.
    error: u8,
    /// Torque was switched on since it was last to be off: should it vanish, it was the servo that dropped it.
    switched_on: bool,
    range_urad: (i32, i32),
}

impl Servo for BusServo {
    fn sense(&mut self, _now_us: u64) -> Sense {
        self.sense
    }

    fn drive(&mut self, _now_us: u64, setpoint: Setpoint) {
        self.setpoint = Some(setpoint);
    }

    fn range_urad(&self) -> (i32, i32) {
        self.range_urad
    }
}

/// A pair of servos on a bus, as a rig.
pub struct DynamixelLink {
    name: String,
    commands: Option<Sender<Frame>>,
    frames: Receiver<Result<Received, LinkError>>,
    counters: Arc<Mutex<LinkCounters>>,
    clock: Clock,
    thread: Option<JoinHandle<()>>,
    dead: Option<LinkError>,
}

impl DynamixelLink {
    /// Opens the bus and finds the two servos; the first is axis 0.
    pub fn open(path: &Path, baud: u32, ids: [u8; 2]) -> Result<Self, LinkError> {
        let mut bus = Bus::open(path, baud)?;
        let [a, b] = [find(&mut bus, ids[0])?, find(&mut bus, ids[1])?];
        let clock = Clock::start();
        let mut config = Config::<2> { uid: u64::from(ids[0]) << 8 | u64::from(ids[1]), ..Config::default() };
        for (axis, servo) in config.axes.iter_mut().zip([a, b]) {
            let (low, high) = servo.range_urad;
            let usual = AxisConfig::default();
            *axis = AxisConfig {
                minimum_urad: usual.minimum_urad.max(low),
                maximum_urad: usual.maximum_urad.min(high),
                uncertainty_urad: 4363, // 0.25 degrees of play, e-Manual
                // a shaft that somebody turns by hand is left alone until the rig is armed
                holds_when_idle: false,
                ..usual
            };
        }
        let controller = Controller::new(config, [a, b], ResetCause::PowerOn, 0);
        let (command_sender, commands) = channel();
        let (sender, frames) = sync_channel(WAITING_FRAMES);
        let counters = Arc::new(Mutex::new(LinkCounters::default()));
        let name = format!("dynamixel:{}", bus.path());
        let started_ns = clock.now_ns();
        let worker =
            Worker { started_ns, bus, ids, controller, commands, sender, counters: counters.clone(), clock };
        let thread = std::thread::Builder::new()
            .name("dynamixel".into())
            .spawn(move || worker.run())
            .map_err(|error| LinkError::Open { path: name.clone(), reason: error.to_string() })?;
        Ok(Self {
            name,
            commands: Some(command_sender),
            frames,
            counters,
            clock,
            thread: Some(thread),
            dead: None,
        })
    }
}

/// Looks at one servo before anything is told to it.
fn find(bus: &mut Bus, id: u8) -> Result<BusServo, LinkError> {
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
    let sense = Sense {
        reading: Reading::Missing,
        torque: false,
        current_ma: 0,
        supply_mv: u16::MAX,
        temperature_c: 0,
    };
    Ok(BusServo {
        sense,
        setpoint: None,
        error: 0,
        switched_on: false,
        range_urad: (table::urad(low), table::urad(high)),
    })
}

fn int(bytes: &[u8]) -> i32 {
    bytes.try_into().map_or(0, i32::from_le_bytes)
}

struct Worker {
    /// The state machine's time begins here: its stamps are short.
    started_ns: u64,
    bus: Bus,
    ids: [u8; 2],
    controller: Controller<BusServo, 2>,
    commands: Receiver<Frame>,
    sender: SyncSender<Result<Received, LinkError>>,
    counters: Arc<Mutex<LinkCounters>>,
    clock: Clock,
}

impl Worker {
    fn run(mut self) {
        let mut sequence = 0u8;
        let mut reports = Vec::new();
        for round in 0u32.. {
            let started_us = self.now_us();
            let heard = self.listen(round);
            let now_us = self.now_us();
            loop {
                match self.commands.try_recv() {
                    Ok(frame) if frame.id.direction == Direction::ToDevice => {
                        if let Ok(command) = Command::decode(frame.id.message, frame.data()) {
                            self.controller.handle(now_us, &command, &mut |report| reports.push(report));
                        }
                    }
                    Ok(_) => {}
                    Err(std::sync::mpsc::TryRecvError::Empty) => break,
                    Err(std::sync::mpsc::TryRecvError::Disconnected) => return self.leave(),
                }
            }
            self.controller.step(now_us, &mut |report| reports.push(report));
            if let Err(error) = heard.and_then(|()| self.tell()) {
                let _ = self.sender.send(Err(error)); // nobody may be left to tell
                return;
            }
            for report in reports.drain(..) {
                sequence = sequence.wrapping_add(1);
                if !self.send(sequence, &report) {
                    return self.leave();
                }
            }
            let used = Duration::from_micros(self.now_us() - started_us);
            std::thread::sleep(ROUND.saturating_sub(used));
        }
    }

    fn now_us(&self) -> u64 {
        (self.clock.now_ns() - self.started_ns) / 1000
    }

    fn send(&self, sequence: u8, report: &Report) -> bool {
        let frame = Frame::report(sequence, 1, report);
        let mut counters = self.counters.lock().unwrap_or_else(PoisonError::into_inner);
        counters.frames = self.bus.answers;
        counters.checksum_errors = self.bus.damaged();
        let received = Received { time_ns: self.clock.now_ns(), frame };
        !matches!(self.sender.try_send(Ok(received)), Err(TrySendError::Disconnected(_)))
    }

    /// Reads what every servo measures.
    fn listen(&mut self, round: u32) -> Result<(), LinkError> {
        let measured = self.bus.sync_read(&self.ids, table::MEASURED)?;
        let slow = if round.is_multiple_of(SLOW_ROUNDS) {
            self.bus.sync_read(&self.ids, table::TORQUE_TO_ERROR)?
        } else {
            vec![None; self.ids.len()]
        };
        for (axis, (measured, slow)) in measured.iter().zip(&slow).enumerate() {
            let Some(servo) = self.controller.servo_mut(axis) else { continue };
            servo.sense.reading = Reading::Missing;
            if let Some(bytes) = measured {
                let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
                let position = int(&bytes[table::POSITION_AT..table::POSITION_AT + 4]);
                let current = i32::from(word(table::CURRENT_AT) as i16).abs() * 269 / 100;
                servo.sense.reading = Reading::Measured(table::urad(position));
                servo.sense.current_ma = current.min(i16::MAX.into()) as i16;
                servo.sense.supply_mv = word(table::VOLTAGE_AT).saturating_mul(100);
                servo.sense.temperature_c = bytes[table::TEMPERATURE_AT].min(i8::MAX as u8) as i8;
            }
            if let Some(bytes) = slow {
                servo.sense.torque = bytes[0] == 1;
                servo.error = bytes[usize::from(table::HARDWARE_ERROR.0 - table::TORQUE_TO_ERROR.0)];
            }
            if servo.error & hardware_error::ENCODER != 0 {
                servo.sense.reading = Reading::Invalid;
            }
            if servo.error & hardware_error::OVERHEAT != 0 {
                servo.sense.temperature_c = i8::MAX;
            }
            if servo.error & hardware_error::VOLTAGE != 0 {
                servo.sense.supply_mv = 0;
            }
        }
        Ok(())
    }

    /// Tells every servo that is to drive its shaft where to be, and switches its torque on if need be.
    fn tell(&mut self) -> Result<(), LinkError> {
        let mut goals = Vec::new();
        for (axis, id) in self.ids.into_iter().enumerate() {
            let Some(servo) = self.controller.servo_mut(axis) else { continue };
            let Some(setpoint) = servo.setpoint.filter(|setpoint| setpoint.torque) else {
                servo.switched_on = false;
                continue;
            };
            let goal = table::counts(setpoint.position_urad).to_le_bytes();
            if servo.sense.torque {
                servo.switched_on = true;
                goals.push((id, goal.to_vec()));
            } else if !servo.switched_on
                // the goal first: with torque on, the shaft goes where the goal register happens to say
                && self.bus.write(id, table::GOAL_POSITION, &goal)?
                && self.bus.write(id, table::TORQUE_ENABLE, &[1])?
                && self.bus.write(id, table::BUS_WATCHDOG, &[BUS_WATCHDOG_20_MS])?
                && let Some(servo) = self.controller.servo_mut(axis)
            {
                (servo.sense.torque, servo.switched_on) = (true, true);
            }
        }
        if goals.is_empty() { Ok(()) } else { self.bus.sync_write(table::GOAL_POSITION, &goals) }
    }

    /// The servos hold, and their watchdog does not bite for a program that left in peace.
    fn leave(&mut self) {
        for id in self.ids {
            let _ = self.bus.write(id, table::BUS_WATCHDOG, &[0]); // a bus that is gone needs no farewell
        }
    }
}

impl Link for DynamixelLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        let sent = self.commands.as_ref().is_some_and(|commands| commands.send(*frame).is_ok());
        match &self.dead {
            Some(error) => Err(error.clone()),
            // the thread ended: its last word says why
            None if !sent => self.receive(Duration::ZERO).map(drop),
            None => Ok(()),
        }
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        if let Some(error) = &self.dead {
            return Err(error.clone());
        }
        let error = match self.frames.recv_timeout(wait) {
            Ok(Ok(received)) => return Ok(Some(received)),
            Err(RecvTimeoutError::Timeout) => return Ok(None),
            Ok(Err(error)) => error,
            Err(RecvTimeoutError::Disconnected) => {
                LinkError::HungUp { path: self.name.clone(), reason: "the bus' thread ended".into() }
            }
        };
        self.dead = Some(error.clone());
        Err(error)
    }

    fn now_ns(&self) -> u64 {
        self.clock.now_ns()
    }

    fn counters(&self) -> LinkCounters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for DynamixelLink {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // ends within one round
        }
    }
}
