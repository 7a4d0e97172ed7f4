//! Ouster and Velodyne: bytes to returns and back, beams to rays, capture files.
//!
//! No sockets and no clock: time enters as an argument, bytes as slices. Every wire format decodes and encodes.
//!
//! The path of a packet: [`capture`] (or a socket elsewhere) yields a [`Packet`]; a [`Decoder`] turns packets into
//! [`Frame`]s, which hold ranges and never points; a [`SensorModel`] says where each range points ([`SensorModel::ray`]).
//!
//! ```
//! use sensors::velodyne::{Column, Options, Product, ReturnMode, VelodyneDecoder, VelodyneEncoder};
//! use sensors::{Decoded, Decoder, Packet};
//!
//! // a VLP-16 that turns once in a tenth of a second and sees a wall 4 m away, wherever it looks
//! let mut encoder = VelodyneEncoder::new(Product::Vlp16, ReturnMode::Strongest);
//! let mut datagrams = Vec::new();
//! for firing in 0..2000_u64 {
//!     let time_ns = (firing as f64 * encoder.cycle_ns()) as u64;
//!     let azimuth_rad = std::f64::consts::TAU * (time_ns as f64 * 10e-9).fract();
//!     let column = Column { time_ns, azimuth_rad, range_mm: &[4000; 16], reflectivity: &[90; 16], second: None };
//!     encoder.push_column(column, &mut |time_ns, payload| datagrams.push((time_ns, *payload)));
//! }
//!
//! let mut decoder = VelodyneDecoder::new(Options::default());
//! let mut returns = Vec::new();
//! for (time_ns, payload) in &datagrams {
//!     let (source, destination) = ("192.168.1.201:2368".parse().unwrap(), "192.168.1.1:2368".parse().unwrap());
//!     let packet = Packet { host_time_ns: 1_700_000_000_000_000_000 + time_ns, source, destination, link: Default::default(), payload };
//!     decoder.push(&packet, &mut |decoded| {
//!         let Decoded::Frame(frame) = decoded else { return };
//!         returns.push(frame.first.points());
//!         assert_eq!(frame.first.range_mm[frame.index(0, 15)], 4000);
//!     })?;
//! }
//! assert_eq!(returns.len(), 1, "the second revolution is not over");
//! assert!(returns[0] > 28_000);
//! assert_eq!(decoder.stats().lost_packets, 0);
//!
//! // where the highest beam points straight ahead: 15 degrees up
//! let model = decoder.model().unwrap();
//! let point_m = model.point(15, 0.0, 4.0);
//! assert!((point_m.z / 4.0 - 15_f64.to_radians().sin()).abs() < 0.01);
//! # Ok::<(), sensors::Rejected>(())
//! ```

#![warn(unreachable_pub)]

pub mod capture;
pub mod catalogue;
mod completed;
pub mod decoder;
pub mod frame;
pub mod made_up;
pub mod model;
pub mod ouster;
pub mod packet;
pub mod pattern;
pub mod projection;
pub mod router;
pub mod velodyne;

pub use completed::{Completed, Decoded};
pub use decoder::{DecodeStats, Decoder, Rejected};
pub use frame::{Frame, Health, Layer};
pub use model::{Beam, BeamCorrection, Ray, SensorModel};
pub use packet::{Link, Packet};
pub use pattern::Pattern;
