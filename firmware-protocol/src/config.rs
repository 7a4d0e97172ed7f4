//! What a rig may do, in numbers.

use crate::coded::coded;
use crate::keep_out::{HalfPlane, KeepOut};

coded! {
    /// A limit that the host may ask for, and set while the rig is disarmed.
    Limit {
        /// Lowest angle, µrad.
        Minimum = 0 "minimum",
        /// Highest angle, µrad.
        Maximum = 1 "maximum",
        /// Highest speed, µrad/s.
        Speed = 2 "speed",
        /// Highest acceleration, µrad/s².
        Acceleration = 3 "acceleration",
        /// Highest motor current, mA.
        Current = 4 "current",
        /// The servo's own lowest angle, µrad; cannot be set.
        ServoMinimum = 5 "servo_minimum",
        /// The servo's own highest angle, µrad; cannot be set.
        ServoMaximum = 6 "servo_maximum",
        /// Largest error of the encoder's own scale, or of an unmeasured axis' setpoint, µrad; cannot be set.
        Accuracy = 7 "accuracy",
        /// One count of the encoder, µrad; cannot be set.
        Resolution = 8 "resolution",
        /// Play between encoder and load, µrad; cannot be set.
        LostMotion = 9 "lost_motion",
    }
}

/// How a position comes to be trusted.
///
/// Angles are those of an axis that came from below: where play lies between encoder and load, that is the side on which
/// the load then rests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// The encoder is absolute: quiet readings will do.
    Absolute,
    /// The encoder counts from where it was switched on: the axis seeks a switch.
    Switch {
        /// Angle at which the switch closes, µrad.
        at_urad: i32,
        /// How fast it is approached, and by its sign from which side, µrad/s.
        speed_urad_s: i32,
        /// Longest distance to the switch, µrad.
        longest_urad: i32,
    },
    /// The actuator finds its zero by itself on command.
    ByServo {
        /// How long it may take, µs.
        longest_us: u32,
    },
}

impl Home {
    /// The usual search for a switch that is closed at and below an angle, µrad: down, at 6 degrees a second.
    pub const fn switch_below(at_urad: i32) -> Self {
        Self::Switch { at_urad, speed_urad_s: -100_000, longest_urad: 2_200_000 }
    }
}

/// Limits and rules of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisConfig {
    /// Lowest angle, µrad.
    pub minimum_urad: i32,
    /// Highest angle, µrad.
    pub maximum_urad: i32,
    /// Highest speed, µrad/s.
    pub top_speed_urad_s: i32,
    /// Highest acceleration, µrad/s².
    pub top_acceleration_urad_s2: i32,
    /// Deceleration of an emergency stop, µrad/s².
    pub e_stop_urad_s2: i32,
    /// Motor current above which, after 100 ms, the axis is at fault, mA.
    pub current_limit_ma: i16,
    /// Current it may use to hold while a fault is latched, mA.
    pub fault_current_ma: i16,
    /// Temperature above which the axis is at fault, °C.
    pub temperature_limit_c: i8,
    /// Supply below which, after 20 ms, the axis is at fault, mV.
    pub supply_minimum_mv: u16,
    /// Distance from the set point that is a fault after 100 ms, µrad.
    pub following_urad: i32,
    /// Distance from the set point that is a stall after 150 ms without motion, µrad.
    pub stall_urad: i32,
    /// Noise of two readings, play and what else may lie between them without motion, µrad. A step beyond this and what the
    /// shaft can have moved between the two samples is a jump.
    pub jump_urad: i32,
    /// Distance from the target within which a move is done, and how far the reading may lie outside the limits, µrad.
    pub tolerance_urad: i32,
    /// Largest error of the encoder's own scale, or of an unmeasured axis' setpoint, µrad.
    pub accuracy_urad: i32,
    /// One count of the encoder, µrad.
    pub resolution_urad: i32,
    /// Play between encoder and load, µrad; none where the encoder sits on the output.
    pub lost_motion_urad: i32,
    /// An encoder that does not answer for this long, and when asked several times, is at fault, µs.
    pub missing_us: u32,
    /// Whether the servo holds its angle while disarmed.
    pub holds_when_idle: bool,
    /// How its position comes to be trusted.
    pub home: Home,
}

impl AxisConfig {
    /// How hard it brakes on a hold and when the host is silent, µrad/s²: twice as hard as a move may
    /// gain speed, whatever profile that move has, and never harder than an emergency stop.
    pub(crate) fn brake_urad_s2(&self) -> i32 {
        self.top_acceleration_urad_s2.saturating_mul(2).min(self.e_stop_urad_s2)
    }
}

impl Default for AxisConfig {
    /// A tilt axis for a small LiDAR: ± 60 degrees, 30 degrees per second.
    fn default() -> Self {
        Self {
            minimum_urad: -1_047_198,
            maximum_urad: 1_047_198,
            top_speed_urad_s: 523_599,
            top_acceleration_urad_s2: 2_000_000,
            e_stop_urad_s2: 10_000_000,
            current_limit_ma: 1500,
            fault_current_ma: 500,
            temperature_limit_c: 70,
            supply_minimum_mv: 10_500,
            following_urad: 100_000,
            stall_urad: 5236,
            jump_urad: 20_000,
            tolerance_urad: 5236,
            accuracy_urad: 0,
            resolution_urad: crate::simulated::ENCODER_STEP_URAD,
            lost_motion_urad: 0,
            missing_us: 100_000,
            holds_when_idle: true,
            home: Home::Absolute,
        }
    }
}

/// Limits and rules of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config<const N: usize> {
    /// One per axis.
    pub axes: [AxisConfig; N],
    /// Where axes 0 and 1 must not be together.
    pub keep_out: KeepOut,
    /// Clearance of the planned path from that region on each axis, µrad.
    pub keep_out_margin_urad: i32,
    /// Time between two positions of an axis, µs.
    pub position_every_us: u32,
    /// The device's unique number.
    pub uid: u64,
    /// Version: major << 16 | minor << 8 | patch.
    pub firmware: u32,
    /// First 32 bits of the revision it was built from.
    pub revision: u32,
}

impl<const N: usize> Default for Config<N> {
    fn default() -> Self {
        Self {
            axes: [AxisConfig::default(); N],
            keep_out: KeepOut::NONE,
            keep_out_margin_urad: 26_180,
            position_every_us: 20_000,
            uid: 0,
            firmware: 0x00_01_00,
            revision: 0,
        }
    }
}

impl Config<2> {
    /// A mirrored pair that tilts ± 60 degrees each and must not tip both sensors inwards by more than 80 degrees
    /// together.
    pub fn mirrored_pair(uid: u64) -> Self {
        let inwards = HalfPlane { a: -1, b: 1, c: 1_396_263 };
        Self { keep_out: KeepOut::inside(&[inwards]).unwrap_or_default(), uid, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_pair_may_lean_outwards_but_not_inwards() {
        let config = Config::mirrored_pair(9);
        assert_eq!(config.uid, 9);
        let outwards = [700_000, -700_000];
        for (pair_urad, is_inside) in
            [(outwards, false), ([-700_000, 700_000], true), ([700_000; 2], false), ([-700_000; 2], false)]
        {
            assert_eq!(config.keep_out.contains(pair_urad, 0), is_inside, "{pair_urad:?}");
        }
    }
}
