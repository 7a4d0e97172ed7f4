//! Ouster OS0, OS1, OS2 and OSDome: lidar, IMU and zone packets, metadata, encode and decode.
//!
//! [`Metadata`] says how a sensor's packets are laid out and where its beams point; [`OusterDecoder`] turns packets
//! into frames, [`OusterEncoder`] frames into packets. Pixel layouts are tables in [`profile`].

pub mod encode;
pub mod imu;
pub mod metadata;
pub mod profile;
pub mod wire;
pub mod zones;

mod assembly;
mod claim;
mod decoder;
mod evidence;
mod held;
mod kernels;
mod look;
#[cfg(test)]
mod segment_tests;
mod segments;
mod stream;
mod strays;
#[cfg(test)]
mod tests;

pub use claim::Claim;
pub use decoder::OusterDecoder;
pub use encode::{Checksum, OusterEncoder};
pub use evidence::Correction;
pub use imu::ImuSample;
pub use metadata::{ImuProfile, Metadata, MetadataError, Synthetic, TimestampMode};
pub use profile::Profile;
pub use wire::HeaderKind;
pub use zones::{ZoneReport, ZoneState};
