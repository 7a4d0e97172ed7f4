//! What carries frames between host and rig.

use std::time::Duration;

use firmware_protocol::{Frame, LinkCounters};

use super::LinkError;

/// A frame and when it came.
#[derive(Clone, Copy, Debug)]
pub struct Received {
    /// The host's clock, ns since the Unix epoch (or since a simulation began).
    pub time_ns: u64,
    /// The frame.
    pub frame: Frame,
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

    /// A device's own errors, in words. Empty for a rig: it reports faults.
    fn device_errors(&self, axis: usize) -> Vec<String>;

    /// Whether devices behind this line are being set up, and silence means nothing.
    fn is_busy(&self) -> bool;

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

    fn device_errors(&self, axis: usize) -> Vec<String> {
        (**self).device_errors(axis)
    }

    fn is_busy(&self) -> bool {
        (**self).is_busy()
    }

    fn name(&self) -> &str {
        (**self).name()
    }
}
