//! Feetech STS servos: a goal switches torque on and is clamped to the limits, and nothing stops a servo when its host is gone.

use firmware_protocol::{Reading, Servo, Setpoint};

use super::servo_table::{MockBus, Table};
use crate::drive::bus_servos::{BROADCAST, TURN_COUNTS, counts, instruction, urad};
use crate::drive::feetech::packet::{Packet, PacketReceiver};
use crate::drive::feetech::table;

/// Settings of the factory: register and value, see [`table::SETUP`].
const FACTORY: [(u16, u8); 8] = [(3, 9), (4, 3), (8, 1), (14, 140), (15, 40), (18, 108), (30, 1), (55, 1)];

pub(super) struct FeetechBus {
    receiver: PacketReceiver,
    servos: [(u8, Table); 2],
}

impl FeetechBus {
    pub(crate) fn new(tables: [Table; 2]) -> Self {
        let [first, second] = tables.map(|mut table| {
            FACTORY.iter().for_each(|(address, value)| table.bytes[usize::from(*address)] = *value);
            table.set((table::HIGHEST, 2), *TURN_COUNTS.end());
            table
        });
        Self { receiver: PacketReceiver::default(), servos: [(1, first), (2, second)] }
    }
}

impl MockBus for FeetechBus {
    fn hear(&mut self, _now_us: u64, bytes: &[u8]) -> Vec<(u16, Vec<u8>)> {
        let mut replies = Vec::new();
        for packet in self.receiver.push(bytes) {
            let asked = match packet.code {
                instruction::SYNC_READ => packet.parameters.get(2..).unwrap_or_default().to_vec(),
                _ if packet.id == BROADCAST => vec![1, 2],
                _ => vec![packet.id],
            };
            for asked_id in asked {
                let servo = self.servos.iter_mut().find(|(id, _)| *id == asked_id);
                let answer = servo.and_then(|(id, table)| answer(*id, table, &packet));
                let address = packet.parameters.first().copied().unwrap_or(0);
                replies.extend(answer.map(|answer| (address.into(), answer.encode())));
            }
        }
        replies
    }

    fn step(&mut self, now_us: u64) {
        self.servos.iter_mut().for_each(|(_, table)| step(now_us, table));
    }

    fn table(&mut self, servo: usize) -> Option<&mut Table> {
        self.servos.get_mut(servo).map(|(_, table)| table)
    }
}

/// Sign and magnitude.
fn signed(value: i32) -> i32 {
    if value < 0 { 0x8000 | -value } else { value }
}

fn step(now_us: u64, table: &mut Table) {
    let sense = table.axis.sense(now_us);
    let (from, _) = table::MEASURED;
    match sense.reading {
        Reading::Measured(position_urad) => table.position = counts(position_urad),
        _ => table.set((from + table::STATUS_AT as u16, 1), table::ENCODER.into()),
    }
    table.set((from, 2), signed(table.position));
    table.set((from + table::VOLTAGE_AT as u16, 1), i32::from(sense.supply_mv) / 100);
    table.set((from + table::TEMPERATURE_AT as u16, 1), sense.temperature_c.into());
    table.set((from + table::CURRENT_AT as u16, 2), i32::from(sense.current_ma) * 2 / 13);
    let torque = table.get(table::TORQUE_ENABLE) == 1;
    let position_urad = urad(table.get(table::GOAL_POSITION));
    let driven = Setpoint { torque, position_urad, current_limit_ma: 2000, ..Setpoint::default() };
    table.axis.drive(now_us, driven);
}

fn answer(id: u8, table: &mut Table, packet: &Packet) -> Option<Packet> {
    let parameters = &packet.parameters[..];
    let (is_answered, data) = match (packet.code, parameters) {
        (instruction::PING, _) => (true, Vec::new()),
        (instruction::READ | instruction::SYNC_READ, [address, length, ..]) => {
            (true, table.slice((*address).into(), (*length).into())?.to_vec())
        }
        (instruction::WRITE, [address, values @ ..]) => {
            write(table, (*address).into(), values);
            (table.bytes[usize::from(table::ANSWER_LEVEL)] != 0 && packet.id == id, Vec::new())
        }
        (instruction::SYNC_WRITE, [address, length, chunks @ ..]) => {
            let mut chunks = chunks.chunks_exact(usize::from(*length) + 1);
            let mine = chunks.find(|chunk| chunk[0] == id)?;
            write(table, (*address).into(), &mine[1..]);
            return None;
        }
        _ => return None,
    };
    let error = table.get((table::MEASURED.0 + table::STATUS_AT as u16, 1)) as u8;
    is_answered.then_some(Packet { id, code: error, parameters: data })
}

fn write(table: &mut Table, address: u16, values: &[u8]) {
    let start = usize::from(address);
    if start + values.len() > usize::from(table::MEASURED.0) {
        return; // what is measured cannot be written
    }
    let torque = table.get(table::TORQUE_ENABLE) == 1;
    table.bytes[start..start + values.len()].copy_from_slice(values);
    if (address, values.len() as u16) == table::GOAL_POSITION {
        let (low, high) = (table.get((table::LOWEST, 2)), table.get((table::HIGHEST, 2)));
        let asked = table.get(table::GOAL_POSITION);
        let goal = if low < high { asked.clamp(low, high) } else { asked };
        table.set(table::GOAL_POSITION, goal);
        table.set(table::TORQUE_ENABLE, 1);
        table.keep_goal(goal, torque);
    }
}
