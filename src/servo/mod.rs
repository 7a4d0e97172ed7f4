//! Links to a servo rig and the host's side of the conversation with it.
//!
//! [`Rig`] is what the rest of the program uses: `Rig::connect(path)`, `.home()`, `.arm()`, `.apply(&[pitch_rad])`,
//! `.reports()`. Its thread keeps the watchdog fed, so the rig holds while the program records. [`RigController`] is the
//! same conversation without a thread or a clock: a [`Link`] says what time it is.

mod controller;
mod error;
mod link;
mod report;
mod rig;
mod serial;
mod view;

pub use controller::{Applied, AppliedAxis, Interrupt, Options, Progress, ReportSink, RigController};
pub use error::{LinkError, RigError};
pub use link::{Link, Received};
pub use report::{AxisStatus, RigStatus, ServoReport};
pub use rig::Rig;
pub use serial::SerialLink;
