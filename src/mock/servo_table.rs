//! Registers of mock servos on a bus.

use firmware_protocol::simulated::SimulatedAxis;

use crate::drive::bus_servos::{Register, urad};

/// What a make of servos does with bytes.
pub(super) trait MockBus: Send {
    /// Takes bytes; the answers, each with the register of which the question was.
    fn hear(&mut self, now_us: u64, bytes: &[u8]) -> Vec<(u16, Vec<u8>)>;

    /// Lets time pass.
    fn step(&mut self, now_us: u64);

    /// A servo's registers.
    fn table(&mut self, servo: usize) -> Option<&mut Table>;
}

/// Registers over a simulated axis.
pub(super) struct Table {
    pub axis: SimulatedAxis,
    pub bytes: [u8; TABLE_BYTES],
    pub position: i32,
    pub goals: Vec<GoalWrite>,
}

impl Table {
    pub(crate) fn new(seed: u64, position: i32) -> Self {
        let mut axis = SimulatedAxis::new(seed + 1, urad(position), 0);
        axis.range_urad = (urad(-8192), urad(12_288));
        axis.encoder_step_urad = 1; // its registers count 4096 to the turn
        Self { axis, bytes: [0; TABLE_BYTES], position, goals: Vec::new() }
    }

    pub(crate) fn set(&mut self, (address, length): Register, value: i32) {
        let (start, length) = (usize::from(address), usize::from(length));
        self.bytes[start..start + length].copy_from_slice(&value.to_le_bytes()[..length]);
    }

    pub(crate) fn get(&self, (address, length): Register) -> i32 {
        let mut bytes = [0; 4];
        let (start, length) = (usize::from(address), usize::from(length));
        bytes[..length].copy_from_slice(&self.bytes[start..start + length]);
        i32::from_le_bytes(bytes)
    }

    pub(crate) fn slice(&self, address: u16, length: u16) -> Option<&[u8]> {
        self.bytes.get(usize::from(address)..usize::from(address) + usize::from(length))
    }

    pub(crate) fn keep_goal(&mut self, goal: i32, torque: bool) {
        self.goals.push(GoalWrite { goal, position: self.position, torque });
    }
}

/// Registers of a servo.
const TABLE_BYTES: usize = 160;

/// A goal that a servo took.
#[derive(Clone, Copy, Debug)]
pub struct GoalWrite {
    /// The goal, counts.
    pub goal: i32,
    /// Where the shaft stood, counts.
    pub position: i32,
    /// Whether it was driven before.
    pub torque: bool,
}
