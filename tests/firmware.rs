//! The firmware image in an emulated microcontroller, driven over its serial line as the program drives a rig.
//!
//! `.ci/run firmware` builds the image, installs the emulator and names both in the environment; elsewhere these cases
//! are left out by name.

mod emulator;
mod scenarios;
mod soak;

use crate::support::Case;

pub const CASES: &[Case] = &[
    scenarios::HELLO,
    scenarios::ROUND_TRIPS,
    scenarios::PAIR_MOVE,
    scenarios::SOFT_LIMIT,
    scenarios::TELEMETRY,
    scenarios::JAM,
    scenarios::MOVE_WHILE_FAULTED,
    scenarios::CLEAR_WHILE_JAMMED,
    scenarios::CORRUPTED,
    scenarios::FROZEN,
    scenarios::WATCHDOG,
    scenarios::BROWN_OUT,
    scenarios::KILLED,
    scenarios::SWITCHES,
    soak::LONG,
];
