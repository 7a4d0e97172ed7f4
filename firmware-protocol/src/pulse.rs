//! A hobby servo: a pulse says where to be, and nothing comes back.

use crate::servo::{Reading, Sense, Servo, Setpoint};

/// A servo driven by pulse width. Its position is its setpoint, and every report says so.
#[derive(Clone, Copy, Debug)]
pub struct PulseServo {
    /// Pulse at 0 µrad, quarter microseconds (6000 is 1500 µs).
    pub centre_quarter_us: u16,
    /// Quarter microseconds per radian (2546 is 1000 µs over 90 degrees).
    pub quarter_us_per_rad: u16,
    /// Shortest and longest pulse the servo takes, quarter microseconds.
    pub pulse_range_quarter_us: (u16, u16),
    pulse_quarter_us: Option<u16>,
}

impl PulseServo {
    /// A standard analogue servo: 1500 ± 500 µs for ± 45 degrees.
    pub fn standard() -> Self {
        Self {
            centre_quarter_us: 6000,
            quarter_us_per_rad: 2546,
            pulse_range_quarter_us: (4000, 8000),
            pulse_quarter_us: None,
        }
    }

    /// The pulse to send now, quarter microseconds; `None` while the shaft is free.
    pub fn pulse_quarter_us(&self) -> Option<u16> {
        self.pulse_quarter_us
    }

    fn angle_urad(&self, pulse_quarter_us: u16) -> i32 {
        let offset = i64::from(pulse_quarter_us) - i64::from(self.centre_quarter_us);
        (offset * 1_000_000 / i64::from(self.quarter_us_per_rad.max(1))) as i32
    }
}

impl Servo for PulseServo {
    fn sense(&mut self, now_us: u64) -> Sense {
        Sense {
            reading: Reading::Unmeasured,
            torque: self.pulse_quarter_us.is_some(),
            current_ma: 0,
            supply_mv: 5000,
            temperature_c: 25,
            sampled_us: [now_us; 2],
            ..Sense::UNREAD
        }
    }

    fn drive(&mut self, _now_us: u64, setpoint: Setpoint) {
        let (shortest, longest) = self.pulse_range_quarter_us;
        self.pulse_quarter_us = setpoint.torque.then(|| {
            let offset = i64::from(setpoint.position_urad) * i64::from(self.quarter_us_per_rad) / 1_000_000;
            (i64::from(self.centre_quarter_us) + offset).clamp(i64::from(shortest), i64::from(longest)) as u16
        });
    }

    fn range_urad(&self) -> (i32, i32) {
        let (shortest, longest) = self.pulse_range_quarter_us;
        (self.angle_urad(shortest), self.angle_urad(longest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_follow_the_angle_and_stop_at_the_range() {
        let mut servo = PulseServo::standard();
        let at = |position_urad| Setpoint { torque: true, position_urad, ..Setpoint::default() };
        assert_eq!(servo.pulse_quarter_us(), None);
        servo.drive(0, at(0));
        assert_eq!(servo.pulse_quarter_us(), Some(6000));
        servo.drive(0, at(785_398)); // 45 degrees, 2000 us
        assert_eq!(servo.pulse_quarter_us(), Some(7999));
        servo.drive(0, at(3_000_000));
        assert_eq!(servo.pulse_quarter_us(), Some(8000));
        assert_eq!(servo.sense(0).reading, Reading::Unmeasured);
    }
}
