//! Devices to test against: sensors on loopback with their web servers, a rig behind a pty.

pub mod bus_servos;
pub(crate) mod demo;
mod device;
mod dynamixel;
mod feetech;
mod pty;
pub(crate) mod replay;
pub mod rig;
pub(crate) mod senders;
pub mod sensor;
mod servo_table;
pub mod transmit;
pub mod web;

pub(crate) use device::Device;
