//! The one state machine of a rig: boot, idle, homing, moving, holding, fault, e-stop.
//!
//! Nothing moves before it is armed, and only along straight segments that stay inside every limit and outside the
//! keep-out region. A fault decelerates, holds and disarms; it stays until it is cleared by name with its cause gone.

use crate::ALL_AXES;
use crate::command::Command;
use crate::config::{Config, Home};
use crate::fault::{Fault, Faults};
use crate::profile::Path;
use crate::report::{AckCode, Report, ResetCause, Source, State};
use crate::servo::{Reading, Sense, Servo, Setpoint};

mod homing;
mod orders;
mod telling;
mod watch;

/// Time a move may take to settle after its path ended, µs.
const SETTLE_US: u64 = 1_000_000;
/// Without a heartbeat for so long the host may be dead: what moves brakes, and goes on when it comes again. A pair that
/// coasted until the agreed timeout would be 30 degrees further.
const SILENCE_US: u64 = 150_000;
/// Readings that stay together for so long after a stop are those of a shaft that stands, µs.
const REST_US: u64 = 300_000;

/// One axis as the state machine knows it.
#[derive(Clone, Copy, Debug)]
struct Axis {
    sense: Sense,
    /// Last valid angle, µrad, and between which times it was read.
    measured_urad: i32,
    measured_us: u64,
    asked_us: u64,
    /// Readings in a row that did not come.
    unanswered: u32,
    /// Lowest and highest set point since it was read.
    swept_urad: (i32, i32),
    /// Setpoint of the servo.
    setpoint_urad: i32,
    /// Where the last order wants it.
    target_urad: i32,
    speed_urad_s: i32,
    acceleration_urad_s2: i32,
    homed: bool,
    /// Whether readings count from a known zero: those of an absolute encoder do, until it was caught lying.
    has_zero: bool,
    seeking: Option<homing::Seeking>,
    /// What is added to readings: where an encoder that counts from its start was found to stand.
    offset_urad: i32,
    /// Since when the angle is near `quiet_urad`.
    quiet_us: u64,
    quiet_urad: i32,
    following_since: Option<u64>,
    stall_since: Option<u64>,
    current_since: Option<u64>,
    supply_since: Option<u64>,
    jumped_us: Option<u64>,
    torque_wanted_since: Option<u64>,
    reported_urad: i32,
}

impl Axis {
    /// Its zero is known from now on, or not any more.
    fn set_homed(&mut self, homed: bool) {
        (self.homed, self.has_zero) = (homed, homed);
    }

    /// Gives every angle another zero; nothing moves by it.
    fn shift(&mut self, by_urad: i32) {
        self.offset_urad = self.offset_urad.saturating_add(by_urad);
        for angle in [
            &mut self.measured_urad,
            &mut self.setpoint_urad,
            &mut self.target_urad,
            &mut self.quiet_urad,
            &mut self.reported_urad,
            &mut self.swept_urad.0,
            &mut self.swept_urad.1,
        ] {
            *angle = angle.saturating_add(by_urad);
        }
    }
}

/// An order that was answered already.
#[derive(Clone, Copy, Debug)]
struct Answered {
    id: u16,
    message: u8,
    code: AckCode,
    detail: i32,
}

/// A latched fault's circumstances.
#[derive(Clone, Copy, Debug, Default)]
struct Latched {
    axis: u8,
    time_us: u64,
    detail: i32,
}

/// The state machine of a rig with `N` axes.
#[derive(Clone, Debug)]
pub struct Controller<S, const N: usize> {
    config: Config<N>,
    servos: [S; N],
    axes: [Axis; N],
    reset: ResetCause,
    state: State,
    armed: bool,
    local_switch_closed: bool,
    session: Option<u32>,
    heartbeat_timeout_us: u64,
    heartbeat_us: u64,
    faults: Faults,
    latched: [Latched; Fault::ALL.len()],
    path: Option<Path<N>>,
    path_ended_us: Option<u64>,
    disarm_when_stopped: bool,
    /// Since when it is about to rest: disarmed, and not yet known to stand.
    resting_since_us: Option<u64>,
    moved_by: u16,
    last_order: Option<u16>,
    answered: [Option<Answered>; 16],
    answered_next: usize,
    stepped_us: u64,
    now_us: u64,
    homing_since_us: u64,
    homing: [bool; N],
    schedule: telling::Schedule,
}

impl<S: Servo, const N: usize> Controller<S, N> {
    /// A rig that has just started.
    pub fn new(config: Config<N>, servos: [S; N], reset: ResetCause, now_us: u64) -> Self {
        let axes = core::array::from_fn(|axis| Axis {
            sense: Sense::UNREAD,
            measured_urad: 0,
            measured_us: now_us,
            asked_us: now_us,
            unanswered: 0,
            swept_urad: (0, 0),
            setpoint_urad: 0,
            target_urad: 0,
            speed_urad_s: config.axes[axis].top_speed_urad_s,
            acceleration_urad_s2: config.axes[axis].top_acceleration_urad_s2,
            homed: false,
            has_zero: config.axes[axis].home == Home::Absolute,
            seeking: None,
            offset_urad: 0,
            quiet_us: now_us,
            quiet_urad: 0,
            following_since: None,
            stall_since: None,
            current_since: None,
            supply_since: None,
            jumped_us: None,
            torque_wanted_since: None,
            reported_urad: 0,
        });
        Self {
            config,
            servos,
            axes,
            reset,
            state: State::Boot,
            armed: false,
            local_switch_closed: true,
            session: None,
            heartbeat_timeout_us: 0,
            heartbeat_us: now_us,
            faults: Faults::default(),
            latched: [Latched::default(); Fault::ALL.len()],
            path: None,
            path_ended_us: None,
            disarm_when_stopped: false,
            resting_since_us: None,
            moved_by: 0,
            last_order: None,
            answered: [None; 16],
            answered_next: 0,
            stepped_us: now_us,
            now_us,
            homing_since_us: now_us,
            homing: [false; N],
            schedule: telling::Schedule::new(now_us),
        }
    }

    /// What it is doing.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether motion is allowed.
    pub fn armed(&self) -> bool {
        self.armed
    }

    /// Latched faults.
    pub fn faults(&self) -> Faults {
        self.faults
    }

    /// The actuator of an axis, for tests and for faults on demand.
    pub fn servo_mut(&mut self, axis: usize) -> Option<&mut S> {
        self.servos.get_mut(axis)
    }

    /// The actuators, for what comes after a restart.
    pub fn into_servos(self) -> [S; N] {
        self.servos
    }

    /// The local e-stop switch: open stops the rig as [`Fault::EStop`], and that cannot be cleared before it closes.
    pub fn set_local_switch(&mut self, closed: bool) {
        self.local_switch_closed = closed;
    }

    /// Takes one command; answers go to `tell`.
    pub fn handle(&mut self, now_us: u64, command: &Command, tell: &mut impl FnMut(Report)) {
        self.now_us = self.now_us.max(now_us);
        self.execute(command, tell);
    }

    /// Reads the actuators, looks for faults, moves on, tells the actuators where to be, reports. Call it about every
    /// millisecond; a late call moves late, never far.
    pub fn step(&mut self, now_us: u64, tell: &mut impl FnMut(Report)) {
        self.now_us = self.now_us.max(now_us);
        let elapsed_us = self.now_us - core::mem::replace(&mut self.stepped_us, self.now_us);
        self.read();
        self.watch(tell);
        self.advance(elapsed_us, tell);
        self.drive();
        self.report(tell);
    }

    fn advance(&mut self, elapsed_us: u64, tell: &mut impl FnMut(Report)) {
        if self.state == State::Boot {
            let ready = self
                .axes
                .iter()
                .all(|axis| matches!(axis.sense.reading, Reading::Measured(_) | Reading::Unmeasured));
            if ready {
                self.state = State::Idle;
                for axis in &mut self.axes {
                    axis.setpoint_urad = axis.measured_urad;
                    axis.target_urad = axis.measured_urad;
                }
            }
        }
        let blind = self.is_blind();
        let pause = (self.armed && self.silence_us() > SILENCE_US).then(|| self.brake_urad_s2());
        if let Some(path) = self.path.as_mut().filter(|_| !blind) {
            path.pause(pause);
            path.advance(elapsed_us);
            let path = *path;
            for (number, axis) in self.axes.iter_mut().enumerate() {
                axis.setpoint_urad = path.position_urad(number);
            }
            if path.finished() {
                self.path = None;
                self.path_ended_us = Some(self.now_us);
                if path.is_braking() {
                    self.rest_at_setpoint();
                }
            }
        }
        self.come_to_rest();
        match self.state {
            State::Moving if self.path.is_none() => self.settle(tell),
            State::Homing => self.home(tell),
            // a shaft without torque goes where it will; when the torque comes back it must not jump to where it was
            State::Fault | State::EStop if self.path.is_none() => {
                for axis in &mut self.axes {
                    if !axis.sense.torque && matches!(axis.sense.reading, Reading::Measured(_)) {
                        axis.setpoint_urad = axis.measured_urad;
                        axis.target_urad = axis.measured_urad;
                    }
                }
            }
            State::Idle => {
                for (axis, config) in self.axes.iter_mut().zip(&self.config.axes) {
                    if !config.holds_when_idle && axis.sense.reading != Reading::Unmeasured {
                        axis.setpoint_urad = axis.measured_urad;
                    }
                }
            }
            _ => {}
        }
    }

    /// Stopped before the target: what it stands on is the target now.
    fn rest_at_setpoint(&mut self) {
        let disarmed = core::mem::take(&mut self.disarm_when_stopped) || !self.armed;
        if disarmed {
            self.push_nowhere();
            self.resting_since_us = Some(self.now_us);
        }
        for axis in &mut self.axes {
            axis.target_urad = axis.setpoint_urad;
        }
        if disarmed {
            self.armed = false;
            if self.faults.is_empty() && self.state != State::Boot {
                self.state = State::Idle;
            }
        }
    }

    /// A rig that may not move pushes nowhere either: what little the servo lags behind would go on for ever behind an
    /// encoder that stopped counting.
    fn push_nowhere(&mut self) {
        for axis in &mut self.axes {
            if matches!(axis.sense.reading, Reading::Measured(_)) {
                axis.setpoint_urad = axis.measured_urad;
                axis.target_urad = axis.measured_urad;
            }
        }
    }

    /// Once a disarmed rig stands, its setpoint at the moment that it stopped is no longer its position: shafts
    /// swing on and come back. Once, not ever again: a load would pull a set point along that follows it.
    fn come_to_rest(&mut self) {
        if self.armed {
            self.resting_since_us = None;
        }
        let Some(since_us) = self.resting_since_us.filter(|_| self.path.is_none()) else { return };
        let stands = |axis: &Axis| {
            let is_measured = matches!(axis.sense.reading, Reading::Measured(_));
            !is_measured || axis.asked_us.saturating_sub(axis.quiet_us.max(since_us)) > REST_US
        };
        if self.axes.iter().all(stands) {
            self.push_nowhere();
            self.resting_since_us = None;
        }
    }

    fn settle(&mut self, tell: &mut impl FnMut(Report)) {
        let (mut worst, mut late) = (0, None);
        for (number, axis) in self.axes.iter().enumerate() {
            let error = (axis.target_urad.saturating_sub(axis.measured_urad)).saturating_abs();
            worst = worst.max(error);
            if error > self.config.axes[number].tolerance_urad {
                late = Some((number, error));
            }
        }
        let ended_us = self.path_ended_us.unwrap_or(self.now_us);
        match late {
            None => {
                self.state = State::Holding;
                tell(Report::Done { id: self.moved_by, axis: ALL_AXES, error_urad: worst });
            }
            Some((axis, error)) if self.now_us.saturating_sub(ended_us) > SETTLE_US => {
                self.raise(Fault::FollowingError, axis as u8, error, tell);
            }
            Some(_) => {}
        }
    }

    fn drive(&mut self) {
        let moving = self.path.filter(|_| !self.is_blind());
        for (number, (servo, axis)) in self.servos.iter_mut().zip(&mut self.axes).enumerate() {
            let config = &self.config.axes[number];
            let faulted = !self.faults.is_empty();
            let torque = match self.state {
                State::Boot => false,
                // a servo that measures nothing would jump when switched on: only arming does that
                State::Idle => {
                    config.holds_when_idle
                        && (axis.sense.reading != Reading::Unmeasured || axis.torque_wanted_since.is_some())
                }
                State::Fault | State::EStop => axis.torque_wanted_since.is_some(),
                _ => true,
            };
            match (torque, axis.torque_wanted_since) {
                (true, None) => axis.torque_wanted_since = Some(self.now_us),
                (false, _) => axis.torque_wanted_since = None,
                _ => {}
            }
            let (low, high) = axis.swept_urad;
            axis.swept_urad = (low.min(axis.setpoint_urad), high.max(axis.setpoint_urad));
            servo.drive(
                self.now_us,
                Setpoint {
                    home: axis.seeking == Some(homing::Seeking::ByServo),
                    torque,
                    position_urad: axis.setpoint_urad.saturating_sub(axis.offset_urad),
                    velocity_urad_s: moving.map_or(0, |path| path.velocity_urad_s(number)),
                    current_limit_ma: if faulted { config.fault_current_ma } else { config.current_limit_ma },
                },
            );
        }
    }

    fn source(&self, number: usize) -> Source {
        let axis = &self.axes[number];
        let read = if axis.has_zero { Source::Measured } else { Source::NotHomed };
        match axis.sense.reading {
            Reading::Measured(_) => read,
            Reading::Unmeasured => Source::Commanded,
            // one answer that is late is no lie: the position says when it was read
            Reading::Missing if !self.is_missing(number) => read,
            Reading::Missing | Reading::Invalid => Source::Stale,
        }
    }
}

#[cfg(test)]
mod homing_tests;
#[cfg(test)]
mod model_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod rule_tests;
#[cfg(test)]
mod sampling_tests;
#[cfg(test)]
mod telling_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod torque_tests;
