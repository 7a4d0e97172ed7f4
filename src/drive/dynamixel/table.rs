//! Registers and models (ROBOTIS e-Manual, control tables of the X series and of MX with Protocol 2.0), as address and
//! length.

use crate::drive::bus_servos::Register;

/// Not a register: what a ping answers, model number and firmware version.
pub const PING: Register = (0, 3);
/// Model number and model information: read for its length.
pub const FENCE: Register = (0, 6);
/// Drive mode and operating mode.
pub const MODES: Register = (10, 2);
/// Bit of the drive mode: it follows the goal of another servo.
pub const DRIVE_MODE_SLAVE: u8 = 1 << 1;
/// Highest and lowest supply, 0.1 V.
pub const VOLTAGE_LIMITS: Register = (32, 4);
/// Highest and lowest position, counts.
pub const POSITION_LIMITS: Register = (48, 8);
/// 1 drives the shaft.
pub const TORQUE_ENABLE: Register = (64, 1);
/// Which questions it answers: 0 pings, 1 pings and reads, 2 all.
pub const STATUS_RETURN_LEVEL: Register = (68, 1);
/// What shut it down, see [`hardware_error`].
pub const HARDWARE_ERROR: Register = (70, 1);
/// Silence on the bus after which it stops, 20 ms; 0 switches that off and clears it.
pub const BUS_WATCHDOG: Register = (98, 1);
/// Acceleration and velocity (or times, by bit 2 of the drive mode) of its own profile; 0 is none.
pub const PROFILE: Register = (108, 8);
/// Where to be, counts.
pub const GOAL_POSITION: Register = (116, 4);
/// Current, velocity, position, two trajectory values, voltage, temperature: all that is measured in one read.
pub const MEASURED: Register = (126, 21);
/// Within [`MEASURED`]: current, in the unit of the [`Model`].
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
