//! Questions and answers on a half-duplex bus, each with a time limit.
//!
//! An answer names its servo but not its register, so a late one could be mistaken for that to the next
//! question. Three rules keep it from that. Each register that is read has a length of its own ([`super::Table`]), and an
//! answer of another length is none. Nothing more is asked of a servo that did not answer before the answer to a fence came:
//! bytes keep their order on a line, so what was late came before that. While a bus is opened there is time to wait.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::drive::LinkError;
use crate::drive::bus_port::BusPort;

/// Address and length of a register.
pub type Register = (u16, u16);

/// The id that every servo listens to.
pub const BROADCAST: u8 = 0xFE;

/// Instructions that both makes have.
pub mod instruction {
    /// Who is there?
    pub const PING: u8 = 0x01;
    /// Read registers.
    pub const READ: u8 = 0x02;
    /// Write registers.
    pub const WRITE: u8 = 0x03;
    /// Start again: the only exit from a Dynamixel's shutdown.
    pub const REBOOT: u8 = 0x08;
    /// Read the same registers of many servos; they answer in turn.
    pub const SYNC_READ: u8 = 0x82;
    /// Write the same registers of many servos; none answers.
    pub const SYNC_WRITE: u8 = 0x83;
}

/// How long an answer may take while a bus is opened, and nothing moves: network adapters and busy hosts are slow.
const ANSWER_WHILE_OPENING: Duration = Duration::from_millis(400);
/// How long an answer may take later: return delay, 60 bytes at 57600 baud, a slow USB adapter.
const ANSWER: Duration = Duration::from_millis(40);
/// How often a question is repeated while a bus is opened.
const TRIES: u32 = 3;

/// What a servo answered.
#[derive(Clone, Debug)]
pub struct Answer {
    pub id: u8,
    pub error: u8,
    pub data: Vec<u8>,
}

/// How a make of servo packs questions and answers.
pub trait Wire: Default + Send + 'static {
    /// An address or a length, as a question carries it.
    fn number(value: u16) -> Vec<u8>;

    /// The bytes of a question.
    fn question(&mut self, id: u8, instruction: u8, parameters: Vec<u8>) -> Vec<u8>;

    /// Takes bytes; the answers that they complete, without the echo of a half-duplex adapter.
    fn push(&mut self, bytes: &[u8]) -> Vec<Answer>;

    /// Forgets half an answer.
    fn clear(&mut self);

    /// Damaged packets received.
    fn damaged(&self) -> u32;
}

pub struct Bus<W> {
    port: BusPort,
    wire: W,
    waiting: VecDeque<Answer>,
    fence: Register,
    patience: Duration,
    /// Servos that owe an answer, which may still come.
    owing: Vec<u8>,
    /// Answers received.
    pub answers: u32,
}

impl<W: Wire> Bus<W> {
    /// Opens a serial adapter, for this program alone. No other question than the fence may have an answer of its length.
    pub(crate) fn open(path: &Path, baud: u32, fence: Register) -> Result<Self, LinkError> {
        Ok(Self {
            port: BusPort::open(path, baud)?,
            wire: W::default(),
            waiting: VecDeque::new(),
            fence,
            patience: ANSWER_WHILE_OPENING,
            owing: Vec::new(),
            answers: 0,
        })
    }

    /// From now on a servo that does not answer must not make the others wait.
    pub(crate) fn end_opening(&mut self) {
        self.patience = ANSWER;
    }

    /// The adapter's path.
    pub(crate) fn path(&self) -> &str {
        self.port.path()
    }

    /// Damaged packets received.
    pub(crate) fn damaged(&self) -> u32 {
        self.wire.damaged()
    }

    fn send(&mut self, id: u8, instruction: u8, parameters: Vec<u8>) -> Result<(), LinkError> {
        self.waiting.clear();
        self.wire.clear();
        self.port.forget()?;
        self.port.send(&self.wire.question(id, instruction, parameters))
    }

    /// The next answer of one of these servos that has one of these lengths. Others, and what other servos say, are skipped.
    fn hear(&mut self, ids: &[u8], lengths: &[u16], end: Instant) -> Result<Option<Answer>, LinkError> {
        loop {
            while let Some(answer) = self.waiting.pop_front() {
                let fits = lengths.iter().any(|length| usize::from(*length) == answer.data.len());
                if ids.contains(&answer.id) && fits {
                    self.answers = self.answers.wrapping_add(1);
                    return Ok(Some(answer));
                }
            }
            match self.port.read(end)? {
                Some(bytes) => self.waiting.extend(self.wire.push(&bytes)),
                None => return Ok(None),
            }
        }
    }

    /// Sends a fence behind a question that was not answered in time; its answer, should it come before that to the fence.
    fn late_answer(&mut self, id: u8, length: u16) -> Result<Option<Answer>, LinkError> {
        let (fence, end) = (self.fence, Instant::now() + self.patience);
        self.port.send(&self.wire.question(id, instruction::READ, address_and_length::<W>(fence)))?;
        match self.hear(&[id], &[length, fence.1], end)? {
            Some(answer) => {
                self.owing.retain(|owing| *owing != id);
                Ok(Some(answer).filter(|answer| answer.data.len() == usize::from(length)))
            }
            None => {
                self.owing.retain(|owing| *owing != id);
                self.owing.push(id);
                Ok(None)
            }
        }
    }

    /// Whether a servo owes nothing more. One that does is not asked anything else.
    fn is_settled(&mut self, id: u8) -> Result<bool, LinkError> {
        if self.owing.contains(&id) {
            self.late_answer(id, self.fence.1)?;
        }
        Ok(!self.owing.contains(&id))
    }

    /// One question to one servo and its answer; `None` when none comes.
    fn ask(
        &mut self,
        id: u8,
        instruction: u8,
        parameters: Vec<u8>,
        length: u16,
    ) -> Result<Option<Answer>, LinkError> {
        if !self.is_settled(id)? {
            return Ok(None);
        }
        self.send(id, instruction, parameters)?;
        match self.hear(&[id], &[length], Instant::now() + self.patience)? {
            None => self.late_answer(id, length),
            answer => Ok(answer),
        }
    }

    /// What a servo answers to a ping, which a Dynamixel does at every status return level.
    pub(crate) fn ping(&mut self, id: u8, length: u16) -> Result<Option<Vec<u8>>, LinkError> {
        for _ in 0..TRIES {
            self.send(id, instruction::PING, Vec::new())?;
            if let Some(answer) = self.hear(&[id], &[length], Instant::now() + self.patience)? {
                return Ok(Some(answer.data));
            }
        }
        Ok(None)
    }

    /// Starts a servo again. It does not hear for a while afterwards.
    pub(crate) fn reboot(&mut self, id: u8) -> Result<(), LinkError> {
        self.send(id, instruction::REBOOT, Vec::new())?;
        self.hear(&[id], &[0], Instant::now() + self.patience).map(drop)
    }

    /// Values of a register.
    pub(crate) fn read(&mut self, id: u8, register: Register) -> Result<Option<Answer>, LinkError> {
        self.ask(id, instruction::READ, address_and_length::<W>(register), register.1)
    }

    /// The same while a bus is opened: several tries.
    pub(crate) fn read_patiently(
        &mut self,
        id: u8,
        register: Register,
    ) -> Result<Option<Vec<u8>>, LinkError> {
        for _ in 0..TRIES {
            if let Some(answer) = self.read(id, register)? {
                return Ok(Some(answer.data));
            }
        }
        Ok(None)
    }

    /// Sets a register; the error that the servo answers, `None` when none comes.
    pub(crate) fn write(
        &mut self,
        id: u8,
        (address, _): Register,
        values: &[u8],
    ) -> Result<Option<u8>, LinkError> {
        let parameters = [W::number(address), values.to_vec()].concat();
        Ok(self.ask(id, instruction::WRITE, parameters, 0)?.map(|answer| answer.error))
    }

    /// Sets a register of a servo that does not answer to that.
    pub(crate) fn write_unanswered(
        &mut self,
        id: u8,
        (address, _): Register,
        values: &[u8],
    ) -> Result<(), LinkError> {
        self.send(id, instruction::WRITE, [W::number(address), values.to_vec()].concat())
    }

    /// Values of the same register of two servos.
    pub(crate) fn sync_read(
        &mut self,
        ids: [u8; 2],
        register: Register,
    ) -> Result<[Option<Answer>; 2], LinkError> {
        let mut left = Vec::new();
        for id in ids {
            if self.is_settled(id)? {
                left.push(id);
            }
        }
        let mut found = [None, None];
        if left.is_empty() {
            return Ok(found);
        }
        let parameters = [address_and_length::<W>(register), left.clone()].concat();
        self.send(BROADCAST, instruction::SYNC_READ, parameters)?;
        // they answer in the order they were asked in; one that is silent makes those behind it late, or early
        let mut take = |answer: Answer, left: &mut Vec<u8>| {
            left.retain(|id| *id != answer.id);
            let place = usize::from(answer.id != ids[0]);
            found[place] = Some(answer);
        };
        while !left.is_empty()
            && let Some(answer) = self.hear(&left, &[register.1], Instant::now() + self.patience)?
        {
            take(answer, &mut left);
        }
        for id in left.clone() {
            if let Some(answer) = self.late_answer(id, register.1)? {
                take(answer, &mut left);
            }
        }
        Ok(found)
    }

    /// Sets the same register of several servos; none answers.
    pub(crate) fn sync_write(
        &mut self,
        register: Register,
        values: &[(u8, Vec<u8>)],
    ) -> Result<(), LinkError> {
        let mut parameters = address_and_length::<W>(register);
        for (id, value) in values {
            parameters.push(*id);
            parameters.extend(value);
        }
        self.send(BROADCAST, instruction::SYNC_WRITE, parameters)
    }
}

fn address_and_length<W: Wire>((address, length): Register) -> Vec<u8> {
    [W::number(address), W::number(length)].concat()
}
