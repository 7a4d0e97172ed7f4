//! Actuators without a rig's firmware: the host runs the one state machine itself and drives them over their bus.
//!
//! [`HostedLink`] speaks the rig's own messages, so everything above it stays the same.

use std::collections::VecDeque;
use std::sync::mpsc::{
    Receiver, RecvTimeoutError, Sender, SyncSender, TryRecvError, TrySendError, channel, sync_channel,
};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use firmware_protocol::config::Home;
use firmware_protocol::{
    AxisConfig, Command, Config, Controller, Direction, Frame, LinkCounters, Order, Reading, Report,
    ResetCause, Sense, Servo, Setpoint, State,
};

use super::{Link, LinkError, Received};
use crate::live::clocks::host::steady_now_ns;

mod first_move;
mod questions;

pub(super) use first_move::Witness;
pub(super) use questions::Questions;

/// Shortest time between two rounds on the bus.
const ROUND: Duration = Duration::from_millis(5);
/// The state machine's set points go on by no more than this at once.
const LONGEST_STEP: Duration = Duration::from_millis(20);
const WAITING_FRAMES: usize = 4096;
/// Rounds in which actuators that were reset get their torque back and are seen to have it.
const RECOVERY_ROUNDS: u32 = 8;

/// What an actuator reported, and between which times its encoder was sampled: the question left, the answer was there. The
/// state machine judges motion by these, so a round that took long elsewhere is no leap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub sense: Sense,
    pub between: [Instant; 2],
}

/// A pair of actuators on a bus.
pub(super) trait Actuators: Send + 'static {
    /// Reads what each measures; what did not answer is [`Reading::Missing`]. Rounds count up.
    fn listen(&mut self, round: u32) -> Result<[Sample; 2], LinkError>;

    /// Tells each that is to drive its shaft where to be, and switches its torque on if need be.
    fn tell(&mut self, setpoints: [Option<Setpoint>; 2]) -> Result<(), LinkError>;

    /// Where each shaft stands by a source that the unit of the goals has no part in.
    fn witnesses(&mut self) -> Result<[Option<Witness>; 2], LinkError> {
        Ok([None; 2])
    }

    /// What a device says of its unit, in words; empty where that is fixed.
    fn units(&self, _axis: usize) -> String {
        String::new()
    }

    /// Takes away what the devices latched by themselves: the operator clears a fault.
    fn recover(&mut self) -> Result<(), LinkError>;

    /// The program leaves in peace: the actuators hold, and no watchdog of theirs bites.
    fn leave(&mut self);

    /// Errors that each device tells of itself, in words.
    fn errors(&self) -> [Vec<String>; 2];

    /// Frames and damage so far.
    fn counters(&self) -> LinkCounters;
}

/// What a kind of actuator adds to the usual limits.
pub(super) struct Make {
    pub uid: u64,
    /// Its own lowest and highest angle, µrad.
    pub ranges_urad: [(i32, i32); 2],
    /// Largest error of the encoders' own scale, µrad.
    pub accuracy_urad: i32,
    /// One count of each encoder, µrad.
    pub resolutions_urad: [i32; 2],
    /// Play that the encoder sees, µrad.
    pub play_urad: i32,
    /// Play between encoder and load, µrad.
    pub lost_motion_urad: i32,
    /// Supply below which each is at fault, mV.
    pub supply_minimum_mv: [u16; 2],
    /// How each comes to be trusted.
    pub homes: [Home; 2],
}

/// Counts between two readings of a shaft at rest.
const NOISE_COUNTS: i32 = 5;

impl Make {
    /// The configuration of one axis for the state machine.
    fn axis(&self, axis: usize) -> AxisConfig {
        let usual = AxisConfig::default();
        let (low, high) = self.ranges_urad[axis];
        AxisConfig {
            minimum_urad: usual.minimum_urad.max(low),
            maximum_urad: usual.maximum_urad.min(high),
            accuracy_urad: self.accuracy_urad,
            resolution_urad: self.resolutions_urad[axis],
            lost_motion_urad: self.lost_motion_urad,
            supply_minimum_mv: self.supply_minimum_mv[axis],
            jump_urad: NOISE_COUNTS * self.resolutions_urad[axis] + self.play_urad,
            home: self.homes[axis],
            // nothing moves after three questions without an answer, so a device (or what simulates it) may be away for this
            // long before it is a fault
            missing_us: 250_000,
            // a shaft that somebody turns by hand is left alone until the rig is armed
            holds_when_idle: false,
            ..usual
        }
    }
}

/// One actuator, with its last reading and its set point.
#[derive(Clone, Copy, Debug)]
struct Actuator {
    sense: Sense,
    /// Its last reading, µrad.
    measured_urad: Option<i32>,
    setpoint: Option<Setpoint>,
    range_urad: (i32, i32),
}

impl Servo for Actuator {
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

/// A pair of actuators on a bus, as a rig.
pub struct HostedLink {
    name: String,
    commands: Option<Sender<Frame>>,
    frames: Receiver<Result<Received, LinkError>>,
    shared: Arc<Mutex<Shared>>,
    thread: Option<JoinHandle<()>>,
    dead: Option<LinkError>,
}

#[derive(Default)]
struct Shared {
    counters: LinkCounters,
    errors: [Vec<String>; 2],
    busy: bool,
}

impl HostedLink {
    pub(super) fn start(name: String, actuators: impl Actuators, make: &Make) -> Result<Self, LinkError> {
        let mut config = Config::<2> { uid: make.uid, ..Config::default() };
        config.axes = [make.axis(0), make.axis(1)];
        let servos = make.ranges_urad.map(|range_urad| Actuator {
            sense: Sense::UNREAD,
            measured_urad: None,
            setpoint: None,
            range_urad,
        });
        let controller = Controller::new(config, servos, ResetCause::PowerOn, 0);
        let (command_sender, commands) = channel();
        let (sender, frames) = sync_channel(WAITING_FRAMES);
        let shared: Arc<Mutex<Shared>> = Arc::default();
        let worker = Worker {
            name: name.clone(),
            started: Instant::now(),
            noise_urad: config.axes.map(|axis| axis.jump_urad),
            lead_urad: config.axes.map(|axis| axis.following_urad),
            waiting: VecDeque::new(),
            sequence: 0,
            stepped: [Instant::now(); 2],
            is_tried: false,
            actuators,
            controller,
            commands,
            sender,
            shared: shared.clone(),
            reports: Vec::new(),
            recovered: None,
        };
        let thread = std::thread::Builder::new()
            .name("servo bus".into())
            .spawn(move || worker.run())
            .map_err(|error| LinkError::Open { path: name.clone(), reason: error.to_string() })?;
        let commands = Some(command_sender);
        Ok(Self { name, commands, frames, shared, thread: Some(thread), dead: None })
    }

    fn shared(&self) -> std::sync::MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct Worker<A> {
    name: String,
    /// The state machine's time begins here: its stamps are short.
    started: Instant,
    actuators: A,
    controller: Controller<Actuator, 2>,
    commands: Receiver<Frame>,
    sender: SyncSender<Result<Received, LinkError>>,
    shared: Arc<Mutex<Shared>>,
    reports: Vec<Report>,
    /// The last order that reset the devices.
    recovered: Option<u16>,
    /// Motion of each axis that is none: noise and play.
    noise_urad: [i32; 2],
    /// How far a goal may lie ahead of its shaft. Farther would be a fault soon, and a shaft goes no farther when its host dies.
    lead_urad: [i32; 2],
    /// Commands that came during the first move.
    waiting: VecDeque<Frame>,
    sequence: u8,
    /// When the state machine made its last two steps.
    stepped: [Instant; 2],
    /// The first move went as ordered.
    is_tried: bool,
}

/// Why the conversation ends.
enum End {
    Link(LinkError),
    HostLeft,
}

impl From<LinkError> for End {
    fn from(error: LinkError) -> Self {
        Self::Link(error)
    }
}

impl<A: Actuators> Worker<A> {
    fn run(mut self) {
        for round in 0u32.. {
            let started_us = self.now_us();
            match self.round(round) {
                Ok(()) => {}
                Err(End::HostLeft) => return self.actuators.leave(),
                Err(End::Link(error)) => {
                    let _ = self.sender.send(Err(error)); // the host may be gone
                    return;
                }
            }
            let used = Duration::from_micros(self.now_us() - started_us);
            let [before, stepped] = self.stepped;
            // set points went on by all the time since the step before: a shaft that follows at once is to have a part of it,
            // or its next reading would count as a leap
            let catching_up = stepped.duration_since(before).min(LONGEST_STEP) / 3;
            std::thread::sleep(ROUND.saturating_sub(used).max(catching_up.saturating_sub(stepped.elapsed())));
        }
    }

    fn round(&mut self, round: u32) -> Result<(), End> {
        self.listen(round)?;
        while let Some(frame) = self.next_command()? {
            self.execute(&frame)?;
        }
        self.step();
        // received frames first: sending may take a while
        self.send_reports()?;
        self.set_busy(false);
        Ok(self.tell()?)
    }

    fn next_command(&mut self) -> Result<Option<Frame>, End> {
        if let Some(frame) = self.waiting.pop_front() {
            return Ok(Some(frame));
        }
        match self.commands.try_recv() {
            Ok(frame) => Ok(Some(frame)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(End::HostLeft),
        }
    }

    fn send_reports(&mut self) -> Result<(), End> {
        for report in std::mem::take(&mut self.reports) {
            self.sequence = self.sequence.wrapping_add(1);
            let received =
                Received { time_ns: steady_now_ns(), frame: Frame::report(self.sequence, 1, &report) };
            // a full queue drops: the host does not read, and positions come again
            if let Err(TrySendError::Disconnected(_)) = self.sender.try_send(Ok(received)) {
                return Err(End::HostLeft);
            }
        }
        Ok(())
    }

    fn execute(&mut self, frame: &Frame) -> Result<(), End> {
        let Ok(command) = Command::decode(frame.id.message, frame.data()) else { return Ok(()) };
        if frame.id.direction != Direction::ToDevice {
            return Ok(());
        }
        if let Command::Order { id, order: Order::ClearFault { .. } } = command
            && self.recovered != Some(id)
        {
            self.recovered = Some(id); // its repeats are not to reset anything again
            // what a device latched by itself is reset first, or the cause would remain for ever
            self.set_busy(true);
            self.actuators.recover()?;
            for _ in 0..RECOVERY_ROUNDS {
                self.listen(0)?;
                self.step();
                self.tell()?;
            }
        }
        let planned = self.planned_move(&command);
        let (now_us, reports) = (self.now_us(), &mut self.reports);
        self.controller.handle(now_us, &command, &mut |report| reports.push(report));
        if let Some(planned) = planned.filter(|_| self.controller.state() == State::Moving && !self.is_tried)
        {
            self.send_reports()?;
            self.set_busy(true);
            self.try_scale(planned)?;
        }
        Ok(())
    }

    fn set_busy(&self, busy: bool) {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner).busy = busy;
    }

    fn listen(&mut self, round: u32) -> Result<(), LinkError> {
        let samples = self.actuators.listen(round)?;
        for (axis, Sample { mut sense, between }) in samples.into_iter().enumerate() {
            sense.sampled_us = between.map(|stamp| self.since_start_us(stamp));
            let Some(servo) = self.controller.servo_mut(axis) else { continue };
            servo.sense = sense;
            if let Reading::Measured(urad) = sense.reading {
                servo.measured_urad = Some(urad);
            }
        }
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.counters = self.actuators.counters();
        shared.errors = self.actuators.errors();
        Ok(())
    }

    fn step(&mut self) {
        self.stepped = [self.stepped[1], Instant::now()];
        let (now_us, reports) = (self.now_us(), &mut self.reports);
        self.controller.step(now_us, &mut |report| reports.push(report));
    }

    fn tell(&mut self) -> Result<(), LinkError> {
        let mut setpoints = [None; 2];
        for (axis, goal) in setpoints.iter_mut().enumerate() {
            let Some(servo) = self.controller.servo_mut(axis) else { continue };
            let Some(mut setpoint) = servo.setpoint.filter(|setpoint| setpoint.torque) else { continue };
            if let (false, Some(urad)) = (setpoint.home, servo.measured_urad) {
                let lead_urad = self.lead_urad[axis];
                let (low, high) = (urad.saturating_sub(lead_urad), urad.saturating_add(lead_urad));
                setpoint.position_urad = setpoint.position_urad.clamp(low, high);
            }
            *goal = Some(setpoint);
        }
        self.actuators.tell(setpoints)
    }

    fn now_us(&self) -> u64 {
        self.since_start_us(Instant::now())
    }

    fn since_start_us(&self, stamp: Instant) -> u64 {
        stamp.saturating_duration_since(self.started).as_micros() as u64
    }
}

impl Link for HostedLink {
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
        steady_now_ns()
    }

    fn counters(&self) -> LinkCounters {
        self.shared().counters
    }

    fn device_errors(&self, axis: usize) -> Vec<String> {
        self.shared().errors.get(axis).cloned().unwrap_or_default()
    }

    fn is_busy(&self) -> bool {
        self.shared().busy
    }

    fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for HostedLink {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // ends within one round
        }
    }
}
