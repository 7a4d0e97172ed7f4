//! A sensor that measures a scene and sends its packets.

mod aside;
mod device;
mod faults;

pub use device::{Line, MockSensor, Surroundings};
pub use faults::{FaultCounts, FaultInjector, Faults};

use crate::simulate::frames::Scan;
