//! The state machine between two streams of bytes.

use firmware_protocol::inject::Inject;
use firmware_protocol::{
    Command, Config, Controller, Direction, Frame, Receiver, Report, ResetCause, Servo, can,
};

use crate::queue::Queue;

/// Bytes that wait for the line: what a rig says in a quarter of a second.
const OUT_BYTES: usize = 2048;
/// Longest time between two steps of the state machine, µs.
const STEP_US: u64 = 1000;

/// A rig on a serial line.
pub struct Rig<S> {
    controller: Controller<S, 2>,
    receiver: Receiver,
    node: u8,
    out: Out,
    next_us: u64,
}

/// Frames that wait for the serial line.
struct Out {
    bytes: Queue<OUT_BYTES>,
    node: u8,
    sequence: u8,
}

impl Out {
    /// A frame goes whole or not at all: a host that does not read loses frames, never the line's rhythm.
    fn say(&mut self, report: &Report) {
        let frame = Frame::report(self.sequence, self.node, report).encode();
        self.sequence = self.sequence.wrapping_add(1);
        if frame.bytes().len() <= self.bytes.room() {
            frame.bytes().iter().for_each(|byte| self.bytes.push(*byte));
        }
    }
}

impl<S: Servo> Rig<S> {
    /// A rig that starts now.
    pub fn new(config: Config<2>, servos: [S; 2], node: u8, reset: ResetCause, now_us: u64) -> Self {
        let out = Out { bytes: Queue::new(), node, sequence: 0 };
        out.bytes.push(0); // ends what a restart cut off: the first frame says why there was one
        Self {
            controller: Controller::new(config, servos, reset, now_us),
            receiver: Receiver::default(),
            node,
            out,
            next_us: now_us,
        }
    }

    /// Takes a byte from the line. A message from the part of the numbers that only simulated rigs know goes to `inject`.
    pub fn hear(&mut self, now_us: u64, byte: u8, inject: impl FnOnce(&mut Controller<S, 2>, Inject)) {
        let Some(frame) = self.receiver.push(byte) else { return };
        let mine = frame.id.node == self.node || frame.id.node == can::BROADCAST;
        if frame.id.direction != Direction::ToDevice || !mine {
            return;
        }
        if let Ok(command) = Command::decode(frame.id.message, frame.data()) {
            self.controller.handle(now_us, &command, &mut |report| self.out.say(&report));
        } else if let Ok(wanted) = Inject::decode(frame.id.message, frame.data()) {
            inject(&mut self.controller, wanted);
        }
    }

    /// Runs the state machine when it is time; whether it did.
    pub fn step(&mut self, now_us: u64) -> bool {
        let due = now_us >= self.next_us;
        if due {
            self.next_us = now_us + STEP_US;
            self.controller.step(now_us, &mut |report| self.out.say(&report));
        }
        due
    }

    /// Hands waiting bytes to the line until it is full.
    pub fn speak(&mut self, mut line: impl FnMut() -> bool, mut send: impl FnMut(u8)) {
        while line() {
            match self.out.bytes.pop() {
                Some(byte) => send(byte),
                None => return,
            }
        }
    }

    /// The state machine.
    pub fn controller(&mut self) -> &mut Controller<S, 2> {
        &mut self.controller
    }
}

/// Revision that was built, as the rig tells it.
pub const REVISION: u32 = match u32::from_str_radix(env!("OUTRIGGER_REVISION"), 16) {
    Ok(revision) => revision,
    Err(_) => 0,
};
