//! Dynamixel X servos behind a pty: registers over simulated axes, with the refusals and the shutdown of the real ones.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use firmware_protocol::simulated::{AxisFault, SimulatedAxis};
use firmware_protocol::{Reading, Servo, Setpoint};

use super::pty::Pty;
use crate::drive::dynamixel::packet::{BROADCAST, Packet, PacketReceiver, instruction};
use crate::drive::dynamixel::table;

/// Registers of a servo.
const TABLE_BYTES: usize = 160;
/// The first register that may be written with torque on: those before it are kept in EEPROM.
const FIRST_RAM: usize = 64;
/// Temperature at which a servo shuts down, °C.
const SHUTDOWN_C: i8 = 80;

/// Errors of an answer.
mod error {
    pub const INSTRUCTION: u8 = 2;
    pub const DATA_RANGE: u8 = 4;
    pub const DATA_LENGTH: u8 = 5;
    pub const ACCESS: u8 = 7;
    pub const ALERT: u8 = 0x80;
}

enum Message {
    Inject(usize, AxisFault),
    Close,
}

/// Mock servos in their own thread.
pub struct MockDynamixel {
    path: PathBuf,
    messages: Sender<Message>,
    thread: Option<JoinHandle<()>>,
}

impl MockDynamixel {
    /// Opens a pty with two servos of ids 1 and 2. Noise comes from the seed.
    pub fn start(seed: u64) -> io::Result<Self> {
        let pty = Pty::open()?;
        let path = pty.path.clone();
        let (messages, inbox) = channel();
        let servos = [1u8, 2].map(|id| MockServo::new(id, seed));
        let thread = std::thread::Builder::new()
            .name("mock dynamixel".into())
            .spawn(move || run(pty, &inbox, servos))?;
        Ok(Self { path, messages, thread: Some(thread) })
    }

    /// The device file to connect to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Breaks something in a servo, counted from 0.
    pub fn inject(&self, servo: usize, fault: AxisFault) {
        let _ = self.messages.send(Message::Inject(servo, fault)); // servos that are gone cannot break
    }
}

impl Drop for MockDynamixel {
    fn drop(&mut self) {
        let _ = self.messages.send(Message::Close);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn run(mut pty: Pty, inbox: &Receiver<Message>, mut servos: [MockServo; 2]) {
    let started = Instant::now();
    let mut receiver = PacketReceiver::default();
    let mut bytes = [0; 1024];
    loop {
        for message in inbox.try_iter() {
            match message {
                Message::Close => return,
                Message::Inject(servo, fault) => {
                    servos.get_mut(servo).into_iter().for_each(|servo| servo.axis.inject(fault));
                }
            }
        }
        let now_us = started.elapsed().as_micros() as u64;
        let Ok(count) = pty.read(&mut bytes) else { return };
        servos.iter_mut().for_each(|servo| servo.step(now_us));
        for packet in receiver.push(&bytes[..count]) {
            let mut answers: Vec<Packet> =
                servos.iter_mut().filter_map(|servo| servo.answer(now_us, &packet)).collect();
            if packet.instruction == instruction::SYNC_READ {
                // the first that was asked answers first
                answers.sort_by_key(|answer| packet.parameters[4..].iter().position(|id| *id == answer.id));
            }
            answers.iter().for_each(|answer| pty.write(&answer.encode()));
        }
        pty.wait_a_millisecond();
    }
}

/// One servo.
struct MockServo {
    id: u8,
    axis: SimulatedAxis,
    table: [u8; TABLE_BYTES],
    spoken_to_us: u64,
}

impl MockServo {
    fn new(id: u8, seed: u64) -> Self {
        let mut axis = SimulatedAxis::new(seed + u64::from(id), 50_000 * i32::from(id), 0);
        axis.range_urad = (-3_141_592, 3_140_058);
        axis.encoder_step_urad = 1; // its registers count 4096 to the turn
        let mut servo = Self { id, axis, table: [0; TABLE_BYTES], spoken_to_us: 0 };
        servo.set(table::OPERATING_MODE, 3);
        servo.set(table::MAX_POSITION, 4095);
        servo.set(table::GOAL_POSITION, table::counts(50_000 * i32::from(id)));
        servo.table[0..2].copy_from_slice(&1020u16.to_le_bytes()); // XM430-W350
        servo.table[6] = 1; // firmware version
        servo.table[7] = id;
        servo
    }

    fn set(&mut self, (address, length): table::Register, value: i32) {
        let (start, length) = (usize::from(address), usize::from(length));
        self.table[start..start + length].copy_from_slice(&value.to_le_bytes()[..length]);
    }

    fn get(&self, (address, length): table::Register) -> i32 {
        let mut bytes = [0; 4];
        let (start, length) = (usize::from(address), usize::from(length));
        bytes[..length].copy_from_slice(&self.table[start..start + length]);
        i32::from_le_bytes(bytes)
    }

    fn step(&mut self, now_us: u64) {
        let sense = self.axis.sense(now_us);
        let (from, _) = table::MEASURED;
        let Reading::Measured(position_urad) = sense.reading else {
            self.shut_down(table::hardware_error::ENCODER);
            return;
        };
        let at = |offset: usize, length| (from + offset as u16, length);
        self.set(at(table::CURRENT_AT, 2), i32::from(sense.current_ma) * 100 / 269);
        self.set(at(table::POSITION_AT, 4), table::counts(position_urad));
        self.set(at(table::VOLTAGE_AT, 2), i32::from(sense.supply_mv) / 100);
        self.set(at(table::TEMPERATURE_AT, 1), i32::from(sense.temperature_c));
        let torque = self.get(table::TORQUE_ENABLE) == 1;
        if sense.temperature_c > SHUTDOWN_C {
            self.shut_down(table::hardware_error::OVERHEAT);
        } else if torque && !sense.torque && self.axis.is_driven() {
            self.shut_down(1 << 5); // overload
        }
        let watchdog = self.get(table::BUS_WATCHDOG);
        if (1..=127).contains(&watchdog) && now_us - self.spoken_to_us > watchdog as u64 * 20_000 {
            self.set(table::BUS_WATCHDOG, 0xFF);
            self.set(table::GOAL_POSITION, table::counts(position_urad));
        }
        let torque = self.get(table::TORQUE_ENABLE) == 1;
        let position_urad = table::urad(self.get(table::GOAL_POSITION));
        let driven = Setpoint { torque, position_urad, current_limit_ma: 2000, ..Setpoint::default() };
        self.axis.drive(now_us, driven);
    }

    fn shut_down(&mut self, error: u8) {
        self.set(table::HARDWARE_ERROR, self.get(table::HARDWARE_ERROR) | i32::from(error));
        self.set(table::TORQUE_ENABLE, 0);
    }

    fn answer(&mut self, now_us: u64, packet: &Packet) -> Option<Packet> {
        let mine = packet.id == self.id;
        if packet.instruction == instruction::STATUS || !(mine || packet.id == BROADCAST) {
            return None;
        }
        self.spoken_to_us = now_us;
        let parameters = &packet.parameters[..];
        let word = |at: usize| {
            Some(usize::from(u16::from_le_bytes([*parameters.get(at)?, *parameters.get(at + 1)?])))
        };
        let (error, data) = match packet.instruction {
            instruction::PING => (0, vec![self.table[0], self.table[1], self.table[6]]),
            instruction::READ => match word(0).zip(word(2)) {
                Some((address, length)) => self.read(address, length),
                None => (error::DATA_LENGTH, vec![]),
            },
            instruction::WRITE => match word(0) {
                Some(address) => (self.write(address, &parameters[2..]), vec![]),
                None => (error::DATA_LENGTH, vec![]),
            },
            instruction::REBOOT => {
                self.set(table::TORQUE_ENABLE, 0);
                self.set(table::HARDWARE_ERROR, 0);
                self.set(table::BUS_WATCHDOG, 0);
                (0, vec![])
            }
            instruction::SYNC_READ => {
                let (address, length) = word(0).zip(word(2))?;
                if !parameters[4..].contains(&self.id) {
                    return None;
                }
                self.read(address, length)
            }
            instruction::SYNC_WRITE => {
                let (address, length) = word(0).zip(word(2))?;
                let mine = parameters[4..].chunks_exact(length + 1).find(|chunk| chunk[0] == self.id)?;
                self.write(address, &mine[1..]);
                return None;
            }
            _ => (error::INSTRUCTION, vec![]),
        };
        let alert = if self.get(table::HARDWARE_ERROR) == 0 { 0 } else { error::ALERT };
        let answers = mine || matches!(packet.instruction, instruction::PING | instruction::SYNC_READ);
        answers.then(|| Packet::new(self.id, instruction::STATUS, &[&[error | alert], &data[..]].concat()))
    }

    fn read(&self, address: usize, length: usize) -> (u8, Vec<u8>) {
        match self.table.get(address..address + length) {
            Some(bytes) => (0, bytes.to_vec()),
            None => (error::ACCESS, vec![]),
        }
    }

    fn write(&mut self, address: usize, values: &[u8]) -> u8 {
        let register = (address as u16, values.len() as u16);
        let torque = self.get(table::TORQUE_ENABLE) == 1;
        if values.is_empty() || address + values.len() > usize::from(table::MEASURED.0) {
            return error::ACCESS; // what is measured cannot be written
        }
        if address < FIRST_RAM && (torque || address < usize::from(table::OPERATING_MODE.0)) {
            return error::ACCESS;
        }
        if register == table::TORQUE_ENABLE && self.get(table::HARDWARE_ERROR) != 0 {
            return error::ACCESS; // after a shutdown only a reboot helps
        }
        if register == table::GOAL_POSITION {
            let goal = values.try_into().map_or(0, i32::from_le_bytes);
            let range = self.get(table::MIN_POSITION)..=self.get(table::MAX_POSITION);
            // a watchdog that bit keeps goals read-only
            if !range.contains(&goal) || self.get(table::BUS_WATCHDOG) == 0xFF {
                return error::DATA_RANGE;
            }
        }
        self.table[address..address + values.len()].copy_from_slice(values);
        0
    }
}
