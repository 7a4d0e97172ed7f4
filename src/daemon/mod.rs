//! The daemon: sensors, rig and recorder of one `rig.toml`, live, with a page to see and steer them by.
//!
//! ```text
//! socket -> receive thread -> receive worker -> session on the disk     (first; a slow disk holds up this worker alone)
//!                                          \-> live thread -> Status     (low priority, and counts what it left out)
//!                                                        \-> points, coverage -> page
//! rig <-> drive::Rig's thread <-> rig thread -> Status, session
//! coverage, map of the place -> better pitches, when asked -> rig and a new session, when agreed to
//! ```
//!
//! Three things never wait for each other: receiving, the rig's conversation, and the page. The recorder comes before
//! the picture: a receive worker hands its packets to the session first and to the live thread after that, and there without
//! waiting. Everything that happens is an [`Event`]: a line of the session, a line of the log, a line on the page.

mod coverage;
mod engine;
mod hub;
mod intake;
mod journal;
mod latency;
mod live;
mod log;
mod painter;
mod picture;
mod site;
mod problems;
mod recorder;
mod rig;
mod session_sink;
mod status;
mod steady;
mod supervision;
mod surroundings;
mod survey;
mod web;

pub use engine::{Daemon, DaemonError, Ending, ProposalError, SensorSettings, Settings};
pub use journal::Event;
pub use latency::Percentiles;
pub use log::Log;
pub use picture::{COVERAGE_KIND, POINTS_KIND};
pub use recorder::{RecorderError, RecorderSettings};
pub use rig::{RigCommandError, RigSettings};
pub use site::Site;
pub use status::{
    Component, ComponentState, CoverageStatus, LastSession, LogStatus, MemoryStatus, Problem, Proposal,
    RecorderStatus, RigState, SensorLosses, SensorState, SensorStatus, Severity, Status,
};
pub use steady::HostClock;
pub use supervision::{Supervision, words};
pub use web::{Token, Web, WebError, WebSettings};
