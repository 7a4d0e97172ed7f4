//! A sensor that measures a scene and sends its packets.

mod aside;
mod device;
mod faults;
mod scan;
mod spin;

pub use device::{Line, MockSensor, Surroundings};
pub use faults::{FaultCounts, FaultInjector, Faults};
pub use spin::Spin;

use scan::{Column, Scan};
