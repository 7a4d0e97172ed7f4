//! Ouster and Velodyne: bytes to returns and back, beams to rays, capture files.
//!
//! No sockets and no clock: time enters as an argument, bytes as slices. Every wire format decodes and encodes.
//!
//! The way of a packet: [`capture`] (or a socket elsewhere) yields a [`Packet`]; a [`Decoder`] turns packets into
//! [`Frame`]s, which hold ranges and never points; a [`SensorModel`] says where each range points ([`SensorModel::ray`]).

pub mod capture;
pub mod catalogue;
mod completed;
pub mod decoder;
pub mod frame;
pub mod model;
pub mod ouster;
pub mod packet;
pub mod projection;
pub mod router;
pub mod velodyne;

pub use completed::Completed;
pub use decoder::{DecodeStats, Decoded, Decoder, Rejected};
pub use frame::{Frame, Health, Layer};
pub use model::{Beam, BeamCorrection, Ray, SensorModel};
pub use packet::Packet;
