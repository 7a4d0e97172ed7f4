//! A sensor that measures a scene and sends its packets.

mod device;
mod faults;
mod scan;
mod spin;

pub use device::{MockSensor, MockSensorError};
pub use faults::{FaultCounts, FaultInjector, Faults};
pub use scan::{Column, Scan};
pub use spin::Spin;
