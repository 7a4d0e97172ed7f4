//! Devices to test against: sensors on loopback with their web servers, a rig behind a pty.

pub mod dynamixel;
mod pty;
pub mod rig;
pub mod sensor;
pub mod transmit;
pub mod web;
