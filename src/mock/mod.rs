//! Devices to test against: sensors on loopback, a rig behind a pty.

pub mod rig;
pub mod sensor;
pub mod transmit;
