//! A sensor that measures a scene and sends its packets.

mod auxiliary;
mod device;
mod faults;
mod sender;
mod surroundings;

pub use device::{MockSensor, PacketStream};
pub use faults::{FaultCounts, FaultInjector, Faults};
pub(crate) use sender::{Ended, Output, Sender};
pub use surroundings::Surroundings;

use crate::simulate::frames::Scan;
