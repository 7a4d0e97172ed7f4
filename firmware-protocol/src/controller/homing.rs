//! Making positions trusted: quiet readings of an absolute encoder, or a switch that closes at a known angle.

use super::Controller;
use crate::ALL_AXES;
use crate::config::Home;
use crate::fault::Fault;
use crate::profile::Path;
use crate::report::{Report, State};
use crate::servo::{Servo, ServoHoming};

/// Time of valid, quiet readings after which a position is trusted, µs.
const QUIET_US: u64 = 300_000;
/// Time after which homing that never got quiet readings is a fault, µs.
const QUIET_LONGEST_US: u64 = 3_000_000;

/// How far an axis is with its switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seeking {
    /// The switch was closed at the start: away from it until it opens.
    Away,
    /// Towards the switch until it closes.
    Towards,
    /// Found; comes to rest.
    Found,
    /// The actuator seeks its zero by itself.
    ByServo,
}

impl<S: Servo, const N: usize> Controller<S, N> {
    /// One step of homing. Axes with switches go one after the other.
    pub(super) fn home(&mut self, tell: &mut impl FnMut(Report)) {
        for number in 0..N {
            if !self.homing[number] {
                continue;
            }
            let went_on = match self.config.axes[number].home {
                Home::Absolute => self.home_by_quiet(number),
                Home::Switch { at_urad, speed_urad_s, longest_urad } => {
                    self.home_by_switch(number, at_urad, speed_urad_s, longest_urad)
                }
                Home::ByServo { longest_us } => self.home_by_servo(number, longest_us),
            };
            if !self.homing[number] {
                // before anything says that it is homed: the last reported angle counts from elsewhere
                self.tell_position(number, tell);
            }
            match went_on {
                Ok(true) => {}
                Ok(false) => break, // the axes behind it wait for it
                Err(detail) => return self.raise(Fault::EncoderInvalid, number as u8, detail, tell),
            }
        }
        if self.homing.iter().all(|homing| !homing) {
            self.state = State::Holding;
            tell(Report::Done { id: self.moved_by, axis: ALL_AXES, error_urad: 0 });
        }
    }

    /// Whether the next axis may go on as well; an error when homing cannot succeed.
    fn home_by_quiet(&mut self, number: usize) -> Result<bool, i32> {
        let axis = &mut self.axes[number];
        let quiet_since = axis.quiet_us.max(self.homing_since_us);
        if self.now_us.saturating_sub(quiet_since) >= QUIET_US {
            axis.set_homed(true);
            self.homing[number] = false;
        } else if self.now_us.saturating_sub(self.homing_since_us) > QUIET_LONGEST_US {
            return Err(0);
        }
        Ok(true)
    }

    fn home_by_switch(&mut self, number: usize, at_urad: i32, speed: i32, longest: i32) -> Result<bool, i32> {
        let Some(closed) = self.axes[number].sense.home_switch else { return Err(0) };
        match self.axes[number].seeking {
            None if closed => self.seek(number, Seeking::Away, -speed, longest),
            None => self.seek(number, Seeking::Towards, speed, longest),
            Some(Seeking::Away) if !closed => {
                self.stop_seeking();
                self.seek(number, Seeking::Towards, speed, longest);
            }
            Some(Seeking::Towards) if closed => {
                let axis = &mut self.axes[number];
                // angles count from where the load rests when it comes from below
                let flank_urad = if speed < 0 { self.config.axes[number].lost_motion_urad } else { 0 };
                axis.shift(at_urad.saturating_sub(flank_urad).saturating_sub(axis.measured_urad));
                axis.seeking = Some(Seeking::Found);
                self.stop_seeking();
            }
            Some(Seeking::Found) => {
                // at rest where it was found, not at its target
                let axis = &mut self.axes[number];
                axis.set_homed(true);
                axis.seeking = None;
                axis.target_urad = axis.setpoint_urad;
                self.homing[number] = false;
                self.homing_since_us = self.now_us;
            }
            // it turned the whole distance without the switch
            Some(_) if self.path.is_none() => return Err(longest),
            Some(_) => {}
        }
        Ok(false)
    }

    fn home_by_servo(&mut self, number: usize, longest_us: u32) -> Result<bool, i32> {
        let took_us = self.now_us.saturating_sub(self.homing_since_us);
        let axis = &mut self.axes[number];
        match (axis.seeking, axis.sense.homing) {
            (None, _) => {
                axis.set_homed(false);
                axis.seeking = Some(Seeking::ByServo);
            }
            (_, ServoHoming::Done) => {
                axis.target_urad = axis.setpoint_urad;
                axis.set_homed(true);
                axis.seeking = None;
                self.homing[number] = false;
                self.homing_since_us = self.now_us;
            }
            (_, ServoHoming::Failed) => return Err(-1),
            _ if took_us > longest_us.into() => return Err((took_us / 1000) as i32),
            _ => {}
        }
        Ok(false)
    }

    /// Begins to move one axis; the others stand.
    fn seek(&mut self, number: usize, seeking: Seeking, speed_urad_s: i32, longest_urad: i32) {
        let start = core::array::from_fn(|axis| self.axes[axis].setpoint_urad);
        let mut target = start;
        target[number] = start[number].saturating_add(longest_urad.saturating_mul(speed_urad_s.signum()));
        let speeds = [speed_urad_s.saturating_abs().max(1); N];
        let accelerations = core::array::from_fn(|axis| self.config.axes[axis].top_acceleration_urad_s2);
        self.path = Some(Path::new(start, target, speeds, accelerations));
        self.axes[number].seeking = Some(seeking);
    }

    /// Gives homing up.
    pub(super) fn end_homing(&mut self) {
        self.homing = [false; N];
        self.axes.iter_mut().for_each(|axis| axis.seeking = None);
    }

    /// Ends the seeking motion where it is: it is slow.
    fn stop_seeking(&mut self) {
        self.path = None;
    }
}
