//! What a rig says unasked, and how often.

use super::Controller;
use crate::fault::Fault;
use crate::report::Report;
use crate::servo::Servo;

const TARGET_US: u64 = 50_000;
const HEARTBEAT_US: u64 = 100_000;
const SLOW_US: u64 = 200_000;

/// When each kind of report is due.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    introduced: bool,
    position_us: u64,
    target_us: u64,
    heartbeat_us: u64,
    slow_us: u64,
}

impl Schedule {
    pub(super) fn new(now_us: u64) -> Self {
        Self {
            introduced: false,
            position_us: now_us,
            target_us: now_us,
            heartbeat_us: now_us,
            slow_us: now_us,
        }
    }
}

/// Whether a report is due; a loop that lagged sends one, not all it missed.
fn due(now_us: u64, next_us: &mut u64, period_us: u64) -> bool {
    let due = now_us >= *next_us;
    if due {
        *next_us = (*next_us + period_us).max(now_us + period_us / 2);
    }
    due
}

impl<S: Servo, const N: usize> Controller<S, N> {
    pub(super) fn report(&mut self, tell: &mut impl FnMut(Report)) {
        let now = self.now_us;
        if !core::mem::replace(&mut self.schedule.introduced, true) {
            self.introduce(tell);
        }
        if due(now, &mut self.schedule.position_us, self.config.position_every_us.into()) {
            (0..N).for_each(|number| self.tell_position(number, tell));
        }
        if due(now, &mut self.schedule.target_us, TARGET_US) {
            for (number, axis) in self.axes.iter().enumerate() {
                tell(Report::Target {
                    axis: number as u8,
                    state: self.state,
                    homed: axis.homed,
                    id: self.moved_by,
                    target_urad: axis.target_urad,
                });
            }
        }
        if due(now, &mut self.schedule.heartbeat_us, HEARTBEAT_US) {
            tell(Report::Heartbeat {
                state: self.state,
                armed: self.armed,
                homed: self.axes.iter().all(|axis| axis.homed),
                faults: self.faults,
                session: self.session.unwrap_or(0),
            });
        }
        if due(now, &mut self.schedule.slow_us, SLOW_US) {
            for (number, axis) in self.axes.iter_mut().enumerate() {
                let moved = i64::from(axis.measured_urad) - i64::from(axis.reported_urad);
                axis.reported_urad = axis.measured_urad;
                let speed = moved * 1000 / SLOW_US as i64;
                tell(Report::Effort {
                    axis: number as u8,
                    temperature_c: axis.sense.temperature_c,
                    current_ma: axis.sense.current_ma,
                    supply_mv: axis.sense.supply_mv,
                    speed_mrad_s: speed.clamp(i16::MIN.into(), i16::MAX.into()) as i16,
                });
            }
            // a host that opens the line later, or lost the first one, still learns why the rig started
            if self.session.is_none() {
                self.introduce(tell);
            }
            for fault in self.faults.iter() {
                self.tell_fault(fault, tell);
            }
        }
    }

    pub(super) fn tell_position(&self, number: usize, tell: &mut impl FnMut(Report)) {
        let axis = &self.axes[number];
        tell(Report::Position {
            axis: number as u8,
            source: self.source(number),
            // an answer may take long: the angle is as old as its question
            time_ms: (axis.asked_us / 1000) as u16,
            position_urad: axis.measured_urad,
        });
    }

    pub(super) fn tell_fault(&self, fault: Fault, tell: &mut impl FnMut(Report)) {
        let latched = self.latched[usize::from(fault.code())];
        tell(Report::Fault {
            fault,
            axis: latched.axis,
            time_ms: (latched.time_us / 1000) as u16,
            detail: latched.detail,
        });
    }
}
