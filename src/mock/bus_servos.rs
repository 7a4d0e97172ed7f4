//! Servos on a half-duplex bus behind a pty: registers over simulated axes. Answers can be made late, registers set as
//! another program may have left them, and every goal is logged.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use firmware_protocol::simulated::AxisFault;

use super::dynamixel::DynamixelBus;
use super::feetech::FeetechBus;
use super::pty::Pty;
use super::servo_table::{GoalWrite, MockBus, Table};
use crate::drive::bus_servos::Register;

/// Make of the servos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Make {
    /// Dynamixel XM430-W350.
    Dynamixel,
    /// Feetech STS3215.
    Feetech,
}

/// Answers to some questions come late, as behind a slow adapter.
#[derive(Clone, Copy, Debug)]
pub struct Lateness {
    /// The register of which the question is (0 for a ping); `None` for all.
    pub address: Option<u16>,
    /// Shortest and longest delay, ms.
    pub delay_ms: (u64, u64),
    /// Whether later answers wait for a late one; else they overtake it.
    pub in_order: bool,
    /// One in so many is late.
    pub every: u32,
}

enum Message {
    Inject(usize, AxisFault),
    Set(usize, u16, Vec<u8>),
    Get(usize, Register, Sender<Vec<u8>>),
    Goals(usize, Sender<Vec<GoalWrite>>),
    Late(Lateness),
    Close,
}

/// Mock servos in their own thread.
pub struct MockServos {
    path: PathBuf,
    messages: Sender<Message>,
    thread: Option<JoinHandle<()>>,
}

impl MockServos {
    /// Opens a pty with two servos of ids 1 and 2, which stand near the middle. Noise comes from the seed.
    pub fn start(make: Make, seed: u64) -> io::Result<Self> {
        Self::start_at(make, seed, [2081, 2113])
    }

    /// The same with servos that stand elsewhere, counts.
    pub fn start_at(make: Make, seed: u64, positions: [i32; 2]) -> io::Result<Self> {
        let pty = Pty::open()?;
        let path = pty.path.clone();
        let (messages, inbox) = channel();
        let tables = [0, 1].map(|place: usize| Table::new(seed + place as u64, positions[place]));
        let bus: Box<dyn MockBus> = match make {
            Make::Dynamixel => Box::new(DynamixelBus::new(tables)),
            Make::Feetech => Box::new(FeetechBus::new(tables)),
        };
        let thread =
            std::thread::Builder::new().name("mock servos".into()).spawn(move || run(pty, &inbox, bus))?;
        Ok(Self { path, messages, thread: Some(thread) })
    }

    /// The device file to connect to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Breaks something in a servo, counted from 0.
    pub fn inject(&self, servo: usize, fault: AxisFault) {
        self.send(Message::Inject(servo, fault));
    }

    /// Sets registers, whatever the servo thinks of it.
    pub fn set(&self, servo: usize, address: u16, values: &[u8]) {
        self.send(Message::Set(servo, address, values.to_vec()));
    }

    /// Reads registers behind the bus.
    pub fn get(&self, servo: usize, register: Register) -> Vec<u8> {
        let (sender, answer) = channel();
        self.send(Message::Get(servo, register, sender));
        answer.recv().unwrap_or_default()
    }

    /// Every goal that a servo took.
    pub fn goals(&self, servo: usize) -> Vec<GoalWrite> {
        let (sender, answer) = channel();
        self.send(Message::Goals(servo, sender));
        answer.recv().unwrap_or_default()
    }

    /// From now on answers are late.
    pub fn delay(&self, lateness: Lateness) {
        self.send(Message::Late(lateness));
    }

    fn send(&self, message: Message) {
        let _ = self.messages.send(message); // servos that are gone take none
    }
}

impl Drop for MockServos {
    fn drop(&mut self) {
        self.send(Message::Close);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Answers still to come.
struct Outbox {
    lateness: Option<Lateness>,
    asked: u32,
    random: u64,
    last_us: u64,
    waiting: Vec<(u64, Vec<u8>)>,
}

impl Outbox {
    fn put(&mut self, now_us: u64, address: u16, bytes: Vec<u8>) {
        let mut due_us = now_us;
        if let Some(lateness) = self.lateness {
            if lateness.address.is_none_or(|late| late == address) {
                self.asked += 1;
                if self.asked.is_multiple_of(lateness.every) {
                    let (from_ms, to_ms) = lateness.delay_ms;
                    self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    due_us += 1000 * (from_ms + (self.random >> 33) % (to_ms - from_ms + 1));
                }
            }
            if lateness.in_order {
                due_us = due_us.max(self.last_us);
            }
        }
        self.last_us = due_us;
        self.waiting.push((due_us, bytes));
        self.waiting.sort_by_key(|(due_us, _)| *due_us);
    }

    fn deliver(&mut self, now_us: u64, pty: &mut Pty) {
        let due = self.waiting.partition_point(|(due_us, _)| *due_us <= now_us);
        self.waiting.drain(..due).for_each(|(_, bytes)| pty.write(&bytes));
    }
}

fn run(mut pty: Pty, inbox: &Receiver<Message>, mut bus: Box<dyn MockBus>) {
    let started = Instant::now();
    let mut outbox = Outbox { lateness: None, asked: 0, random: 1, last_us: 0, waiting: Vec::new() };
    let mut bytes = [0; 1024];
    loop {
        for message in inbox.try_iter() {
            match message {
                Message::Close => return,
                Message::Late(lateness) => outbox.lateness = Some(lateness),
                Message::Inject(servo, fault) => {
                    bus.table(servo).into_iter().for_each(|table| table.axis.inject(fault));
                }
                Message::Set(servo, address, values) => {
                    let start = usize::from(address);
                    if let Some(target) =
                        bus.table(servo).and_then(|table| table.bytes.get_mut(start..start + values.len()))
                    {
                        target.copy_from_slice(&values);
                    }
                }
                Message::Get(servo, (address, length), answer) => {
                    let values = bus.table(servo).and_then(|table| table.slice(address, length));
                    let _ = answer.send(values.unwrap_or_default().to_vec()); // who asked may be gone
                }
                Message::Goals(servo, answer) => {
                    let _ =
                        answer.send(bus.table(servo).map(|table| table.goals.clone()).unwrap_or_default());
                }
            }
        }
        let now_us = started.elapsed().as_micros() as u64;
        let Ok(count) = pty.read(&mut bytes) else { return };
        bus.step(now_us);
        for (address, answer) in bus.hear(now_us, &bytes[..count]) {
            outbox.put(now_us, address, answer);
        }
        outbox.deliver(now_us, &mut pty);
        pty.wait_a_millisecond();
    }
}
