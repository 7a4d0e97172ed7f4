//! What a rig's host and its microcontroller must agree on: the messages, the two link layers, and the one state
//! machine that both run.
//!
//! Every message fits eight bytes, so it rides in one classic CAN frame as well as on a serial line. Layouts are fixed
//! and little-endian; angles are integer microradians, times integer microseconds or milliseconds. Both directions are
//! encoded and decoded here, so a mock rig and a firmware image speak exactly what the host hears.
//!
//! Deliberately absent: floats, allocation, clocks (time is an argument in microseconds), a second state machine.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod can;
pub mod cobs;
pub mod command;
pub mod config;
pub mod controller;
pub mod crc;
pub mod fault;
pub mod inject;
pub mod keep_out;
pub mod link;
pub mod payload;
pub mod profile;
pub mod pulse;
pub mod report;
pub mod servo;
pub mod simulated;

pub use can::{Direction, MessageId};
pub use command::{Command, Order};
pub use config::{AxisConfig, Config, Limit};
pub use controller::Controller;
pub use fault::{Fault, Faults};
pub use keep_out::{HalfPlane, KeepOut};
pub use link::{Frame, LinkCounters, Receiver};
pub use payload::{DecodeError, Payload};
pub use report::{AckCode, Report, ResetCause, Source, State};
pub use servo::{Reading, Sense, Servo, ServoHoming, Setpoint};

#[cfg(test)]
mod wire_tests;

/// The version of the messages spoken here; `Hello` and `Info` negotiate it.
pub const PROTOCOL_VERSION: u8 = 1;

/// The axis number that means every axis.
pub const ALL_AXES: u8 = 0xFF;
