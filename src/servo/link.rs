//! What carries frames between host and rig.

use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use firmware_protocol::{Frame, LinkCounters};

use super::can_bus::CanLink;
use super::{DynamixelLink, LinkError, SerialLink};

/// A frame and when it came.
#[derive(Clone, Copy, Debug)]
pub struct Received {
    /// The host's clock, ns since the Unix epoch (or since a simulation began).
    pub time_ns: u64,
    /// The frame.
    pub frame: Frame,
}

/// The Unix clock, read once: it never jumps while a line is open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    started: Instant,
    started_unix_ns: u64,
}

impl Clock {
    pub(super) fn start() -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { started: Instant::now(), started_unix_ns: unix.as_nanos() as u64 }
    }

    pub(super) fn now_ns(&self) -> u64 {
        self.started_unix_ns + self.started.elapsed().as_nanos() as u64
    }
}

/// A line to a rig. It also says what time it is, so that a simulated line brings simulated time.
pub trait Link: Send {
    /// Sends one frame. Never blocks longer than the line's own write timeout.
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError>;

    /// Waits for one frame. `None` when none came in time.
    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError>;

    /// The host's clock, ns.
    fn now_ns(&self) -> u64;

    /// What the receiver counted.
    fn counters(&self) -> LinkCounters;

    /// The line's name in errors and on the screen.
    fn name(&self) -> &str;
}

impl<L: Link + ?Sized> Link for Box<L> {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        (**self).send(frame)
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        (**self).receive(wait)
    }

    fn now_ns(&self) -> u64 {
        (**self).now_ns()
    }

    fn counters(&self) -> LinkCounters {
        (**self).counters()
    }

    fn name(&self) -> &str {
        (**self).name()
    }
}

/// Opens a line by its address: `can:can0` is a CAN interface, `slcan:/dev/ttyACM0` a CAN adapter on a serial port,
/// `dynamixel:/dev/ttyUSB0@57600:1,2` a bus with two servos (baud rate and ids of axes 0 and 1; these are the defaults),
/// and anything else a serial port.
pub fn open(address: &str) -> Result<Box<dyn Link>, LinkError> {
    Ok(match address.split_once(':') {
        Some(("can", interface)) => Box::new(CanLink::open(interface)?),
        Some(("slcan", path)) => Box::new(SerialLink::open_slcan(Path::new(path))?),
        Some(("dynamixel", bus)) => {
            let (path, baud, ids) = dynamixel_address(bus).ok_or_else(|| LinkError::Open {
                path: address.to_owned(),
                reason: "expected dynamixel:PATH, dynamixel:PATH@BAUD or dynamixel:PATH@BAUD:ID,ID".into(),
            })?;
            Box::new(DynamixelLink::open(Path::new(path), baud, ids)?)
        }
        _ => Box::new(SerialLink::open(Path::new(address))?),
    })
}

fn dynamixel_address(bus: &str) -> Option<(&str, u32, [u8; 2])> {
    let Some((path, rest)) = bus.split_once('@') else { return Some((bus, 57_600, [1, 2])) };
    let (baud, ids) = rest.split_once(':').unwrap_or((rest, "1,2"));
    let (a, b) = ids.split_once(',')?;
    let ids = [a.parse().ok()?, b.parse().ok()?];
    (ids[0] != ids[1] && ids.iter().all(|id| *id <= 252)).then_some((path, baud.parse().ok()?, ids))
}
