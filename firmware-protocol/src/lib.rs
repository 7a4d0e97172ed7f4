//! What a rig's host and its microcontroller must agree on: the messages, the two link layers, and the one state
//! machine that both run.
//!
//! Every message fits eight bytes, so it rides in one classic CAN frame as well as on a serial line. Layouts are fixed
//! and little-endian; angles are integer microradians, times integer microseconds or milliseconds. Both directions are
//! encoded and decoded here, so a mock rig and a firmware image speak exactly what the host hears.
//!
//! The microcontroller and the mock run the same machine; this one has one simulated axis:
//!
//! ```
//! use firmware_protocol::simulated::SimulatedAxis;
//! use firmware_protocol::{ALL_AXES, Command, Config, Controller, Order, Report, ResetCause, State};
//!
//! let mut rig = Controller::new(Config::default(), [SimulatedAxis::new(1, 0, 0)], ResetCause::PowerOn, 0);
//! let (mut now_us, session) = (0, 7);
//! let mut run = |rig: &mut Controller<SimulatedAxis, 1>, ms: u64, order: Option<Command>| {
//!     let mut reports = Vec::new();
//!     order.iter().for_each(|order| rig.handle(now_us, order, &mut |report| reports.push(report)));
//!     for _ in 0..ms {
//!         now_us += 1000;
//!         rig.handle(now_us, &Command::Heartbeat { session, time_ms: 0 }, &mut |_| ());
//!         rig.step(now_us, &mut |report| reports.push(report));
//!     }
//!     reports
//! };
//! run(&mut rig, 50, None); // it reads its encoder
//! let hello = Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 300, nonce: session };
//! run(&mut rig, 1, Some(hello));
//! let order = |id, order| Some(Command::Order { id, order });
//! run(&mut rig, 1, order(1, Order::Arm { armed: true }));
//! run(&mut rig, 600, order(2, Order::Home { axis: ALL_AXES }));
//! let reports = run(&mut rig, 2000, order(3, Order::MoveTo { axis: 0, position_urad: 436_332 }));
//! assert!(reports.iter().any(|report| matches!(report, Report::Done { .. })));
//! assert_eq!(rig.state(), State::Holding);
//! ```
//! Deliberately absent: floats, allocation, clocks (time is an argument in microseconds), a second state machine.
#![no_std]
#![forbid(unsafe_code)]
#![warn(unreachable_pub)]

#[cfg(test)]
extern crate std;

pub mod can;
pub mod cobs;
mod coded;
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
