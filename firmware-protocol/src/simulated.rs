//! A simulated tilt axis in integers: motor with limited speed and acceleration, backlash, a noisy and quantised encoder
//! on the output, end stops, and faults on demand. Mock rigs and firmware images without hardware run it.

use crate::servo::{Reading, Sense, Servo, ServoHoming, Setpoint};

const NANO: i64 = 1000;
/// The plant is integrated in steps of this length, µs.
const STEP_US: u64 = 1000;
const CELSIUS_NC: i64 = 1_000_000_000;
/// Longest time integrated at once; a process that was suspended does not catch up for minutes.
const LONGEST_US: u64 = 1_000_000;

/// One count of its encoder, µrad: 14 bits per turn.
pub const ENCODER_STEP_URAD: i32 = 383;

/// What is wrong with a simulated axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisFault {
    /// The shaft does not move.
    Stuck,
    /// The motor reaches only this share of its speed, percent.
    Slow(u8),
    /// The gears have this much play, µrad.
    Backlash(i32),
    /// The encoder's zero moves by this much, once, µrad.
    EncoderJump(i32),
    /// The encoder repeats its last reading.
    EncoderFreeze,
    /// The encoder says that it has no valid angle.
    EncoderInvalid,
    /// The motor heats up by this much each second, °C.
    Overheat(i16),
    /// The supply drops to this, mV.
    UnderVoltage(u16),
    /// The servo drops its torque by itself, and the load pulls.
    TorqueLost,
}

/// The plant of one axis.
#[derive(Clone, Debug)]
pub struct SimulatedAxis {
    /// End stops, µrad.
    pub range_urad: (i32, i32),
    /// Top speed of the motor, µrad/s.
    pub top_speed_urad_s: i32,
    /// Top acceleration of the motor, µrad/s².
    pub top_acceleration_urad_s2: i32,
    /// Play between motor and output, µrad.
    pub backlash_urad: i32,
    /// One encoder count, µrad.
    pub encoder_step_urad: i32,
    /// The encoder sits before the play, and is right when the axis comes from below.
    pub encoder_on_motor: bool,
    /// Largest noise of a reading, µrad.
    pub noise_urad: i32,
    /// Distance from the set point within which the servo rests, µrad.
    pub dead_band_urad: i32,
    /// True angle at and below which a switch is closed, µrad; `None` for an axis without a switch.
    pub home_switch_urad: Option<i32>,
    random: u64,
    motor_nrad: i64,
    output_nrad: i64,
    velocity_urad_s: i64,
    encoder_offset_urad: i32,
    frozen_urad: Option<i32>,
    reading_urad: i32,
    current_ma: i16,
    temperature_nc: i64,
    now_us: u64,
    setpoint: Setpoint,
    stuck: bool,
    invalid: bool,
    torque_lost: bool,
    slow_percent: u8,
    heating_mc_s: i64,
    supply_mv: u16,
}

impl SimulatedAxis {
    /// An axis that stands at an angle; noise comes from the seed.
    pub fn new(seed: u64, position_urad: i32, now_us: u64) -> Self {
        Self {
            range_urad: (-1_570_796, 1_570_796),
            top_speed_urad_s: 2_000_000,
            top_acceleration_urad_s2: 20_000_000,
            backlash_urad: 1500,
            encoder_step_urad: ENCODER_STEP_URAD,
            encoder_on_motor: false,
            noise_urad: 150,
            dead_band_urad: 900,
            home_switch_urad: None,
            random: seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1,
            motor_nrad: i64::from(position_urad) * NANO,
            output_nrad: i64::from(position_urad) * NANO,
            velocity_urad_s: 0,
            encoder_offset_urad: 0,
            frozen_urad: None,
            reading_urad: position_urad,
            current_ma: 80,
            temperature_nc: 31 * CELSIUS_NC,
            now_us,
            setpoint: Setpoint { position_urad, ..Setpoint::default() },
            stuck: false,
            invalid: false,
            torque_lost: false,
            slow_percent: 100,
            heating_mc_s: 0,
            supply_mv: 12_000,
        }
    }

    /// The same with an encoder that counts from where it was switched on, and a switch that closes at and below an angle.
    pub fn counting_from_start(mut self, home_switch_urad: i32) -> Self {
        self.encoder_offset_urad = -self.seen_urad();
        self.reading_urad = 0;
        self.home_switch_urad = Some(home_switch_urad);
        self
    }

    /// Where the output really is, µrad: what no encoder tells.
    pub fn true_position_urad(&self) -> i32 {
        (self.output_nrad / NANO) as i32
    }

    /// Whether it is ordered to drive its shaft.
    pub fn is_driven(&self) -> bool {
        self.setpoint.torque
    }

    /// Breaks it.
    pub fn inject(&mut self, fault: AxisFault) {
        match fault {
            AxisFault::Stuck => self.stuck = true,
            AxisFault::Slow(percent) => self.slow_percent = percent.min(100),
            AxisFault::Backlash(play) => self.backlash_urad = play.max(0),
            AxisFault::EncoderJump(step) => {
                self.encoder_offset_urad = self.encoder_offset_urad.saturating_add(step);
            }
            AxisFault::EncoderFreeze => self.frozen_urad = Some(self.reading_urad),
            AxisFault::EncoderInvalid => self.invalid = true,
            AxisFault::Overheat(rate) => self.heating_mc_s = i64::from(rate) * 1000,
            AxisFault::UnderVoltage(supply) => self.supply_mv = supply,
            AxisFault::TorqueLost => self.torque_lost = true,
        }
    }

    /// Mends what was broken; a moved encoder zero and the heat stay, play goes back to `backlash_urad` as given here.
    pub fn repair(&mut self, backlash_urad: i32) {
        self.backlash_urad = backlash_urad;
        (self.stuck, self.invalid, self.torque_lost) = (false, false, false);
        (self.slow_percent, self.heating_mc_s, self.supply_mv) = (100, 0, 12_000);
        self.frozen_urad = None;
    }

    /// A value in -range..=range (xorshift64*, doi:10.1145/2845077).
    fn noise(&mut self, range: i32) -> i32 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        let bits = self.random.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33;
        (bits % (2 * i64::from(range.max(0)) as u64 + 1)) as i32 - range.max(0)
    }

    /// What the encoder turns with, µrad.
    fn seen_urad(&self) -> i32 {
        if self.encoder_on_motor {
            (self.motor_nrad / NANO) as i32 - self.backlash_urad / 2
        } else {
            self.true_position_urad()
        }
    }

    fn read_encoder(&mut self) -> i32 {
        let noise = self.noise(self.noise_urad);
        let angle = self.seen_urad().saturating_add(self.encoder_offset_urad).saturating_add(noise);
        let step = self.encoder_step_urad.max(1);
        self.frozen_urad.unwrap_or_else(|| (angle + step / 2).div_euclid(step) * step)
    }

    fn integrate(&mut self, elapsed_us: u64) {
        let elapsed = elapsed_us as i64;
        self.reading_urad = self.read_encoder();
        let driven = self.setpoint.torque && !self.torque_lost;
        let error = i64::from(self.setpoint.position_urad) - i64::from(self.reading_urad);
        let resting = error.abs() <= i64::from(self.dead_band_urad) && self.setpoint.velocity_urad_s == 0;
        let top = i64::from(self.top_speed_urad_s) * i64::from(self.slow_percent) / 100;
        let wanted = if !driven || resting || self.invalid {
            0
        } else {
            (i64::from(self.setpoint.velocity_urad_s) + error * 15).clamp(-top, top)
        };
        let gain = (i64::from(self.top_acceleration_urad_s2) * elapsed / 1_000_000).max(1);
        self.velocity_urad_s += (wanted - self.velocity_urad_s).clamp(-gain, gain);
        let push = if driven { (error.abs() / 50).min(3000) } else { 0 };
        if self.stuck {
            self.velocity_urad_s = 0;
            self.current_ma = (80 + push).min(80 + i64::from(self.setpoint.current_limit_ma)) as i16;
            self.heat(elapsed);
            return;
        }
        self.current_ma = if driven { (80 + self.velocity_urad_s.abs() / 5000) as i16 } else { 5 };
        // a free shaft sinks slowly under its load: a worm gear that lets go
        let fall = if self.torque_lost { 50_000 } else { 0 };
        let (low, high) = (i64::from(self.range_urad.0) * NANO, i64::from(self.range_urad.1) * NANO);
        self.motor_nrad += (self.velocity_urad_s + fall) * elapsed / 1000;
        self.motor_nrad = self.motor_nrad.clamp(low, high);
        let play = i64::from(self.backlash_urad) * NANO / 2;
        self.output_nrad =
            self.output_nrad.clamp(self.motor_nrad - play, self.motor_nrad + play).clamp(low, high);
        self.heat(elapsed);
    }

    fn heat(&mut self, elapsed_us: i64) {
        // m°C/s times µs are n°C: steps shorter than a millisecond lose nothing
        let heated_nc = self.temperature_nc + self.heating_mc_s * elapsed_us;
        self.temperature_nc = heated_nc.clamp(20 * CELSIUS_NC, 120 * CELSIUS_NC);
    }
}

impl Servo for SimulatedAxis {
    fn sense(&mut self, now_us: u64) -> Sense {
        let mut left_us = now_us.saturating_sub(self.now_us).min(LONGEST_US);
        self.now_us = self.now_us.max(now_us);
        while left_us > 0 {
            let step = left_us.min(STEP_US);
            self.integrate(step);
            left_us -= step;
        }
        self.reading_urad = self.read_encoder();
        Sense {
            reading: if self.invalid { Reading::Invalid } else { Reading::Measured(self.reading_urad) },
            torque: self.setpoint.torque && !self.torque_lost,
            current_ma: self.current_ma,
            supply_mv: self.supply_mv,
            temperature_c: (self.temperature_nc / CELSIUS_NC) as i8,
            home_switch: self.home_switch_urad.map(|at_urad| self.true_position_urad() <= at_urad),
            sampled_us: [now_us; 2],
            homing: ServoHoming::Idle,
        }
    }

    fn drive(&mut self, _now_us: u64, setpoint: Setpoint) {
        self.setpoint = setpoint;
    }

    fn range_urad(&self) -> (i32, i32) {
        self.range_urad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motor_cools_as_fast_however_often_it_is_looked_at() {
        let after_ten_seconds = |every_us: u64| {
            let mut axis = SimulatedAxis::new(1, 0, 0);
            axis.inject(AxisFault::Overheat(60));
            axis.sense(1_000_000);
            axis.inject(AxisFault::Overheat(-1));
            let looks = (1_000_000..=11_000_000).step_by(every_us as usize);
            looks.map(|now_us| axis.sense(now_us).temperature_c).last()
        };
        assert_eq!([100, 1_250, 20_000].map(after_ten_seconds), [Some(81); 3]);
    }
}
