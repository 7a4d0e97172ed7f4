//! A sensor that measures a scene and sends its packets.

mod aside;
mod device;
mod faults;
mod surroundings;

pub use device::{Line, MockSensor};
pub use faults::{FaultCounts, FaultInjector, Faults};
pub use surroundings::Surroundings;

use crate::simulate::frames::Scan;
