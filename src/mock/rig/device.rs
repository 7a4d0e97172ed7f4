//! The rig without its line: bytes in, frames out, time given.

use std::collections::VecDeque;

use firmware_protocol::config::Home;
use firmware_protocol::pulse::PulseServo;
use firmware_protocol::simulated::{AxisFault, SimulatedAxis};
use firmware_protocol::{
    Command, Config, Controller, Direction, Frame, Receiver, Report, ResetCause, Sense, Servo, Setpoint,
};

use super::MockFault;
use crate::base::rng::Rng;
use crate::drive::framing::Framing;
use crate::drive::slcan::SlcanReceiver;

/// Stream of the seed that places the axes at the start.
const PLACING: u64 = 0x5259_4731;

/// What drives an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisKind {
    /// A geared motor with an encoder on its output.
    #[default]
    Measured,
    /// A hobby servo driven by pulses, which measures nothing.
    Pulse,
}

/// A mock rig's make.
#[derive(Clone, Debug)]
pub struct MockConfig {
    /// What its firmware allows.
    pub firmware: Config<2>,
    /// Its node number.
    pub node: u8,
    /// What drives its axes.
    pub kind: AxisKind,
    /// Whether a CAN adapter with the LAWICEL text protocol sits between the line and the rig.
    pub slcan: bool,
    /// Where the axes stand at the start, µrad; from the seed when absent.
    pub start_urad: Option<[i32; 2]>,
    /// The encoders count from where they were switched on, and each axis has a switch that is closed at and below this
    /// angle, µrad; absolute encoders when absent.
    pub home_switch_urad: Option<i32>,
    /// The encoders sit before the gears' play.
    pub encoder_on_motor: bool,
}

impl Default for MockConfig {
    /// A mirrored pair.
    fn default() -> Self {
        let firmware = Config::mirrored_pair(0x4F55_5452_4947_0001);
        Self {
            firmware,
            node: 1,
            kind: AxisKind::Measured,
            slcan: false,
            start_urad: None,
            home_switch_urad: None,
            encoder_on_motor: false,
        }
    }
}

impl MockConfig {
    /// The same make with encoders that count from the start and switches at and below an angle, µrad.
    pub fn with_home_switches(mut self, at_urad: i32) -> Self {
        self.home_switch_urad = Some(at_urad);
        self.firmware.axes.iter_mut().for_each(|axis| axis.home = Home::switch_below(at_urad));
        self
    }

    /// The same make with encoders before the gears' play.
    pub fn with_encoders_on_motors(mut self) -> Self {
        self.encoder_on_motor = true;
        let play_urad = SimulatedAxis::new(0, 0, 0).backlash_urad;
        self.firmware.axes.iter_mut().for_each(|axis| axis.lost_motion_urad = play_urad);
        self
    }

    /// The same make, another rig: the low 16 bits of its unique number.
    pub(crate) fn of_number(mut self, number: u64) -> Self {
        self.firmware.uid = self.firmware.uid & !0xFFFF | number & 0xFFFF;
        self
    }
}

/// One axis of a mock rig.
#[derive(Clone, Debug)]
pub enum MockAxis {
    /// With an encoder.
    Measured(Box<SimulatedAxis>),
    /// Without.
    Pulse(PulseServo),
}

impl MockAxis {
    /// The same with power again: an encoder that counts begins at zero.
    fn switched_on(self, config: &MockConfig) -> Self {
        match (self, config.home_switch_urad) {
            (Self::Measured(axis), Some(at_urad)) => {
                Self::Measured(Box::new(axis.counting_from_start(at_urad)))
            }
            (axis, _) => axis,
        }
    }
}

impl Servo for MockAxis {
    fn sense(&mut self, now_us: u64) -> Sense {
        match self {
            Self::Measured(axis) => axis.sense(now_us),
            Self::Pulse(servo) => servo.sense(now_us),
        }
    }

    fn drive(&mut self, now_us: u64, setpoint: Setpoint) {
        match self {
            Self::Measured(axis) => axis.drive(now_us, setpoint),
            Self::Pulse(servo) => servo.drive(now_us, setpoint),
        }
    }

    fn range_urad(&self) -> (i32, i32) {
        match self {
            Self::Measured(axis) => axis.range_urad(),
            Self::Pulse(servo) => servo.range_urad(),
        }
    }
}

/// A rig: the state machine that firmware runs, on simulated axes.
pub struct MockDevice {
    config: MockConfig,
    controller: Option<Controller<MockAxis, 2>>,
    framing: Framing,
    adapter: Option<Adapter>,
    sequence: u8,
    wrong_id: bool,
    late_us: u64,
    answers: Vec<Report>,
    waiting: VecDeque<(u64, Vec<u8>)>,
}

impl MockDevice {
    /// A rig that is switched on now.
    pub(crate) fn new(config: MockConfig, seed: u64, now_us: u64) -> Self {
        let mut rng = Rng::new(seed, PLACING);
        let axes = [0, 1].map(|axis| {
            let chosen = rng.between(-0.2, 0.2) * 1e6;
            let start_urad = config.start_urad.map_or(chosen as i32, |start| start[axis]);
            match config.kind {
                AxisKind::Measured => {
                    let mut axis = SimulatedAxis::new(rng.bits(), start_urad, now_us);
                    axis.encoder_on_motor = config.encoder_on_motor;
                    MockAxis::Measured(Box::new(axis)).switched_on(&config)
                }
                AxisKind::Pulse => MockAxis::Pulse(PulseServo::standard()),
            }
        });
        let controller = Some(Controller::new(config.firmware, axes, ResetCause::PowerOn, now_us));
        let adapter = config.slcan.then(Adapter::default);
        Self {
            framing: framing(config.slcan),
            adapter,
            config,
            controller,
            sequence: 0,
            wrong_id: false,
            late_us: 0,
            answers: Vec::new(),
            waiting: VecDeque::new(),
        }
    }

    /// Breaks something. A hang-up is the line's business and does nothing here.
    pub(crate) fn inject(&mut self, now_us: u64, fault: MockFault) {
        match fault {
            MockFault::Axis(axis, fault) => self.with_axis(axis, |plant| plant.inject(fault)),
            MockFault::Repair(axis) => {
                let fresh = SimulatedAxis::new(0, 0, 0);
                self.with_axis(axis, |plant| {
                    plant.repair(fresh.backlash_urad);
                    plant.inject(AxisFault::Overheat(-1));
                });
            }
            MockFault::Reboot => {
                if let Some(old) = self.controller.take() {
                    let axes = old.into_servos().map(|axis| axis.switched_on(&self.config));
                    let firmware = self.config.firmware;
                    self.controller = Some(Controller::new(firmware, axes, ResetCause::BrownOut, now_us));
                }
                self.framing = framing(self.config.slcan);
                self.sequence = 0;
                self.waiting.clear();
            }
            MockFault::Late(ms) => self.late_us = ms * 1000,
            MockFault::WrongId(wrong) => self.wrong_id = wrong,
            MockFault::Switch { closed } => {
                self.controller.iter_mut().for_each(|controller| controller.set_local_switch(closed));
            }
            MockFault::HangUp => {}
        }
    }

    /// Where the axes really are, µrad: what no encoder tells. `None` for axes that simulate no shaft.
    pub(crate) fn true_positions_urad(&mut self) -> [Option<i32>; 2] {
        let mut positions = [None; 2];
        for (axis, position) in positions.iter_mut().enumerate() {
            self.with_axis(axis, |plant| *position = Some(plant.true_position_urad()));
        }
        positions
    }

    /// Whether the rig may move.
    pub(crate) fn armed(&self) -> bool {
        self.controller.as_ref().is_some_and(|controller| controller.armed())
    }

    fn with_axis(&mut self, axis: usize, mut change: impl FnMut(&mut SimulatedAxis)) {
        let servo = self.controller.as_mut().and_then(|controller| controller.servo_mut(axis));
        if let Some(MockAxis::Measured(plant)) = servo {
            change(plant);
        }
    }

    /// Takes bytes from the line.
    pub(crate) fn take(&mut self, now_us: u64, bytes: &[u8]) {
        let Some(controller) = &mut self.controller else { return };
        if let Some(adapter) = &mut self.adapter {
            self.waiting
                .extend(bytes.iter().filter_map(|byte| adapter.answer(*byte)).map(|answer| (now_us, answer)));
        }
        for frame in bytes.iter().filter_map(|byte| self.framing.push(*byte)) {
            let id = frame.id;
            let mine = id.node == self.config.node || id.node == firmware_protocol::can::BROADCAST;
            if id.direction != Direction::ToDevice || !mine {
                continue;
            }
            // a message that means nothing is dropped, as the host repeats what matters
            if let Ok(command) = Command::decode(id.message, frame.data()) {
                controller.handle(now_us, &command, &mut |report| self.answers.push(report));
            }
        }
    }

    /// Runs until a time; frames for the line are appended to `out`.
    pub(crate) fn step(&mut self, now_us: u64, out: &mut Vec<Vec<u8>>) {
        if let Some(controller) = &mut self.controller {
            controller.step(now_us, &mut |report| self.answers.push(report));
        }
        let node = if self.wrong_id { self.config.node + 1 } else { self.config.node };
        for report in self.answers.drain(..) {
            let frame = Frame::report(self.sequence, node, &report);
            self.sequence = self.sequence.wrapping_add(1);
            self.waiting.push_back((now_us + self.late_us, self.framing.encode(&frame)));
        }
        while self.waiting.front().is_some_and(|(due_us, _)| *due_us <= now_us) {
            out.extend(self.waiting.pop_front().map(|(_, bytes)| bytes));
        }
    }
}

fn framing(slcan: bool) -> Framing {
    if slcan { Framing::Slcan(SlcanReceiver::default()) } else { Framing::Stuffed(Receiver::default()) }
}

/// What a CAN adapter says by itself: yes and no.
#[derive(Clone, Debug, Default)]
struct Adapter {
    first: Option<u8>,
    open: bool,
}

impl Adapter {
    fn answer(&mut self, byte: u8) -> Option<Vec<u8>> {
        if byte != b'\r' {
            self.first.get_or_insert(byte);
            return None;
        }
        let no = vec![0x07];
        let yes = vec![b'\r'];
        Some(match self.first.take() {
            None => yes,
            Some(b'C') => {
                self.open = false;
                yes
            }
            Some(b'S') if !self.open => yes,
            Some(b'O') if !self.open => {
                self.open = true;
                yes
            }
            Some(b'T') if self.open => b"Z\r".to_vec(),
            Some(_) => no,
        })
    }
}
