//! Looking for faults, latching them, and knowing when a cause is gone.

use super::homing::Seeking;
use super::{Axis, Controller};
use crate::ALL_AXES;
use crate::config::AxisConfig;
use crate::fault::Fault;
use crate::report::{Report, State};
use crate::servo::{Reading, Servo};

const FOLLOWING_US: u64 = 100_000;
const STALL_US: u64 = 150_000;
const CURRENT_US: u64 = 100_000;
const SUPPLY_US: u64 = 20_000;
/// After a jump, readings must behave for this long before it may be cleared.
const JUMP_QUIET_US: u64 = 500_000;
/// A servo has this long to switch its torque on.
const TORQUE_US: u64 = 50_000;
/// Readings in a row that must stay away before an encoder is missing: one poll may be lost, and time may pass because the
/// host, not the encoder, could not run.
const MISSING_POLLS: u32 = 3;
/// Set points do not go on by readings older than this: a slow poll of one servo of two.
const BLIND_US: u64 = 60_000;
/// How fast a shaft without torque may be turned, by hand or by its load, µrad/s.
const FREE_SPEED_URAD_S: i64 = 6_283_185;
/// A shaft that lags catches up at most at this many times its top speed.
const CATCHING_UP: i64 = 3;
/// Readings within this of each other are at rest: above noise and quantisation of common encoders, µrad.
const REST_URAD: i32 = 2500;

impl<S: Servo, const N: usize> Controller<S, N> {
    /// Takes a reading of every actuator. Motion is judged by the longest time that may lie between the samples, and a driven
    /// shaft's by its setpoint meanwhile: it goes there, and is pushed off at most at its top speed.
    pub(super) fn read(&mut self) {
        for (number, (axis, servo)) in self.axes.iter_mut().zip(&mut self.servos).enumerate() {
            axis.sense = servo.sense(self.now_us);
            let now = match axis.sense.reading {
                Reading::Measured(angle) => angle.saturating_add(axis.offset_urad),
                Reading::Unmeasured => axis.setpoint_urad,
                Reading::Missing | Reading::Invalid => {
                    axis.unanswered = axis.unanswered.saturating_add(1);
                    // a shaft between two readings is as quiet as these are
                    if axis.unanswered >= MISSING_POLLS || axis.sense.reading == Reading::Invalid {
                        axis.quiet_us = self.now_us;
                    }
                    continue;
                }
            };
            let [asked_us, received_us] = axis.sense.sampled_us.map(|stamp| stamp.min(self.now_us));
            let by_itself = axis.seeking == Some(Seeking::ByServo) || self.state == State::Boot;
            if !by_itself
                && axis.sense.reading != Reading::Unmeasured
                && is_jump(axis, &self.config.axes[number], now, received_us)
            {
                axis.jumped_us = Some(self.now_us);
            }
            if now.saturating_sub(axis.quiet_urad).saturating_abs() > REST_URAD {
                axis.quiet_us = self.now_us;
                axis.quiet_urad = now;
            }
            axis.measured_urad = now;
            (axis.asked_us, axis.measured_us, axis.unanswered) = (asked_us, received_us, 0);
            axis.swept_urad = (axis.setpoint_urad, axis.setpoint_urad);
        }
    }

    pub(super) fn watch(&mut self, tell: &mut impl FnMut(Report)) {
        if self.state == State::Boot {
            return;
        }
        if !self.local_switch_closed {
            self.raise(Fault::EStop, ALL_AXES, 0, tell);
        }
        let silence_us = self.silence_us();
        if self.armed && silence_us > self.heartbeat_timeout_us {
            self.raise(Fault::Watchdog, ALL_AXES, (silence_us / 1000) as i32, tell);
        }
        for number in 0..N {
            if let Some((fault, detail)) = self.watch_axis(number) {
                self.raise(fault, number as u8, detail, tell);
            }
        }
        if self.in_keep_out() {
            self.raise(Fault::KeepOut, ALL_AXES, 0, tell);
        }
    }

    /// The first rule an axis breaks that is not latched yet, the most telling first, with the value that broke it. What is
    /// latched hides nothing: a motor that stays hot for minutes may stall meanwhile.
    fn watch_axis(&mut self, number: usize) -> Option<(Fault, i32)> {
        let now = self.now_us;
        let config = self.config.axes[number];
        let missing = self.is_missing(number);
        let axis = &mut self.axes[number];
        let since = |broken: bool, mark: &mut Option<u64>| {
            *mark = if broken { mark.or(Some(now)) } else { None };
            mark.map(|from| now.saturating_sub(from))
        };
        let sense = axis.sense;
        if axis.seeking == Some(Seeking::ByServo) {
            axis.setpoint_urad = axis.measured_urad; // it goes where it will
        }
        let error = axis.setpoint_urad.saturating_sub(axis.measured_urad).saturating_abs();
        let driven = axis.torque_wanted_since;
        let measured = sense.reading != Reading::Unmeasured;
        let current_us = since(sense.current_ma > config.current_limit_ma, &mut axis.current_since);
        let supply_us = since(sense.supply_mv < config.supply_minimum_mv && measured, &mut axis.supply_since);
        let following_us =
            since(error > config.following_urad && driven.is_some(), &mut axis.following_since);
        let away_us = since(error > config.stall_urad && driven.is_some() && measured, &mut axis.stall_since);
        // until the last sample, not until now: what a slow bus has not reported yet may have moved
        let still_us = axis.asked_us.saturating_sub(axis.quiet_us);
        let over = |time: Option<u64>, longest: u64| time.is_some_and(|time| time > longest);
        let is_lost = sense.reading == Reading::Invalid || (sense.reading == Reading::Missing && missing);
        let is_let_go = driven.is_some_and(|from| now.saturating_sub(from) > TORQUE_US) && !sense.torque;
        let rules = [
            (
                sense.temperature_c > config.temperature_limit_c,
                Fault::OverTemperature,
                sense.temperature_c.into(),
            ),
            (over(supply_us, SUPPLY_US), Fault::UnderVoltage, sense.supply_mv.into()),
            (is_lost, Fault::EncoderInvalid, 0),
            (
                axis.jumped_us == Some(now),
                Fault::EncoderJump,
                axis.measured_urad.saturating_sub(axis.setpoint_urad),
            ),
            (is_let_go, Fault::TorqueLost, 0),
            (over(current_us, CURRENT_US), Fault::OverCurrent, sense.current_ma.into()),
            (over(away_us, STALL_US) && still_us > STALL_US, Fault::Stall, error),
            (over(following_us, FOLLOWING_US), Fault::FollowingError, error),
            (axis.homed && outside(axis.measured_urad, &config), Fault::SoftLimit, axis.measured_urad),
        ];
        let new = rules.into_iter().find(|(broken, fault, _)| *broken && !self.faults.contains(*fault));
        new.map(|(_, fault, detail)| (fault, detail))
    }

    /// How long the host is silent, µs.
    pub(super) fn silence_us(&self) -> u64 {
        self.now_us.saturating_sub(self.heartbeat_us)
    }

    /// How hard a path brakes: no axis harder than its own rule.
    pub(super) fn brake_urad_s2(&self) -> i32 {
        self.config.axes.iter().map(AxisConfig::brake_urad_s2).min().unwrap_or(i32::MAX)
    }

    /// Whether an encoder stayed away too often, or tells of too long ago, to move on: the set points wait for it, so what is
    /// moved unseen is little however long the rest of the patience is.
    pub(super) fn is_blind(&self) -> bool {
        let old = |axis: &Axis| self.now_us.saturating_sub(axis.asked_us) > BLIND_US;
        self.axes.iter().any(|axis| axis.unanswered >= MISSING_POLLS || old(axis))
    }

    /// Whether an encoder stayed away for too long and too often.
    pub(super) fn is_missing(&self, number: usize) -> bool {
        let axis = &self.axes[number];
        axis.unanswered >= MISSING_POLLS
            && self.now_us.saturating_sub(axis.measured_us) > self.config.axes[number].missing_us.into()
    }

    fn in_keep_out(&self) -> bool {
        match &self.axes[..] {
            [a, b, ..] => {
                a.homed && b.homed && self.config.keep_out.contains([a.measured_urad, b.measured_urad], 0)
            }
            _ => false,
        }
    }

    /// Latches a fault: stops along the path, or at once where the reading can no longer be followed; disarms.
    pub(super) fn raise(&mut self, fault: Fault, axis: u8, detail: i32, tell: &mut impl FnMut(Report)) {
        if self.faults.contains(fault) {
            return;
        }
        self.faults.insert(fault);
        self.latched[usize::from(fault.code())] = super::Latched { axis, time_us: self.now_us, detail };
        self.armed = false;
        self.disarm_when_stopped = false;
        self.resting_since_us = Some(self.now_us);
        self.end_homing();
        self.state = if self.faults.contains(Fault::EStop) { State::EStop } else { State::Fault };
        match fault {
            Fault::Stall
            | Fault::FollowingError
            | Fault::EncoderInvalid
            | Fault::EncoderJump
            | Fault::OverCurrent
            | Fault::TorqueLost => self.hold_where_measured(),
            _ => {
                let usual = self.brake_urad_s2();
                let hardest = self.config.axes.iter().map(|axis| axis.e_stop_urad_s2).min();
                if let Some(path) = &mut self.path {
                    path.brake(hardest.filter(|_| fault == Fault::EStop).unwrap_or(usual));
                }
            }
        }
        if matches!(fault, Fault::EncoderInvalid | Fault::EncoderJump)
            && let Some(axis) = self.axes.get_mut(usize::from(axis))
        {
            axis.set_homed(false);
        }
        self.tell_fault(fault, tell);
    }

    /// A servo must not push against what stopped it, nor follow an encoder that lies: the set point becomes the
    /// last reading.
    fn hold_where_measured(&mut self) {
        self.path = None;
        for axis in &mut self.axes {
            axis.setpoint_urad = axis.measured_urad;
            axis.target_urad = axis.measured_urad;
        }
    }

    /// Whether what raised a fault is still there.
    pub(super) fn cause_remains(&self, fault: Fault) -> bool {
        let any = |broken: &dyn Fn(usize) -> bool| (0..N).any(broken);
        let now = self.now_us;
        match fault {
            Fault::EStop => !self.local_switch_closed,
            Fault::Watchdog => self.silence_us() > self.heartbeat_timeout_us,
            Fault::FollowingError | Fault::Stall => any(&|n| {
                let error = self.axes[n].setpoint_urad.saturating_sub(self.axes[n].measured_urad);
                error.saturating_abs() > self.config.axes[n].stall_urad
            }),
            Fault::OverCurrent => {
                any(&|n| self.axes[n].sense.current_ma > self.config.axes[n].current_limit_ma)
            }
            Fault::OverTemperature => {
                any(&|n| self.axes[n].sense.temperature_c > self.config.axes[n].temperature_limit_c)
            }
            Fault::UnderVoltage => any(&|n| {
                let sense = &self.axes[n].sense;
                sense.reading != Reading::Unmeasured
                    && sense.supply_mv < self.config.axes[n].supply_minimum_mv
            }),
            Fault::EncoderInvalid => {
                any(&|n| matches!(self.axes[n].sense.reading, Reading::Invalid | Reading::Missing))
            }
            Fault::EncoderJump => {
                any(&|n| self.axes[n].jumped_us.is_some_and(|at| now.saturating_sub(at) < JUMP_QUIET_US))
            }
            Fault::SoftLimit => {
                any(&|n| self.axes[n].homed && outside(self.axes[n].measured_urad, &self.config.axes[n]))
            }
            Fault::KeepOut => self.in_keep_out(),
            Fault::TorqueLost => {
                any(&|n| self.axes[n].torque_wanted_since.is_some() && !self.axes[n].sense.torque)
            }
        }
    }
}

/// Whether a shaft cannot have moved from its last angle to this one, µrad, in the time between the samples.
pub(super) fn is_jump(axis: &Axis, config: &AxisConfig, now_urad: i32, received_us: u64) -> bool {
    let elapsed_us = received_us.saturating_sub(axis.asked_us).min(1_000_000) as i64;
    let within = |speed_urad_s: i64| speed_urad_s * elapsed_us / 1_000_000 + i64::from(config.jump_urad);
    let (before, now) = (i64::from(axis.measured_urad), i64::from(now_urad));
    let step = (now - before).abs();
    if axis.torque_wanted_since.is_none() || !axis.sense.torque {
        return step > within(FREE_SPEED_URAD_S);
    }
    let top_speed = i64::from(config.top_speed_urad_s);
    let (low, high) = (i64::from(axis.swept_urad.0).min(before), i64::from(axis.swept_urad.1).max(before));
    step > within(CATCHING_UP * top_speed) || (low - now).max(now - high) > within(top_speed)
}

/// Whether a reading lies outside the limits by more than the tolerance.
fn outside(measured_urad: i32, config: &AxisConfig) -> bool {
    measured_urad < config.minimum_urad.saturating_sub(config.tolerance_urad)
        || measured_urad > config.maximum_urad.saturating_add(config.tolerance_urad)
}
