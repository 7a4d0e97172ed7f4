//! Dynamixel X servos, with the refusals, the shutdown, the bus watchdog and the status return level of the real ones.

use firmware_protocol::{Reading, Servo, Setpoint};

use super::servo_table::{MockBus, Table};
use crate::drive::bus_servos::{BROADCAST, Register, TURN_COUNTS, counts, instruction, urad};
use crate::drive::dynamixel::packet::{Packet, PacketReceiver, STATUS};
use crate::drive::dynamixel::table;

/// The first register that may be written with torque on: those before it are in EEPROM.
const FIRST_RAM: u16 = 64;
/// Temperature at which a servo shuts down, °C.
const SHUTDOWN_C: i8 = 80;
const MAX_POSITION: Register = (48, 4);
const MIN_POSITION: Register = (52, 4);

/// Errors of an answer.
mod error {
    pub const INSTRUCTION: u8 = 2;
    pub const DATA_RANGE: u8 = 4;
    pub const DATA_LENGTH: u8 = 5;
    pub const ACCESS: u8 = 7;
    pub const ALERT: u8 = 0x80;
}

pub(super) struct DynamixelBus {
    receiver: PacketReceiver,
    servos: [MockServo; 2],
}

impl DynamixelBus {
    pub(crate) fn new([first, second]: [Table; 2]) -> Self {
        let servos = [MockServo::new(1, first), MockServo::new(2, second)];
        Self { receiver: PacketReceiver::default(), servos }
    }
}

impl MockBus for DynamixelBus {
    fn hear(&mut self, now_us: u64, bytes: &[u8]) -> Vec<(u16, Vec<u8>)> {
        let mut replies = Vec::new();
        for packet in self.receiver.push(bytes) {
            let mut answers: Vec<Packet> =
                self.servos.iter_mut().filter_map(|servo| servo.answer(now_us, &packet)).collect();
            if packet.instruction == instruction::SYNC_READ {
                // the first that was asked answers first
                answers.sort_by_key(|answer| packet.parameters[4..].iter().position(|id| *id == answer.id));
            }
            let address = match packet.parameters[..] {
                [low, high, ..] => u16::from_le_bytes([low, high]),
                _ => 0,
            };
            replies.extend(answers.iter().map(|answer| (address, answer.encode())));
        }
        replies
    }

    fn step(&mut self, now_us: u64) {
        self.servos.iter_mut().for_each(|servo| servo.step(now_us));
    }

    fn table(&mut self, servo: usize) -> Option<&mut Table> {
        self.servos.get_mut(servo).map(|servo| &mut servo.table)
    }
}

struct MockServo {
    id: u8,
    table: Table,
    spoken_to_us: u64,
}

impl MockServo {
    fn new(id: u8, mut table: Table) -> Self {
        let position = table.position;
        table.set((0, 2), 1020); // XM430-W350
        table.set((6, 1), 1); // firmware version
        table.set((7, 1), id.into());
        table.set((11, 1), 3); // position control
        table.set((32, 2), 160);
        table.set((34, 2), 95);
        table.set(MAX_POSITION, *TURN_COUNTS.end());
        table.set(table::STATUS_RETURN_LEVEL, 2);
        table.set(table::GOAL_POSITION, position);
        Self { id, table, spoken_to_us: 0 }
    }

    fn step(&mut self, now_us: u64) {
        let sense = self.table.axis.sense(now_us);
        let (from, _) = table::MEASURED;
        let Reading::Measured(position_urad) = sense.reading else {
            self.shut_down(table::hardware_error::ENCODER);
            return;
        };
        self.table.position = counts(position_urad);
        let at = |offset: usize, length| (from + offset as u16, length);
        self.table.set(at(table::CURRENT_AT, 2), i32::from(sense.current_ma) * 100 / 269);
        self.table.set(at(table::POSITION_AT, 4), counts(position_urad));
        self.table.set(at(table::VOLTAGE_AT, 2), i32::from(sense.supply_mv) / 100);
        self.table.set(at(table::TEMPERATURE_AT, 1), i32::from(sense.temperature_c));
        let torque = self.table.get(table::TORQUE_ENABLE) == 1;
        if sense.temperature_c > SHUTDOWN_C {
            self.shut_down(table::hardware_error::OVERHEAT);
        } else if torque && !sense.torque && self.table.axis.is_driven() {
            self.shut_down(1 << 5); // overload
        }
        let watchdog = self.table.get(table::BUS_WATCHDOG);
        if (1..=127).contains(&watchdog) && now_us - self.spoken_to_us > watchdog as u64 * 20_000 {
            self.table.set(table::BUS_WATCHDOG, 0xFF);
            self.table.set(table::GOAL_POSITION, counts(position_urad));
        }
        let torque = self.table.get(table::TORQUE_ENABLE) == 1;
        let position_urad = urad(self.table.get(table::GOAL_POSITION));
        let driven = Setpoint { torque, position_urad, current_limit_ma: 2000, ..Setpoint::default() };
        self.table.axis.drive(now_us, driven);
    }

    fn shut_down(&mut self, error: u8) {
        self.table.set(table::HARDWARE_ERROR, self.table.get(table::HARDWARE_ERROR) | i32::from(error));
        self.table.set(table::TORQUE_ENABLE, 0);
    }

    fn answer(&mut self, now_us: u64, packet: &Packet) -> Option<Packet> {
        let mine = packet.id == self.id;
        if packet.instruction == STATUS || !(mine || packet.id == BROADCAST) {
            return None;
        }
        self.spoken_to_us = now_us;
        let parameters = &packet.parameters[..];
        let word = |at: usize| Some(u16::from_le_bytes([*parameters.get(at)?, *parameters.get(at + 1)?]));
        let level = self.table.get(table::STATUS_RETURN_LEVEL);
        let mut answered_from = 2;
        let (error, data) = match packet.instruction {
            instruction::PING => {
                answered_from = 0;
                (0, vec![self.table.bytes[0], self.table.bytes[1], self.table.bytes[6]])
            }
            instruction::READ => {
                answered_from = 1;
                match word(0).zip(word(2)) {
                    Some((address, length)) => self.read(address, length),
                    None => (error::DATA_LENGTH, vec![]),
                }
            }
            instruction::WRITE => match word(0) {
                Some(address) => (self.write(address, &parameters[2..]), vec![]),
                None => (error::DATA_LENGTH, vec![]),
            },
            instruction::REBOOT => {
                self.table.set(table::TORQUE_ENABLE, 0);
                self.table.set(table::HARDWARE_ERROR, 0);
                self.table.set(table::BUS_WATCHDOG, 0);
                self.table.set(table::STATUS_RETURN_LEVEL, 2);
                (0, vec![])
            }
            instruction::SYNC_READ => {
                answered_from = 1;
                let (address, length) = word(0).zip(word(2))?;
                if !parameters[4..].contains(&self.id) {
                    return None;
                }
                self.read(address, length)
            }
            instruction::SYNC_WRITE => {
                let (address, length) = word(0).zip(word(2))?;
                let mut chunks = parameters[4..].chunks_exact(usize::from(length) + 1);
                let mine = chunks.find(|chunk| chunk[0] == self.id)?;
                self.write(address, &mine[1..]);
                return None;
            }
            _ => (error::INSTRUCTION, vec![]),
        };
        let alert = if self.table.get(table::HARDWARE_ERROR) == 0 { 0 } else { error::ALERT };
        let alone = mine || matches!(packet.instruction, instruction::PING | instruction::SYNC_READ);
        (alone && level >= answered_from)
            .then(|| Packet::new(self.id, STATUS, &[&[error | alert], &data[..]].concat()))
    }

    fn read(&self, address: u16, length: u16) -> (u8, Vec<u8>) {
        match self.table.slice(address, length) {
            Some(bytes) => (0, bytes.to_vec()),
            None => (error::ACCESS, vec![]),
        }
    }

    fn write(&mut self, address: u16, values: &[u8]) -> u8 {
        let register = (address, values.len() as u16);
        let torque = self.table.get(table::TORQUE_ENABLE) == 1;
        if values.is_empty() || usize::from(address) + values.len() > usize::from(table::MEASURED.0) {
            return error::ACCESS; // what is measured cannot be written
        }
        if address < FIRST_RAM && (torque || address < 11) {
            return error::ACCESS;
        }
        if register == table::TORQUE_ENABLE && self.table.get(table::HARDWARE_ERROR) != 0 {
            return error::ACCESS; // after a shutdown only a reboot helps
        }
        if register == table::GOAL_POSITION {
            let goal = values.try_into().map_or(0, i32::from_le_bytes);
            let range = self.table.get(MIN_POSITION)..=self.table.get(MAX_POSITION);
            // a watchdog that bit keeps goals read-only
            if !range.contains(&goal) || self.table.get(table::BUS_WATCHDOG) == 0xFF {
                return error::DATA_RANGE;
            }
            self.table.keep_goal(goal, torque);
        }
        let start = usize::from(address);
        self.table.bytes[start..start + values.len()].copy_from_slice(values);
        0
    }
}
