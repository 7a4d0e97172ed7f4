//! Registers and models (Feetech STS3215 memory table; model numbers, byte order and counts of a turn also as in Hugging
//! Face `lerobot`, `motors/feetech/tables.py`), as address and length.

use crate::drive::bus_servos::Register;

/// Model: read for its length.
pub const FENCE: Register = (3, 2);
/// Model to operating mode, all in one read.
pub const SETUP: Register = (3, 31);
/// Whether a write is answered.
pub const ANSWER_LEVEL: u16 = 8;
/// Lowest position, counts, two bytes.
pub const LOWEST: u16 = 9;
/// Highest position, counts, two bytes.
pub const HIGHEST: u16 = 11;
/// Highest supply, 0.1 V.
pub const HIGHEST_SUPPLY: u16 = 14;
/// Lowest supply, 0.1 V.
pub const LOWEST_SUPPLY: u16 = 15;
/// Bits of how the motor and the encoder are used.
pub const PHASE: u16 = 18;
/// Bit of [`PHASE`]: positions count turns (huggingface/lerobot pull request 3373).
pub const COUNTS_TURNS: u8 = 1 << 4;
/// Counts of the encoder in one of a position; more than 1 for ranges of several turns.
pub const RESOLUTION: u16 = 30;
/// 0 is position control.
pub const MODE: u16 = 33;
/// 1 drives the shaft. Writing a goal does so too.
pub const TORQUE_ENABLE: Register = (40, 1);
/// Where to be, counts.
pub const GOAL_POSITION: Register = (42, 2);
/// Position to current: all that is measured in one read.
pub const MEASURED: Register = (56, 15);
/// Within [`MEASURED`]: supply, 0.1 V.
pub const VOLTAGE_AT: usize = 6;
/// Within [`MEASURED`]: temperature, °C.
pub const TEMPERATURE_AT: usize = 7;
/// Within [`MEASURED`]: error bits, as in every answer.
pub const STATUS_AT: usize = 9;
/// Within [`MEASURED`]: current, 6.5 mA.
pub const CURRENT_AT: usize = 13;

/// Supply outside its limits.
pub const VOLTAGE: u8 = 1 << 0;
/// No valid position.
pub const ENCODER: u8 = 1 << 1;
/// Too hot.
pub const OVERHEAT: u8 = 1 << 2;
/// Too much current.
pub const OVERCURRENT: u8 = 1 << 3;
/// Overload: the servo takes its torque back.
pub const OVERLOAD: u8 = 1 << 5;
/// Every error bit of an answer with its name (scservo SDK, `ERRBIT_*`).
pub const ERRORS: [(u8, &str); 5] = [
    (VOLTAGE, "input voltage"),
    (ENCODER, "angle sensor"),
    (OVERHEAT, "overheating"),
    (OVERCURRENT, "over-current"),
    (OVERLOAD, "overload"),
];

/// Model numbers with these registers, low byte first, and 4096 counts to the turn.
pub const MODELS: [(u16, &str); 2] = [(777, "STS3215"), (2825, "STS3250")];
/// Model numbers with another register table, and which.
pub const OTHERS: [(u16, &str); 3] = [
    (1284, "SCS0009: 1024 counts over 300 degrees, high byte first"),
    (4618, "HLS3960M: registers 44 and 45 are a torque without which nothing moves"),
    (11272, "SM8512BL: 4096 or 65536 counts to the turn, by whom one asks"),
];

/// Sign and magnitude: the highest of 16 bits is the sign.
pub(crate) fn signed(low: u8, high: u8) -> i32 {
    let magnitude = i32::from(u16::from_le_bytes([low, high & 0x7F]));
    if high & 0x80 == 0 { magnitude } else { -magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_bit_is_the_sign() {
        assert_eq!((signed(0x05, 0x80), signed(0x00, 0x08), signed(0xFF, 0x7F)), (-5, 2048, 32_767));
    }
}
