//! Two servos on a half-duplex bus as a rig. Makes differ in packets and registers ([`Table`]) and in nothing else.
//!
//! Torque is switched on by arming and never off. Its first goal is where the shaft stands, and no goal is ever far beyond
//! that: should this program die in mid-move, the shaft stops soon, with or without a watchdog in the servo.

use std::path::Path;
use std::time::{Duration, Instant};

use firmware_protocol::config::Home;
use firmware_protocol::{AxisConfig, LinkCounters, Reading, Sense, Setpoint};

use super::LinkError;
use super::hosted::{Actuators, HostedLink, Make, Sample};

mod bus;

pub use bus::{Answer, BROADCAST, Bus, Register, Wire, instruction};

/// Rounds between two looks at the torque switch.
const SLOW_ROUNDS: u32 = 10;
/// How far a goal may lie beyond where the shaft was last seen: 7 degrees. A shaft that lags more than 5.7 degrees behind the
/// state machine's set point is at fault.
const FARTHEST_GOAL_COUNTS: i32 = 80;
/// Counts of the turn in which every position and every goal lies.
pub const TURN_COUNTS: std::ops::RangeInclusive<i32> = 0..=COUNTS as i32 - 1;
/// Position at the middle of the horn's turn, counts.
pub const CENTRE: i32 = 2048;
/// Counts of a turn.
const COUNTS: i64 = 4096;
/// A turn, µrad.
const TURN_URAD: i64 = 6_283_185;
/// One count, µrad, rounded up.
const COUNT_URAD: i32 = (TURN_URAD / COUNTS) as i32 + 1;
/// Error of the encoder's scale: 0.5 degrees at room temperature (ams AS5045 data sheet, "INLopt"; ROBOTIS uses that one,
/// Feetech names none).
const ACCURACY_URAD: i32 = 8727;

/// Counts to an angle from the centre, µrad.
pub(crate) fn urad(counts: i32) -> i32 {
    let scaled = (i64::from(counts) - i64::from(CENTRE)) * TURN_URAD / COUNTS;
    scaled.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

/// An angle from the centre to the nearest count.
pub(crate) fn counts(urad: i32) -> i32 {
    let scaled = i64::from(urad) * COUNTS;
    let half = if scaled < 0 { -TURN_URAD / 2 } else { TURN_URAD / 2 };
    CENTRE + ((scaled + half) / TURN_URAD) as i32
}

/// The goal for an angle: within the servo's limits, and never far beyond the shaft.
fn goal_counts(position_urad: i32, (low, high): (i32, i32), shaft: i32) -> i32 {
    counts(position_urad)
        .clamp(low, high)
        .clamp(shaft.saturating_sub(FARTHEST_GOAL_COUNTS), shaft.saturating_add(FARTHEST_GOAL_COUNTS))
}

fn degrees(counts: i32) -> f64 {
    f64::from(urad(counts)) * 1e-6f64.to_degrees()
}

/// The registers of a make, and one servo of it as it was found and last read. Each register that is read has a length of
/// its own, see [`bus`].
pub trait Table: Sized + Send + 'static {
    /// How the make packs questions.
    type Wire: Wire;
    /// The make's name in addresses.
    const NAME: &'static str;
    /// Play that the encoder, which sits on the output, sees, µrad.
    const PLAY_URAD: i32;
    /// What is asked for its length alone.
    const FENCE: Register;
    /// All that is measured, in one read.
    const MEASURED: Register;
    /// The present position.
    const POSITION: Register;
    /// What is asked now and then; its first byte is the torque switch.
    const TORQUE: Register;
    const GOAL: Register;
    /// Written before the first goal, so that this program alone makes the profile.
    const PREPARE: &'static [(Register, &'static [u8])];
    /// Silence after which the servo stops by itself, and the value for that; 0 switches it off.
    const WATCHDOG: Option<(Register, u8)>;
    /// Registers of lowest and highest position, for whoever has to change them.
    const LIMITS: &'static str;
    /// What to look at when a servo stands where no goal leads.
    const OUTSIDE: &'static str;

    /// Looks at one servo before anything is written to it. What this program cannot work with is refused.
    fn find(bus: &mut Bus<Self::Wire>, id: u8) -> Result<Self, LinkError>;

    /// Its own lowest and highest position, counts.
    fn limits(&self) -> (i32, i32);

    /// Its own lowest and highest supply, 0.1 V.
    fn supply_limits(&self) -> (u16, u16);

    /// Whether it answers when a register is written.
    fn answers_writes(&self) -> bool;

    /// The position within [`Self::MEASURED`], counts.
    fn position(measured: &[u8]) -> i32;

    /// The bytes of a goal.
    fn goal(counts: i32) -> Vec<u8>;

    /// Takes the rest of what was measured, and what was asked now and then; changes the reading where the servo doubts it.
    fn take(&mut self, measured: Option<&Answer>, slow: Option<&[u8]>, sense: &mut Sense);

    /// Why it refused a write; `None` when it took it.
    fn refusal(&self, error: u8) -> Option<String>;

    /// Takes back a shutdown, if there is one; how long the servo needs for that.
    fn reset(&mut self, bus: &mut Bus<Self::Wire>, id: u8) -> Result<Option<Duration>, LinkError>;

    /// Its errors, in words.
    fn errors(&self) -> Vec<String>;
}

/// A register with which this program cannot work.
pub(crate) fn refuse(
    path: &str,
    id: u8,
    register: &str,
    found: i64,
    expected: &str,
    advice: &str,
) -> LinkError {
    let reason = format!("{register} is {found}, expected {expected}; {advice}");
    LinkError::Open { path: format!("{path}, servo {id}"), reason }
}

/// Opens a bus and finds its two servos; the first is axis 0.
pub(super) fn open<T: Table>(path: &Path, baud: u32, ids: [u8; 2]) -> Result<HostedLink, LinkError> {
    let mut bus = Bus::open(path, baud, T::FENCE)?;
    let servos = [BusServo::<T>::find(&mut bus, ids[0])?, BusServo::find(&mut bus, ids[1])?];
    bus.end_opening();
    let make = Make {
        uid: u64::from(ids[0]) << 8 | u64::from(ids[1]),
        ranges_urad: servos.each_ref().map(|servo| {
            let (low, high) = servo.table.limits();
            (urad(low), urad(high))
        }),
        accuracy_urad: ACCURACY_URAD,
        resolutions_urad: [COUNT_URAD; 2],
        play_urad: T::PLAY_URAD,
        lost_motion_urad: 0,
        supply_minimum_mv: servos.each_ref().map(|servo| supply_minimum_mv(servo.table.supply_limits())),
        homes: [Home::Absolute; 2],
    };
    let name = format!("{}:{}", T::NAME, bus.path());
    HostedLink::start(name, BusServos { bus, servos }, &make)
}

/// The usual minimum is that of 12 V servos. One that bears no such supply has a minimum of its own.
fn supply_minimum_mv((low, high): (u16, u16)) -> u16 {
    let usual_mv = AxisConfig::default().supply_minimum_mv;
    let high_mv = high.saturating_mul(100);
    if (1..=usual_mv).contains(&high_mv) { low.saturating_mul(100) } else { usual_mv }
}

/// One servo, as last read.
struct BusServo<T> {
    id: u8,
    table: T,
    sense: Sense,
    /// Where it was last seen within its turn, counts.
    position: i32,
    /// The position that it reports, where that lies outside its turn.
    outside: Option<i32>,
    between: [Instant; 2],
    /// Why it is not driven, or what it last answered to a write that it refused.
    refused: Option<String>,
    /// Torque was switched on since it was last to be off: should it vanish, it was the servo that dropped it.
    switched_on: bool,
}

impl<T: Table> BusServo<T> {
    fn find(bus: &mut Bus<T::Wire>, id: u8) -> Result<Self, LinkError> {
        let table = T::find(bus, id)?;
        let measured = bus.read_patiently(id, T::MEASURED)?.ok_or_else(|| LinkError::Open {
            path: format!("{}, servo {id}", bus.path()),
            reason: format!("no answer to a question for registers {} and following", T::MEASURED.0),
        })?;
        let position = T::position(&measured);
        let (low, high) = table.limits();
        if !(low..=high).contains(&position) {
            let register = format!("register {} (present position)", T::POSITION.0);
            let expected = format!("{low} to {high} (its limits, {})", T::LIMITS);
            let advice = format!(
                "the first goal must be where the shaft stands: turn it by hand to between {:.1} and {:.1} deg with torque \
                 off, and look at {}",
                degrees(low),
                degrees(high),
                T::OUTSIDE
            );
            return Err(refuse(bus.path(), id, &register, position.into(), &expected, &advice));
        }
        let (sense, between) = (Sense::UNREAD, [Instant::now(); 2]);
        Ok(Self { id, table, sense, position, outside: None, between, refused: None, switched_on: false })
    }

    fn take(&mut self, measured: Option<&Answer>, slow: Option<&Answer>) {
        let slow = slow.map(|answer| &answer.data[..]);
        self.sense.reading = Reading::Missing;
        if let Some(answer) = measured {
            let position = T::position(&answer.data);
            self.outside = (!TURN_COUNTS.contains(&position)).then_some(position);
            self.sense.reading = Reading::Invalid;
            if self.outside.is_none() {
                self.position = position;
                self.sense.reading = Reading::Measured(urad(position));
            }
        }
        if let Some(bytes) = slow {
            self.sense.torque = bytes[0] == 1;
        }
        self.table.take(measured, slow, &mut self.sense);
    }

    fn errors(&self) -> Vec<String> {
        let outside = self.outside.map(|position| {
            let (register, turn) = (T::POSITION.0, TURN_COUNTS);
            format!(
                "register {register} (present position) is {position}, outside its turn ({} to {})",
                turn.start(),
                turn.end()
            )
        });
        self.table.errors().into_iter().chain(outside).chain(self.refused.clone()).collect()
    }
}

struct BusServos<T: Table> {
    bus: Bus<T::Wire>,
    servos: [BusServo<T>; 2],
}

impl<T: Table> BusServos<T> {
    /// Whether the servo took the value; a refusal is listed among its errors.
    fn write(&mut self, axis: usize, register: Register, values: &[u8]) -> Result<bool, LinkError> {
        let servo = &mut self.servos[axis];
        if !servo.table.answers_writes() {
            self.bus.write_unanswered(servo.id, register, values)?;
            return Ok(true);
        }
        let answer = self.bus.write(servo.id, register, values)?;
        servo.refused = answer.and_then(|error| servo.table.refusal(error));
        Ok(answer.is_some() && servo.refused.is_none())
    }

    /// The goal first: with torque on, the shaft goes where the goal register happens to say. Wherever the state machine
    /// thinks the shaft to be, the first goal is where it was seen just now.
    fn switch_on(&mut self, axis: usize) -> Result<(), LinkError> {
        let servo = &mut self.servos[axis];
        let (low, high) = servo.table.limits();
        if !matches!(servo.sense.reading, Reading::Measured(_)) {
            return Ok(());
        }
        if !(low..=high).contains(&servo.position) {
            servo.refused = Some(format!(
                "torque stays off: it stands at {:.1} deg, outside its limits of {:.1} to {:.1} deg",
                degrees(servo.position),
                degrees(low),
                degrees(high)
            ));
            return Ok(());
        }
        let goal = T::goal(servo.position);
        for (register, values) in T::PREPARE {
            self.write(axis, *register, values)?;
        }
        if !self.write(axis, T::GOAL, &goal)? || !self.write(axis, (T::TORQUE.0, 1), &[1])? {
            return Ok(());
        }
        if let Some((register, value)) = T::WATCHDOG
            && !self.write(axis, register, &[value])?
        {
            return Ok(());
        }
        let servo = &mut self.servos[axis];
        (servo.sense.torque, servo.switched_on) = (true, true);
        Ok(())
    }
}

impl<T: Table> Actuators for BusServos<T> {
    fn listen(&mut self, round: u32) -> Result<[Sample; 2], LinkError> {
        let ids = self.servos.each_ref().map(|servo| servo.id);
        let asked = Instant::now();
        let measured = self.bus.sync_read(ids, T::MEASURED)?;
        let answered = Instant::now();
        let slow = if round.is_multiple_of(SLOW_ROUNDS) {
            self.bus.sync_read(ids, T::TORQUE)?
        } else {
            [None, None]
        };
        for ((servo, measured), slow) in self.servos.iter_mut().zip(&measured).zip(&slow) {
            servo.take(measured.as_ref(), slow.as_ref());
            if measured.is_some() {
                servo.between = [asked, answered];
            }
        }
        Ok(self.servos.each_ref().map(|servo| Sample { sense: servo.sense, between: servo.between }))
    }

    fn tell(&mut self, setpoints: [Option<Setpoint>; 2]) -> Result<(), LinkError> {
        let mut goals = Vec::new();
        for (axis, setpoint) in setpoints.into_iter().enumerate() {
            let servo = &mut self.servos[axis];
            let Some(setpoint) = setpoint else {
                servo.switched_on = false;
                continue;
            };
            if !servo.switched_on {
                self.switch_on(axis)?;
            } else if servo.sense.torque {
                let goal = goal_counts(setpoint.position_urad, servo.table.limits(), servo.position);
                goals.push((servo.id, T::goal(goal)));
            }
        }
        if goals.is_empty() { Ok(()) } else { self.bus.sync_write(T::GOAL, &goals) }
    }

    fn recover(&mut self) -> Result<(), LinkError> {
        let mut longest = Duration::ZERO;
        for servo in &mut self.servos {
            servo.refused = None;
            if let Some(wait) = servo.table.reset(&mut self.bus, servo.id)? {
                (servo.switched_on, servo.sense.torque) = (false, false);
                longest = longest.max(wait);
            }
        }
        std::thread::sleep(longest);
        Ok(())
    }

    fn leave(&mut self) {
        for servo in &self.servos {
            if let Some((register, _)) = T::WATCHDOG {
                let _ = self.bus.write(servo.id, register, &[0]); // a bus that is gone needs no farewell
            }
        }
    }

    fn errors(&self) -> [Vec<String>; 2] {
        self.servos.each_ref().map(BusServo::errors)
    }

    fn counters(&self) -> LinkCounters {
        LinkCounters {
            frames: self.bus.answers,
            checksum_errors: self.bus.damaged(),
            ..LinkCounters::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::{dynamixel, feetech};

    #[test]
    fn counts_and_angles_agree() {
        assert_eq!((urad(2048), urad(3072), urad(0)), (0, 1_570_796, -3_141_592));
        for count in TURN_COUNTS {
            assert_eq!(counts(urad(count)), count);
        }
    }

    #[test]
    fn a_goal_stays_within_limits_and_near_the_shaft() {
        let goal = |wanted, shaft| goal_counts(urad(wanted), (1000, 3000), shaft);
        assert_eq!([goal(2100, 2050), goal(4000, 2050), goal(0, 2050)], [2100, 2130, 1970]);
        assert_eq!([goal(3050, 2990), goal(950, 1010)], [3000, 1000]);
    }

    /// An answer does not name its register: only its length tells which question it answers.
    #[test]
    fn every_register_that_is_read_has_a_length_of_its_own() {
        let tables = [dynamixel::READ.as_slice(), feetech::READ.as_slice()];
        for table in tables {
            let mut lengths: Vec<_> = table.iter().map(|(_, length)| *length).chain([0]).collect();
            lengths.sort_unstable();
            lengths.dedup();
            assert_eq!(lengths.len(), table.len() + 1, "{table:?}");
        }
    }
}
