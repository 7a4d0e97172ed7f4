//! What commands do.

use super::{Answered, Controller};
use crate::command::{CLEAR_KEY, Command, Order, PAIR_RANGE_URAD};
use crate::config::{AxisConfig, Home, Limit};
use crate::fault::Fault;
use crate::profile::Path;
use crate::report::{AckCode, Report, State};
use crate::servo::{Reading, Servo};
use crate::{ALL_AXES, PROTOCOL_VERSION};

/// An order's fate and the axis concerned.
type Answer = Result<(), (AckCode, i32)>;

fn refuse(code: AckCode) -> Answer {
    Err((code, 0))
}

impl<S: Servo, const N: usize> Controller<S, N> {
    pub(super) fn execute(&mut self, command: &Command, tell: &mut impl FnMut(Report)) {
        match *command {
            Command::Hello { protocol_min, protocol_max, heartbeat_timeout_ms, nonce } => {
                if (protocol_min..=protocol_max).contains(&PROTOCOL_VERSION) && nonce != 0 {
                    self.open_session(nonce, heartbeat_timeout_ms);
                }
                self.introduce(tell);
            }
            Command::Heartbeat { session, .. } => {
                if self.session == Some(session) {
                    self.heartbeat_us = self.now_us;
                }
            }
            Command::TimeSync { sequence } => tell(Report::TimeSync { sequence, device_us: self.now_us }),
            Command::GetLimit { axis, limit } => self.tell_limit(axis, limit, tell),
            Command::Order { id, order } => self.answer(id, order, tell),
        }
    }

    fn open_session(&mut self, nonce: u32, heartbeat_timeout_ms: u16) {
        if self.session == Some(nonce) {
            return;
        }
        self.session = Some(nonce);
        self.heartbeat_timeout_us = u64::from(heartbeat_timeout_ms.clamp(100, 5000)) * 1000;
        self.heartbeat_us = self.now_us;
        self.answered = [None; 16];
        self.last_order = None;
        self.stop(None); // another host may have left it armed
    }

    fn answer(&mut self, id: u16, order: Order, tell: &mut impl FnMut(Report)) {
        let message = order.message();
        let known = self.answered.iter().flatten().find(|old| old.id == id && old.message == message);
        if let Some(Answered { code, detail, .. }) = known.copied() {
            tell(Report::Ack { id, message, code, detail });
            return;
        }
        let outdated = self.last_order.is_some_and(|last| id.wrapping_sub(last) as i16 <= 0);
        // stopping is never too late
        let stops =
            matches!(order, Order::EStop | Order::Stop { .. } | Order::Hold | Order::Arm { armed: false });
        let answer =
            if outdated && !stops { refuse(AckCode::Outdated) } else { self.execute_order(id, order, tell) };
        if !outdated {
            self.last_order = Some(id);
        }
        let (code, detail) = match answer {
            Ok(()) => (AckCode::Accepted, 0),
            Err(refused) => refused,
        };
        self.answered[self.answered_next] = Some(Answered { id, message, code, detail });
        self.answered_next = (self.answered_next + 1) % self.answered.len();
        tell(Report::Ack { id, message, code, detail });
    }

    fn execute_order(&mut self, id: u16, order: Order, tell: &mut impl FnMut(Report)) -> Answer {
        match order {
            Order::EStop => {
                self.raise(Fault::EStop, ALL_AXES, 1, tell);
                Ok(())
            }
            Order::Hold => {
                self.halt(None);
                Ok(())
            }
            Order::Stop { deceleration_mrad_s2 } => {
                let wanted = i32::from(deceleration_mrad_s2) * 1000;
                let hardest = self.config.axes.iter().map(|axis| axis.e_stop_urad_s2).min();
                self.stop((wanted > 0).then(|| wanted.min(hardest.unwrap_or(wanted))));
                Ok(())
            }
            Order::Arm { armed: false } => {
                self.stop(None);
                Ok(())
            }
            Order::ClearFault { fault, key } => self.clear(fault, key),
            _ if self.session.is_none() => refuse(AckCode::NoSession),
            Order::Arm { armed: true } => self.arm(),
            Order::Home { axis } => self.start_homing(id, axis),
            Order::Profile { axis, speed_mrad_s, acceleration_mrad_s2 } => {
                self.set_profile(axis, speed_mrad_s, acceleration_mrad_s2)
            }
            Order::SetLimit { axis, limit, value } => {
                let answer = self.set_limit(axis, limit, value);
                self.tell_limit(axis, limit, tell);
                answer
            }
            Order::MoveTo { axis, position_urad } => {
                let mut targets = core::array::from_fn(|number| self.axes[number].setpoint_urad);
                match targets.get_mut(usize::from(axis)) {
                    Some(target) => *target = position_urad,
                    None => return Err((AckCode::BadArgument, i32::from(axis))),
                }
                self.start_move(id, targets)
            }
            Order::MovePair { a_urad, b_urad } => {
                let mut targets = core::array::from_fn(|number| self.axes[number].setpoint_urad);
                match &mut targets[..] {
                    [a, b, ..] => (*a, *b) = (a_urad, b_urad),
                    _ => return refuse(AckCode::BadArgument),
                }
                self.start_move(id, targets)
            }
        }
    }

    /// Brakes on the path and holds; a rig that homes stops homing.
    fn halt(&mut self, deceleration_urad_s2: Option<i32>) {
        self.end_homing();
        let usual = self.brake_urad_s2();
        match &mut self.path {
            Some(path) => path.brake(deceleration_urad_s2.unwrap_or(usual)),
            None => self.rest_at_setpoint(),
        }
        if self.state == State::Homing {
            self.state = State::Holding;
        }
    }

    fn stop(&mut self, deceleration_urad_s2: Option<i32>) {
        self.disarm_when_stopped = self.armed;
        self.halt(deceleration_urad_s2);
    }

    fn arm(&mut self) -> Answer {
        if !self.faults.is_empty() {
            return refuse(AckCode::Fault);
        }
        if !self.local_switch_closed {
            return refuse(AckCode::Locked);
        }
        if self.armed && self.disarm_when_stopped {
            return refuse(AckCode::Busy);
        }
        match self.state {
            State::Boot => return refuse(AckCode::Busy),
            State::Idle => {
                self.armed = true;
                self.state = State::Holding;
                // a session that was silent while disarmed starts again
                self.heartbeat_us = self.now_us;
            }
            _ => {}
        }
        Ok(())
    }

    fn ready(&self) -> Answer {
        if !self.faults.is_empty() {
            refuse(AckCode::Fault)
        } else if !self.armed {
            refuse(AckCode::NotArmed)
        } else if self.state != State::Holding || self.path.is_some() || self.disarm_when_stopped {
            refuse(AckCode::Busy)
        } else {
            Ok(())
        }
    }

    fn start_homing(&mut self, id: u16, axis: u8) -> Answer {
        self.ready()?;
        if axis != ALL_AXES && usize::from(axis) >= N {
            return Err((AckCode::BadArgument, i32::from(axis)));
        }
        self.homing = core::array::from_fn(|number| axis == ALL_AXES || usize::from(axis) == number);
        self.homing_since_us = self.now_us;
        self.moved_by = id;
        self.state = State::Homing;
        Ok(())
    }

    fn start_move(&mut self, id: u16, targets: [i32; N]) -> Answer {
        self.ready()?;
        for (number, target) in targets.iter().enumerate() {
            let (axis, config) = (&self.axes[number], &self.config.axes[number]);
            let number = number as i32;
            if !axis.homed {
                return Err((AckCode::NotHomed, number));
            }
            if axis.setpoint_urad == *target {
                continue;
            }
            if !(config.minimum_urad..=config.maximum_urad).contains(target) {
                return Err((AckCode::Limit, number));
            }
            let (low, high) = self.servos[number as usize].range_urad();
            if !(low..=high).contains(&target.saturating_sub(axis.offset_urad)) {
                return Err((AckCode::ServoLimit, number));
            }
        }
        let start = core::array::from_fn(|number| self.axes[number].setpoint_urad);
        if let ([a, b, ..], [to_a, to_b, ..]) = (&start[..], &targets[..]) {
            let (from, to) = ([*a, *b], [*to_a, *to_b]);
            let margin = self.config.keep_out_margin_urad;
            // from inside, the path out of a convex region is open
            let blocked = if self.config.keep_out.contains(from, margin) {
                self.config.keep_out.contains(to, margin)
            } else {
                self.config.keep_out.crosses(from, to, margin)
            };
            if blocked {
                return refuse(AckCode::KeepOut);
            }
        }
        let speeds = core::array::from_fn(|number| self.axes[number].speed_urad_s);
        let accelerations = core::array::from_fn(|number| self.axes[number].acceleration_urad_s2);
        self.path = Some(Path::new(start, targets, speeds, accelerations));
        self.path_ended_us = None;
        for (axis, target) in self.axes.iter_mut().zip(targets) {
            axis.target_urad = target;
        }
        self.moved_by = id;
        self.state = State::Moving;
        Ok(())
    }

    fn clear(&mut self, fault: Fault, key: u32) -> Answer {
        if fault == Fault::EStop
            && self.faults.contains(fault)
            && (key != CLEAR_KEY || !self.local_switch_closed)
        {
            return refuse(AckCode::Locked);
        }
        if self.path.is_some() {
            return refuse(AckCode::Busy);
        }
        if self.cause_remains(fault) {
            return refuse(AckCode::CauseRemains);
        }
        self.faults.remove(fault);
        if !self.faults.is_empty() {
            self.state = if self.faults.contains(Fault::EStop) { State::EStop } else { State::Fault };
        } else if matches!(self.state, State::Fault | State::EStop) {
            if self.path.is_none() {
                self.rest_at_setpoint();
            }
            self.state = State::Idle;
        }
        Ok(())
    }

    fn set_profile(&mut self, axis: u8, speed_mrad_s: u16, acceleration_mrad_s2: u16) -> Answer {
        let (speed, acceleration) = (i32::from(speed_mrad_s) * 1000, i32::from(acceleration_mrad_s2) * 1000);
        let bad = Err((AckCode::BadArgument, i32::from(axis)));
        let Some(config) = self.config.axes.get(usize::from(axis)) else { return bad };
        if speed == 0 || acceleration == 0 {
            return bad;
        }
        if speed > config.top_speed_urad_s || acceleration > config.top_acceleration_urad_s2 {
            return Err((AckCode::Limit, i32::from(axis)));
        }
        let axis = &mut self.axes[usize::from(axis)];
        (axis.speed_urad_s, axis.acceleration_urad_s2) = (speed, acceleration);
        Ok(())
    }

    fn set_limit(&mut self, axis: u8, limit: Limit, value: i32) -> Answer {
        let bad = Err((AckCode::BadArgument, i32::from(axis)));
        if self.armed || self.state != State::Idle || self.path.is_some() {
            return refuse(AckCode::Busy);
        }
        let Some(config) = self.config.axes.get(usize::from(axis)) else { return bad };
        let mut wanted = *config;
        match limit {
            Limit::Minimum => wanted.minimum_urad = value,
            Limit::Maximum => wanted.maximum_urad = value,
            Limit::Speed => wanted.top_speed_urad_s = value,
            Limit::Acceleration => wanted.top_acceleration_urad_s2 = value,
            Limit::Current => wanted.current_limit_ma = i16::try_from(value).unwrap_or(0),
            Limit::ServoMinimum
            | Limit::ServoMaximum
            | Limit::Accuracy
            | Limit::Resolution
            | Limit::LostMotion => return bad,
        }
        if !sensible(&wanted, self.servos[usize::from(axis)].range_urad()) {
            return bad;
        }
        self.config.axes[usize::from(axis)] = wanted;
        let axis = &mut self.axes[usize::from(axis)];
        axis.speed_urad_s = axis.speed_urad_s.min(wanted.top_speed_urad_s);
        axis.acceleration_urad_s2 = axis.acceleration_urad_s2.min(wanted.top_acceleration_urad_s2);
        Ok(())
    }

    fn tell_limit(&self, axis: u8, limit: Limit, tell: &mut impl FnMut(Report)) {
        let Some((config, servo)) =
            self.config.axes.get(usize::from(axis)).zip(self.servos.get(usize::from(axis)))
        else {
            return;
        };
        let value = match limit {
            Limit::Minimum => config.minimum_urad,
            Limit::Maximum => config.maximum_urad,
            Limit::Speed => config.top_speed_urad_s,
            Limit::Acceleration => config.top_acceleration_urad_s2,
            Limit::Current => config.current_limit_ma.into(),
            Limit::ServoMinimum => servo.range_urad().0,
            Limit::ServoMaximum => servo.range_urad().1,
            Limit::Accuracy => config.accuracy_urad,
            Limit::Resolution => config.resolution_urad,
            Limit::LostMotion => config.lost_motion_urad,
        };
        tell(Report::Limit { axis, limit, value });
    }

    /// Who it is: the answer to `Hello`, and unasked after a start so that a host notices a restart.
    pub(super) fn introduce(&self, tell: &mut impl FnMut(Report)) {
        let measured = self.axes.iter().all(|axis| axis.sense.reading != Reading::Unmeasured);
        let homing_moves = self.config.axes.iter().any(|axis| axis.home != Home::Absolute);
        tell(Report::Info {
            protocol: PROTOCOL_VERSION,
            axes: N as u8,
            capabilities: u8::from(measured) | u8::from(homing_moves) << 1,
            reset: self.reset,
            session: self.session.unwrap_or(0),
        });
        tell(Report::Identity { uid: self.config.uid });
        tell(Report::Build { firmware: self.config.firmware, revision: self.config.revision });
    }
}

/// Limits that a rig can keep: in order, positive, in reach of the servo and of the pair message.
fn sensible(config: &AxisConfig, (low, high): (i32, i32)) -> bool {
    config.minimum_urad < config.maximum_urad
        && config.minimum_urad >= low.max(-PAIR_RANGE_URAD)
        && config.maximum_urad <= high.min(PAIR_RANGE_URAD)
        && (1000..=20_000_000).contains(&config.top_speed_urad_s)
        && (1000..=100_000_000).contains(&config.top_acceleration_urad_s2)
        && config.current_limit_ma > 0
}
