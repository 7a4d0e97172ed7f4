//! Two CiA 402 drives behind a LAWICEL adapter on a pseudo terminal: objects, power states, and shafts that go on to their
//! last target by themselves.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

/// A drive's make.
#[derive(Clone)]
pub struct Drive {
    pub objects: BTreeMap<(u16, u8), u32>,
    /// Where it stands, position units.
    pub position: f64,
    /// Where it was told to be, position units.
    pub target: i32,
    /// Farthest that it was ever told to go from where it stood, position units.
    pub widest: f64,
    /// It goes this many times as far as it is told.
    pub factor: f64,
    /// Increments (0x6063) of a position unit; it has no such object without.
    pub increments_per_unit: Option<f64>,
    /// Position units a second.
    pub speed: f64,
    pub status: u16,
    pub runs: bool,
    /// When the host's last heartbeat came. It counts from there however long it did not watch: stricter than CiA 301,
    /// by which watching begins with the first heartbeat.
    pub last_heartbeat: Option<Instant>,
}

impl Drive {
    /// An encoder of 4096 counts and a gear of 100; objects of two parts (sub-index 1 and 2), and of one (0).
    pub fn new(pairs: &[(u16, i32, i32)], singles: &[(u16, u32)]) -> Self {
        let mut objects = BTreeMap::from([
            ((0x1000, 0), 0x0002_0192),
            ((0x1016, 1), 0),
            ((0x1017, 0), 0),
            ((0x6007, 0), 1),
            ((0x605A, 0), 2),
            ((0x6060, 0), 0),
            ((0x6061, 0), 8),
            ((0x6075, 0), 1000),
            ((0x6078, 0), 10),
            ((0x6079, 0), 24_000),
            ((0x6098, 0), 0),
            ((0x6502, 0), 1 << 7),
        ]);
        for (index, first, second) in [(0x608F, 4096, 1), (0x6091, 100, 1)].iter().chain(pairs) {
            objects.extend([((*index, 1), *first as u32), ((*index, 2), *second as u32)]);
        }
        objects.extend(singles.iter().map(|(index, value)| ((*index, 0), *value)));
        let (position, target, widest, factor) = (0.0, 0, 0.0, 1.0);
        let speed = f64::INFINITY;
        Self {
            objects,
            position,
            target,
            widest,
            factor,
            increments_per_unit: None,
            speed,
            status: 0x0250,
            runs: false,
            last_heartbeat: None,
        }
    }

    /// The usual one: 36000 position units a turn.
    pub fn usual() -> Self {
        Self::new(&[(0x6092, 36_000, 1)], &[])
    }

    pub fn object(&self, index: u16, sub: u8) -> Option<u32> {
        match self.increments_per_unit {
            Some(increments) if index == 0x6063 => Some((self.position * increments) as i32 as u32),
            _ => self.objects.get(&(index, sub)).copied(),
        }
    }

    fn go_on(&mut self, elapsed: Duration) {
        let within_ms = u64::from(self.objects[&(0x1016, 1)] & 0xFFFF);
        let is_late = self.last_heartbeat.is_some_and(|at| at.elapsed() > Duration::from_millis(within_ms));
        if within_ms > 0 && is_late && self.status == 0x0637 {
            self.status = 0x0638;
        }
        if self.status == 0x0637 {
            let way = f64::from(self.target) * self.factor - self.position;
            let reach = self.speed * elapsed.as_secs_f64();
            self.position += way.clamp(-reach, reach);
        }
    }

    fn take_control(&mut self, word: u16) {
        self.status = match (word & 0x8F, self.status) {
            (0x06, _) => 0x0631,
            (0x07, 0x0631 | 0x0633 | 0x0637) => 0x0633,
            (0x0F, 0x0633 | 0x0637) => 0x0637,
            (0x00, _) => 0x0250,
            (_, status) => status,
        };
    }

    fn answer(&mut self, question: [u8; 8]) -> [u8; 8] {
        let [command, low, high, sub, value @ ..] = question;
        let index = u16::from_le_bytes([low, high]);
        let answer = |command: u8, value: u32| {
            let [a, b, c, d] = value.to_le_bytes();
            [command, low, high, sub, a, b, c, d]
        };
        let process_data = matches!(index, 0x1400 | 0x1600 | 0x1800 | 0x1A00);
        match self.object(index, sub) {
            Some(value) if command == 0x40 => answer(0x43, value),
            found if command != 0x40 && (found.is_some() || process_data) => {
                self.objects.insert((index, sub), u32::from_le_bytes(value));
                answer(0x60, 0)
            }
            _ => answer(0x80, 0x0602_0000),
        }
    }
}

/// What an adapter refuses: commands by their first letter.
pub struct Line {
    pub drives: [Drive; 2],
    pub refuses: &'static str,
    /// Commands other than messages, as they came.
    pub commands: Vec<String>,
}

/// The drives in their own thread.
pub struct Drives {
    pub path: String,
    line: Arc<Mutex<Line>>,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drives {
    pub fn start(drives: [Drive; 2]) -> Self {
        Self::behind(drives, "")
    }

    /// Behind an adapter that refuses some commands.
    pub fn behind(drives: [Drive; 2], refuses: &'static str) -> Self {
        let (mut master, slave) = TTYPort::pair().unwrap();
        master.set_timeout(Duration::from_millis(2)).unwrap();
        let path = slave.name().unwrap();
        let line = Arc::new(Mutex::new(Line { drives, refuses, commands: Vec::new() }));
        let quit = Arc::new(AtomicBool::new(false));
        let (shared, ends) = (line.clone(), quit.clone());
        let thread = std::thread::spawn(move || {
            let _slave = slave; // without one, reading is an error
            run(&mut master, &shared, &ends);
        });
        Self { path, line, quit, thread: Some(thread) }
    }

    pub fn line(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn address(&self) -> String {
        format!("cia402:slcan:{}@1,2", self.path)
    }
}

impl Drop for Drives {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}

fn run(port: &mut TTYPort, shared: &Mutex<Line>, quit: &AtomicBool) {
    let (mut text, mut bytes) = (Vec::new(), [0; 1024]);
    let mut stepped = Instant::now();
    while !quit.load(Ordering::Relaxed) {
        let count = port.read(&mut bytes).unwrap_or(0);
        let mut line = shared.lock().unwrap_or_else(PoisonError::into_inner);
        let elapsed = std::mem::replace(&mut stepped, Instant::now()).elapsed();
        line.drives.iter_mut().for_each(|drive| drive.go_on(elapsed));
        for byte in &bytes[..count] {
            if *byte != b'\r' {
                text.push(*byte);
                continue;
            }
            let said = line.hear(&String::from_utf8(std::mem::take(&mut text)).unwrap());
            let _ = port.write_all(&said); // a host that is gone
        }
    }
}

impl Line {
    /// What comes back for one line of text.
    fn hear(&mut self, text: &str) -> Vec<u8> {
        let Some(letter) = text.chars().next() else { return b"\r".to_vec() };
        if self.refuses.contains(letter) {
            return vec![0x07];
        }
        if letter != 't' {
            self.commands.push(text.to_owned());
            return b"\r".to_vec();
        }
        let number = u16::from_str_radix(&text[1..4], 16).unwrap();
        let data: Vec<u8> =
            (5..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect();
        let mut said = b"z\r".to_vec();
        for (node, drive) in (1u16..).zip(&mut self.drives) {
            let mut say = |number: u16, data: &[u8]| {
                let data: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
                said.extend(format!("t{:03X}{}{data}\r", number + node, data.len() / 2).bytes());
            };
            match (number, &data[..]) {
                (0x77F, _) => drive.last_heartbeat = Some(Instant::now()),
                (0, [command, to]) if [0, node].contains(&u16::from(*to)) => drive.runs = *command == 1,
                (0x080, []) if drive.runs => {
                    let position = drive.position.round() as i32;
                    say(0x180, &[&drive.status.to_le_bytes()[..], &position.to_le_bytes()].concat());
                }
                (_, [low, high, target @ ..]) if number == 0x200 + node => {
                    drive.take_control(u16::from_le_bytes([*low, *high]));
                    drive.target = i32::from_le_bytes(target.try_into().unwrap());
                    drive.widest = drive.widest.max((f64::from(drive.target) - drive.position).abs());
                }
                (_, question) if number == 0x600 + node => {
                    say(0x580, &drive.answer(question.try_into().unwrap()));
                }
                _ => {}
            }
        }
        said
    }
}
