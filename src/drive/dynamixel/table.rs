//! Registers of the X series (ROBOTIS e-Manual, XM430-W350 control table), as address and length.

/// Address and length of a register.
pub type Register = (u16, u16);

/// 3 is position control, 5 position control with a current limit.
pub const OPERATING_MODE: Register = (11, 1);
/// Highest position, counts.
pub const MAX_POSITION: Register = (48, 4);
/// Lowest position, counts.
pub const MIN_POSITION: Register = (52, 4);
/// 1 drives the shaft.
pub const TORQUE_ENABLE: Register = (64, 1);
/// What shut it down, see [`hardware_error`].
pub const HARDWARE_ERROR: Register = (70, 1);
/// Silence on the bus after which it stops, 20 ms; 0 switches that off and clears it.
pub const BUS_WATCHDOG: Register = (98, 1);
/// Where to be, counts.
pub const GOAL_POSITION: Register = (116, 4);
/// Current, velocity, position, two trajectory values, voltage, temperature: all that is measured in one read.
pub const MEASURED: Register = (126, 21);
/// Within [`MEASURED`]: current, 2.69 mA.
pub const CURRENT_AT: usize = 0;
/// Within [`MEASURED`]: position, counts.
pub const POSITION_AT: usize = 6;
/// Within [`MEASURED`]: supply, 0.1 V.
pub const VOLTAGE_AT: usize = 18;
/// Within [`MEASURED`]: temperature, °C.
pub const TEMPERATURE_AT: usize = 20;
/// Torque switch to hardware error, in one read.
pub const TORQUE_TO_ERROR: Register = (64, 7);

/// Bits of the hardware error register; each but the first two leaves the shaft without torque.
pub mod hardware_error {
    /// Supply outside its limits.
    pub const VOLTAGE: u8 = 1 << 0;
    /// Too hot.
    pub const OVERHEAT: u8 = 1 << 2;
    /// No valid position.
    pub const ENCODER: u8 = 1 << 3;
    /// Every bit with its name.
    pub const NAMES: [(u8, &str); 5] = [
        (VOLTAGE, "input voltage"),
        (OVERHEAT, "overheating"),
        (ENCODER, "motor encoder"),
        (1 << 4, "electrical shock"),
        (1 << 5, "overload"),
    ];
}

/// Names of what a servo answers to an instruction (e-Manual, Protocol 2.0, "Error"), from 1.
pub const ANSWER_ERRORS: [&str; 7] = [
    "cannot process it",
    "unknown instruction",
    "damaged packet",
    "data out of range",
    "data of the wrong length",
    "data outside its limits",
    "register cannot be accessed now",
];

/// Models with this control table and a current sensor: XM430-W350, XM430-W210, XM540-W270, XM540-W150.
pub const MODELS: [u16; 4] = [1020, 1030, 1120, 1130];

/// Position at the middle of the horn's turn, counts.
pub const CENTRE: i32 = 2048;
/// Counts of a turn.
const COUNTS: i64 = 4096;
/// A turn, µrad.
const TURN_URAD: i64 = 6_283_185;
/// One count, µrad, rounded up.
pub const COUNT_URAD: i32 = (TURN_URAD / COUNTS) as i32 + 1;

/// Counts to an angle from the centre, µrad.
pub fn urad(counts: i32) -> i32 {
    ((i64::from(counts) - i64::from(CENTRE)) * TURN_URAD / COUNTS).clamp(i32::MIN.into(), i32::MAX.into())
        as i32
}

/// An angle from the centre to the nearest count.
pub fn counts(urad: i32) -> i32 {
    let scaled = i64::from(urad) * COUNTS;
    let half = if scaled < 0 { -TURN_URAD / 2 } else { TURN_URAD / 2 };
    CENTRE + ((scaled + half) / TURN_URAD) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_angles_agree() {
        assert_eq!((urad(2048), urad(3072), urad(0)), (0, 1_570_796, -3_141_592));
        for count in 0..4096 {
            assert_eq!(counts(urad(count)), count);
        }
    }
}
