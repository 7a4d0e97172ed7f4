//! Links to a servo rig and the host's side of the conversation with it.
//!
//! [`Rig`] is what the rest of the program uses: `Rig::connect(path)`, `.home()`, `.arm()`, `.apply(&[pitch_rad])`,
//! `.reports()`. Its thread keeps the watchdog fed, so the rig holds while the program records. [`RigController`] is the
//! same conversation without a thread or a clock: a [`Link`] says what time it is.

mod can_bus;
mod controller;
pub(crate) mod dynamixel;
mod error;
pub(crate) mod framing;
mod link;
mod report;
mod rig;
mod serial;
pub(crate) mod slcan;
mod view;

pub use can_bus::CanLink;
pub use controller::{Applied, AppliedAxis, Interrupt, Options, Progress, ReportSink, RigController};
pub use dynamixel::DynamixelLink;
pub use error::{LinkError, RigError};
pub use link::{Link, Received, open};
pub use report::{AxisStatus, RigStatus, ServoReport};
pub use rig::Rig;
pub use serial::SerialLink;
