//! Velodyne VLP-16, Puck LITE, Puck Hi-Res, VLP-32, VLS-128, HDL-32E and HDL-64E: data and position packets,
//! calibration, encode and decode.
//!
//! A data packet ([`wire`]) holds firing sequences; [`VelodyneDecoder`] puts packets in order, dates and places each
//! sequence, and gathers a revolution of them in a [`crate::Frame`]: one column per firing sequence, one channel per
//! laser.

mod blocks;
mod building;
pub mod calibration;
mod checks;
mod clock;
mod decoder;
mod detect;
mod doubt;
mod encode;
mod heads;
mod kernels;
mod nmea;
mod odd_stamps;
mod position;
mod product;
mod source;
mod stream;
#[cfg(test)]
mod tests;
mod view;
mod window;
pub mod wire;

pub(crate) use calibration::StatusReader;
pub use calibration::{Calibration, CalibrationError, LaserCalibration};
pub use decoder::{DEFAULT_HELD_PACKETS, Options, VelodyneDecoder};
pub use detect::Identity;
pub(crate) use detect::status_bytes;
pub use encode::{Column, VelodyneEncoder};
pub use nmea::{Fix, NmeaError, rmc_sentence};
pub use position::{Inertial, Position, PulseState, Thermal};
pub use product::{Product, ReturnMode};
pub use stream::Cut;
