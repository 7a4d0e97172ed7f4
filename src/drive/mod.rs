//! Links to a servo rig and the host's side of the conversation with it.
//!
//! [`Rig`] is what the rest of the program uses: `Rig::connect(path)`, `.home()`, `.arm()`, `.apply(&[pitch_rad])`,
//! `.reports()`. Its thread serves the watchdog, so the rig holds while the program records. [`RigController`] is the
//! same conversation without a thread or a clock: a [`Link`] says what time it is.

mod bus_port;
pub(crate) mod bus_servos;
mod can_bus;
mod can_queue;
mod cia402;
mod controller;
pub(crate) mod dynamixel;
mod error;
pub(crate) mod feetech;
pub(crate) mod framing;
mod held;
mod hosted;
mod link;
mod open;
mod port;
mod report;
mod rig;
mod serial;
pub(crate) mod slcan;
mod usb;
mod view;

pub use can_bus::CanLink;
pub use controller::{Applied, AppliedAxis, Interrupt, Options, Progress, ReportSink, RigController};
pub use error::{LinkError, RigError};
pub use hosted::HostedLink;
pub use link::{Link, Received};
pub(crate) use open::is_no_path;
pub use open::open;
pub use report::{AxisStatus, RigStatus, WatchedAxis};
pub use rig::Rig;
pub use serial::SerialLink;
