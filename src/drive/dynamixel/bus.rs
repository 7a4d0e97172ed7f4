//! Questions and answers on a Dynamixel bus, each with a time limit.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use super::packet::{BROADCAST, Packet, PacketReceiver, instruction};
use super::table::Register;
use crate::drive::LinkError;
use crate::drive::bus_port::BusPort;

/// How long a servo may take to answer: return delay, 60 bytes at 57600 baud, a slow USB adapter.
const ANSWER_WITHIN: Duration = Duration::from_millis(40);

/// A bus.
pub struct Bus {
    port: BusPort,
    receiver: PacketReceiver,
    waiting: VecDeque<Packet>,
    /// Answers heard.
    pub answers: u32,
}

impl Bus {
    /// Opens a serial adapter, for this program alone.
    pub fn open(path: &Path, baud: u32) -> Result<Self, LinkError> {
        let port = BusPort::open(path, baud)?;
        Ok(Self { port, receiver: PacketReceiver::default(), waiting: VecDeque::new(), answers: 0 })
    }

    /// The adapter's path.
    pub fn path(&self) -> &str {
        self.port.path()
    }

    /// Damaged packets heard.
    pub fn damaged(&self) -> u32 {
        self.receiver.damaged
    }

    fn send(&mut self, packet: &Packet) -> Result<(), LinkError> {
        self.waiting.clear();
        self.port.forget()?; // a late answer would be taken for that to this question
        self.port.send(&packet.encode())
    }

    /// The next answer of this servo. What others say, late answers and the echo of a half-duplex adapter (which is no
    /// answer) are skipped.
    fn hear(&mut self, id: u8) -> Result<Option<Packet>, LinkError> {
        self.hear_any(&[id])
    }

    /// The next answer of one of these servos.
    fn hear_any(&mut self, ids: &[u8]) -> Result<Option<Packet>, LinkError> {
        let end = Instant::now() + ANSWER_WITHIN;
        loop {
            while let Some(packet) = self.waiting.pop_front() {
                if ids.contains(&packet.id) && packet.answer().is_some() {
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

    /// Model number of a servo; `None` when nobody answers.
    pub fn ping(&mut self, id: u8) -> Result<Option<u16>, LinkError> {
        self.send(&Packet::new(id, instruction::PING, &[]))?;
        let answer = self.hear(id)?;
        Ok(answer.as_ref().and_then(Packet::answer).and_then(|(_, data)| match data {
            [low, high, _] => Some(u16::from_le_bytes([*low, *high])),
            _ => None,
        }))
    }

    /// Starts a servo anew: the only way out of its shutdown. It does not hear for a while afterwards.
    pub fn reboot(&mut self, id: u8) -> Result<(), LinkError> {
        self.send(&Packet::new(id, instruction::REBOOT, &[]))?;
        self.hear(id).map(drop)
    }

    /// Values of a register; `None` when nobody answers or the servo refuses.
    pub fn read(&mut self, id: u8, (address, length): Register) -> Result<Option<Vec<u8>>, LinkError> {
        self.send(&Packet::read(id, address, length))?;
        let answer = self.hear(id)?;
        Ok(values(answer.as_ref(), length))
    }

    /// Sets a register; the error that the servo answers, 0 for none, `None` when nobody answers.
    pub fn write(&mut self, id: u8, (address, _): Register, values: &[u8]) -> Result<Option<u8>, LinkError> {
        self.send(&Packet::write(id, address, values))?;
        let answer = self.hear(id)?;
        // bit 7 is an alert about the hardware, not about this write
        Ok(answer.as_ref().and_then(Packet::answer).map(|(error, _)| error & 0x7F))
    }

    /// Values of the same register of several servos, in the order of `ids`.
    pub fn sync_read(
        &mut self,
        ids: &[u8],
        (address, length): Register,
    ) -> Result<Vec<Option<Vec<u8>>>, LinkError> {
        let parameters = [&address.to_le_bytes(), &length.to_le_bytes(), ids].concat();
        self.send(&Packet::new(BROADCAST, instruction::SYNC_READ, &parameters))?;
        // they answer in the order they were asked in; one that is silent makes those behind it late, or early
        let (mut found, mut left) = (vec![None; ids.len()], ids.to_vec());
        while !left.is_empty()
            && let Some(answer) = self.hear_any(&left)?
        {
            left.retain(|id| *id != answer.id);
            if let Some(place) = ids.iter().position(|id| *id == answer.id) {
                found[place] = values(Some(&answer), length);
            }
        }
        Ok(found)
    }

    /// Sets the same register of several servos; nobody answers.
    pub fn sync_write(
        &mut self,
        (address, length): Register,
        values: &[(u8, Vec<u8>)],
    ) -> Result<(), LinkError> {
        let mut parameters = [address.to_le_bytes(), length.to_le_bytes()].concat();
        for (id, value) in values {
            parameters.push(*id);
            parameters.extend(value);
        }
        self.send(&Packet::new(BROADCAST, instruction::SYNC_WRITE, &parameters))
    }
}

fn values(answer: Option<&Packet>, length: u16) -> Option<Vec<u8>> {
    let (error, data) = answer?.answer()?;
    (error & 0x7F == 0 && data.len() == usize::from(length)).then(|| data.to_vec())
}
