//! CANopen drives (CiA 301, CiA 402) as a rig: set points in cyclic synchronous position mode, one with every SYNC.
//!
//! Each side watches the other's heartbeat. A drive that restarts has lost its configuration and perhaps its zero, which
//! is an invalid encoder here; clearing the fault configures it again, and then it is to be homed. A drive that misses the
//! host's brakes and holds; one that does not watch it goes on to its last set point, which is never far ahead.

use std::time::{Duration, Instant};

use firmware_protocol::{AxisConfig, LinkCounters, Setpoint};

use super::LinkError;
use super::hosted::{Actuators, HostedLink, Make, Sample, Witness};

mod bus;
mod drive;
mod object;
mod setup;
mod unit;

pub(super) use bus::BusAddress;
use bus::CanBus;
use drive::{Drive, Power, Zero};
use object::{Answer, Object};

/// How long a drive may take to answer a question.
const ANSWER_WITHIN: Duration = Duration::from_millis(300);
/// How long the drives' readings are waited for after a SYNC.
const READINGS_WITHIN: Duration = Duration::from_millis(15);
/// At most this many times as long.
const LONGEST_ROUNDS: u32 = 8;
/// How long is looked for messages that are there already.
const LATE_WITHIN: Duration = Duration::from_micros(200);
/// How long leaving a fault may take.
const RESET_WITHIN: Duration = Duration::from_secs(2);
/// Rounds between two questions for slow readings, and what is asked in turn. Their answers are not waited for: a drive
/// that is slow to answer, or does not, must not hold up the set points.
const SLOW_ROUNDS: u32 = 10;
const SLOW: [Object; 2] = [object::CURRENT, object::SUPPLY];
/// How long a drive may take to find its zero by itself, µs.
const HOMING_US: u32 = 60_000_000;
/// How long a change of mode may take.
const MODE_WITHIN: Duration = Duration::from_secs(1);
/// Control word bit: begin homing.
const BEGIN_HOMING: u16 = 1 << 4;
/// Node number under which the host sends its heartbeat, and how long the drives wait for it, ms.
const HOST: (u8, u32) = (127, 1000);
const HEARTBEAT_EVERY: Duration = Duration::from_millis(100);
/// Play of a geared drive that says nothing of it, between an encoder on the motor and the load: 0.2 degrees.
const LOST_MOTION_URAD: i32 = 3491;

/// Opens a bus and finds its two drives; the first is axis 0.
pub(super) fn open(bus: BusAddress, nodes: [u8; 2]) -> Result<HostedLink, LinkError> {
    let bus = CanBus::open(bus)?;
    let name = bus.name().to_owned();
    let drives = nodes.map(Drive::new);
    let mut rig = Cia402 { bus, drives, heartbeat: None, questions: 0, watched: [true; 2] };
    let started = [rig.start(0)?, rig.start(1)?];
    let make = Make {
        uid: u64::from(nodes[0]) << 8 | u64::from(nodes[1]),
        ranges_urad: started.map(|(range, _)| range),
        accuracy_urad: 0, // an encoder on the motor errs by its error over the gear
        resolutions_urad: rig.drives.each_ref().map(Drive::resolution_urad),
        play_urad: 0,
        lost_motion_urad: LOST_MOTION_URAD,
        supply_minimum_mv: [AxisConfig::default().supply_minimum_mv; 2],
        homes: started.map(|(_, home)| home),
    };
    HostedLink::start(name, rig, &make)
}

struct Cia402 {
    bus: CanBus,
    drives: [Drive; 2],
    heartbeat: Option<Instant>,
    /// How often the drive that is being started was asked what it is.
    questions: u32,
    /// Whether each drive watches the host's heartbeat.
    watched: [bool; 2],
}

impl Cia402 {
    fn wrong(&self, axis: usize, reason: String) -> LinkError {
        LinkError::Open { path: format!("{}, node {}", self.bus.name(), self.drives[axis].node), reason }
    }

    /// Hears one message, whoever it is of.
    fn hear(&mut self, end: Instant) -> Result<Option<(u16, Vec<u8>)>, LinkError> {
        let message = self.bus.receive(end)?;
        if let Some((identifier, data)) = &message {
            let now = Instant::now();
            self.drives.iter_mut().for_each(|drive| drive.hear(now, *identifier, data));
        }
        Ok(message)
    }

    /// Sends the host's heartbeat when it is due.
    fn beat(&mut self) -> Result<(), LinkError> {
        if self.heartbeat.is_none_or(|sent| sent.elapsed() >= HEARTBEAT_EVERY) {
            self.heartbeat = Some(Instant::now());
            self.bus.send(0x700 + u16::from(HOST.0), &[5])?;
        }
        Ok(())
    }

    /// Asks about an object; `None` without an answer in time.
    fn ask(&mut self, axis: usize, object: Object, question: [u8; 8]) -> Result<Option<Answer>, LinkError> {
        // a drive that is set up already watches while the other is asked, which takes seconds on a slow bus
        self.beat()?;
        let node = u16::from(self.drives[axis].node);
        self.bus.send(0x600 + node, &question)?;
        self.questions += u32::from(object == object::DEVICE_TYPE);
        let end = Instant::now() + ANSWER_WITHIN;
        while let Some((identifier, data)) = self.hear(end)? {
            if identifier == 0x580 + node
                && let Some(answer) = object::answer(object, &data)
            {
                return Ok(Some(answer));
            }
        }
        Ok(None)
    }

    /// An object's value; `None` when the drive has none.
    fn read(&mut self, axis: usize, object: Object) -> Result<Option<u32>, LinkError> {
        for _ in 0..3 {
            match self.ask(axis, object, object::upload(object))? {
                Some(Answer::Value(value)) => return Ok(Some(value)),
                Some(_) => return Ok(None),
                None => {}
            }
        }
        let reason =
            format!("no answer to a question for object 0x{:04x}; are node and bit rate right?", object.0);
        Err(self.wrong(axis, reason))
    }

    fn write(&mut self, axis: usize, object: Object, value: u32) -> Result<(), LinkError> {
        for _ in 0..3 {
            match self.ask(axis, object, object::download(object, value))? {
                Some(Answer::Abort(code)) => {
                    let why = object::abort_name(code);
                    let reason =
                        format!("object 0x{:04x}.{} = {value}: {why} (0x{code:08x})", object.0, object.1);
                    return Err(self.wrong(axis, reason));
                }
                Some(_) => return Ok(()),
                None => {}
            }
        }
        Err(self.wrong(axis, format!("no answer to a new value for object 0x{:04x}", object.0)))
    }

    /// A SYNC, and what every drive measures by it.
    fn exchange(&mut self) -> Result<(), LinkError> {
        self.beat()?;
        // answers to the last SYNC that were late: left in the queue, every later reading would be as old
        while self.hear(Instant::now() + LATE_WITHIN)?.is_some() {}
        let late = self.drives.each_mut().map(|drive| std::mem::take(&mut drive.fresh));
        let asked = Instant::now();
        self.drives.iter_mut().for_each(|drive| drive.syncs.ask(asked));
        self.bus.send(0x080, &[])?;
        // a drive that is slow is waited for longer: questions that pile up would be answered one by one, each about the past
        let waiting = self.drives.iter().map(|drive| drive.syncs.waiting()).max().unwrap_or(1);
        let end = asked + READINGS_WITHIN * waiting.clamp(1, LONGEST_ROUNDS);
        while self.drives.iter().any(|drive| !drive.fresh) && self.hear(end)?.is_some() {}
        for (drive, late) in self.drives.iter_mut().zip(late) {
            drive.fresh |= late;
        }
        Ok(())
    }

    fn control(&mut self, axis: usize, word: u16, target: i32) -> Result<(), LinkError> {
        let ([low, high], [a, b, c, d]) = (word.to_le_bytes(), target.to_le_bytes());
        self.bus.send(0x200 + u16::from(self.drives[axis].node), &[low, high, a, b, c, d])
    }

    /// Resets a fault: only the rising edge of bit 7 counts. Whether the drive left it in time.
    fn reset_fault(&mut self, axis: usize) -> Result<bool, LinkError> {
        let end = Instant::now() + RESET_WITHIN;
        for edge in [0x00, 0x80].into_iter().cycle() {
            self.drives.iter_mut().for_each(|drive| drive.fresh = false);
            self.exchange()?;
            let drive = &self.drives[axis];
            if drive.fresh && !matches!(drive.power, Power::Fault | Power::Unknown) {
                return Ok(true);
            }
            if Instant::now() >= end {
                break;
            }
            if let Some(position) = drive.position {
                self.control(axis, edge, position)?;
            }
        }
        Ok(false)
    }

    /// Asks for the next slow reading; its answer comes when it comes.
    fn ask_slowly(&mut self, round: u32) -> Result<(), LinkError> {
        let turn = (round / SLOW_ROUNDS) as usize;
        for (axis, drive) in self.drives.iter_mut().enumerate() {
            let waits = drive.asked.is_some_and(|(_, asked)| asked.elapsed() < ANSWER_WITHIN);
            let object = if drive.power == Power::Fault && drive.error == 0 {
                object::ERROR_CODE
            } else if round.is_multiple_of(SLOW_ROUNDS) && turn % 2 == axis {
                SLOW[turn / 2 % SLOW.len()]
            } else {
                continue;
            };
            if !waits {
                drive.asked = Some((object, Instant::now()));
                self.bus.send(0x600 + u16::from(drive.node), &object::upload(object))?;
            }
        }
        Ok(())
    }

    /// Leads a drive that follows through its homing; it is sent set points again when this is over.
    fn find_zero(&mut self, axis: usize) -> Result<(), LinkError> {
        let Some(position) = self.drives[axis].position else { return Ok(()) };
        let enabled = Power::Enabled.next_control();
        match self.drives[axis].zero {
            Zero::Idle => {
                self.write(axis, object::MODE, object::HOMING)?;
                let end = Instant::now() + MODE_WITHIN;
                // the rising edge counts only in the mode, which is entered with a SYNC or in the drive's own time
                while self.read(axis, object::MODE_NOW)? != Some(object::HOMING) {
                    if Instant::now() > end {
                        return self.end_homing(axis, Zero::Failed);
                    }
                    self.control(axis, enabled, position)?;
                    self.exchange()?;
                }
                self.drives[axis].zero = Zero::Seeking(Instant::now(), false);
                self.control(axis, enabled | BEGIN_HOMING, position)?;
            }
            Zero::Seeking(..) => match self.drives[axis].zero.hear(self.drives[axis].status) {
                zero @ Zero::Seeking(..) => {
                    self.drives[axis].zero = zero;
                    self.control(axis, enabled | BEGIN_HOMING, position)?;
                }
                ended => self.end_homing(axis, ended)?,
            },
            Zero::Found | Zero::Failed => self.control(axis, enabled, position)?,
        }
        Ok(())
    }

    /// Back to set points, the first of which is where it stands.
    fn end_homing(&mut self, axis: usize, ended: Zero) -> Result<(), LinkError> {
        self.drives[axis].zero = ended;
        if let Some(position) = self.drives[axis].position {
            self.control(axis, Power::Enabled.next_control(), position)?;
        }
        self.write(axis, object::MODE, object::CYCLIC_POSITION)
    }
}

impl Actuators for Cia402 {
    fn listen(&mut self, round: u32) -> Result<[Sample; 2], LinkError> {
        self.exchange()?;
        self.ask_slowly(round)?;
        Ok(self.drives.each_mut().map(Drive::sample))
    }

    fn tell(&mut self, setpoints: [Option<Setpoint>; 2]) -> Result<(), LinkError> {
        for (axis, setpoint) in setpoints.into_iter().enumerate() {
            let home = setpoint.is_some_and(|setpoint| setpoint.home);
            match self.drives[axis].zero {
                Zero::Seeking(..) if !home => self.end_homing(axis, Zero::Idle)?, // ordered to stop
                Zero::Found | Zero::Failed if !home => self.drives[axis].zero = Zero::Idle,
                _ if home && self.drives[axis].power == Power::Enabled => {
                    self.find_zero(axis)?;
                    continue;
                }
                _ => {}
            }
            let drive = &mut self.drives[axis];
            let Some(setpoint) = setpoint else {
                drive.rest();
                continue;
            };
            // until it follows, its target is where it stands
            let target = match (drive.power, drive.position) {
                (Power::Enabled, _) => drive.counts(setpoint.position_urad),
                (_, Some(position)) => position,
                (_, None) => continue,
            };
            if let Some(word) = drive.lead() {
                self.control(axis, word, target)?;
            }
        }
        Ok(())
    }

    fn witnesses(&mut self) -> Result<[Option<Witness>; 2], LinkError> {
        let mut witnesses = [None; 2];
        for (axis, witness) in witnesses.iter_mut().enumerate() {
            let Some(increments_per_turn) = self.drives[axis].increments_per_turn else { continue };
            let counts = self.read(axis, object::INCREMENTS)?;
            *witness = counts.map(|counts| Witness {
                what: "its encoder (object 0x6063)",
                counts: counts as i32,
                urad_per_count: std::f64::consts::TAU * 1e6 / increments_per_turn,
            });
        }
        Ok(witnesses)
    }

    fn units(&self, axis: usize) -> String {
        self.drives[axis].units.clone()
    }

    fn recover(&mut self) -> Result<(), LinkError> {
        for axis in 0..2 {
            if self.drives[axis].restarted {
                self.start(axis)?;
                self.drives[axis].rest();
            }
            if self.drives[axis].power == Power::Fault || self.drives[axis].error != 0 {
                if self.reset_fault(axis)? {
                    self.drives[axis].error = 0;
                }
                self.drives[axis].rest();
            }
        }
        Ok(())
    }

    fn leave(&mut self) {
        for axis in 0..2 {
            if self.watched[axis] {
                // a bus that is gone needs no farewell
                let _ = self.write(axis, object::WATCHED_HEARTBEAT, 0);
            }
        }
    }

    fn errors(&self) -> [Vec<String>; 2] {
        [0, 1].map(|axis: usize| {
            let bus = self.bus.trouble.iter().map(|trouble| format!("CAN controller: {trouble}"));
            self.drives[axis].errors().into_iter().chain(bus).collect()
        })
    }

    fn counters(&self) -> LinkCounters {
        LinkCounters { frames: self.bus.received, ..LinkCounters::default() }
    }
}
