//! The one 3-D viewer, embedded as its files stand here: in reports, in the page of a recording, in the daemon's page.

#[cfg(feature = "daemon")]
mod served;

#[cfg(feature = "daemon")]
pub(crate) use served::{Ground, Heading, serve};

/// Points, lines and surfaces under a camera.
pub(crate) const CLOUD: &str = concat!(include_str!("colours.js"), include_str!("cloud.js"));
/// The 3-D pictures of a report.
pub(crate) const ORBIT: &str = include_str!("orbit.js");
