//! A CAN bus through Linux' SocketCAN: one message, one classic frame with a 29-bit identifier.
//!
//! An interface that goes down gives one read error and then silence, though it may come back; so the controller's own
//! watch over silence decides, and only a write says what the interface is up to.

use std::io::ErrorKind;
use std::time::Duration;

use firmware_protocol::{Direction, Frame, LinkCounters};
use socketcan::{
    CanDataFrame, CanFilter, CanFrame, CanSocket, EmbeddedFrame, ExtendedId, Frame as _, Socket,
    SocketOptions,
};

use super::{Link, LinkError, Received, can_queue};
use crate::live::clocks::host::steady_now_ns;

const WRITE_TIMEOUT: Duration = Duration::from_millis(200);

/// A CAN interface.
pub struct CanLink {
    name: String,
    socket: CanSocket,
    counters: LinkCounters,
    /// Last error report of the CAN controller.
    trouble: Option<String>,
}

impl CanLink {
    /// Opens an interface (`can0`) that is up; its bit rate is the system's business.
    pub(crate) fn open(interface: &str) -> Result<Self, LinkError> {
        let name = format!("can:{interface}");
        let failed =
            |error: std::io::Error| LinkError::Open { path: name.clone(), reason: error.to_string() };
        let socket = CanSocket::open(interface).map_err(failed)?;
        socket.set_write_timeout(WRITE_TIMEOUT).map_err(failed)?;
        // only what a rig says: the tag and the direction
        let reports = firmware_protocol::MessageId::new(0, Direction::ToHost, 0).encode();
        let mask = 0b11111 << 21 | 1 << 7;
        let extended = 1 << 31;
        socket.set_filters(&[CanFilter::new(reports & mask | extended, mask | extended)]).map_err(failed)?;
        socket.set_error_filter_accept_all().map_err(failed)?;
        Ok(Self { name, socket, counters: LinkCounters::default(), trouble: None })
    }
}

impl Link for CanLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        let wire = ExtendedId::new(frame.id.encode()).and_then(|id| CanDataFrame::new(id, frame.data()));
        let Some(wire) = wire else {
            return Err(LinkError::HungUp {
                path: self.name.clone(),
                reason: "a message over 8 bytes".into(),
            });
        };
        can_queue::send(&self.name, WRITE_TIMEOUT, || self.socket.write_frame(&wire))
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        let until_ns = steady_now_ns() + wait.as_nanos() as u64;
        loop {
            let left = Duration::from_nanos(until_ns.saturating_sub(steady_now_ns()));
            match self.socket.read_frame_timeout(left) {
                Ok(CanFrame::Data(wire)) if wire.is_extended() => {
                    if let Some(frame) = Frame::from_can(wire.raw_id(), wire.data()) {
                        self.counters.frames = self.counters.frames.wrapping_add(1);
                        return Ok(Some(Received { time_ns: steady_now_ns(), frame }));
                    }
                    self.counters.other_version = self.counters.other_version.wrapping_add(1);
                }
                Ok(CanFrame::Error(frame)) => {
                    let error = frame.into_error();
                    self.trouble = Some(error.to_string());
                    if error.is_bus_off() {
                        let reason = "the CAN controller went off the bus".to_owned();
                        return Err(LinkError::HungUp { path: self.name.clone(), reason });
                    }
                }
                Ok(_) => self.counters.malformed = self.counters.malformed.wrapping_add(1),
                Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {
                    return Ok(None);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // the interface went down: silence follows, and the controller knows what to do about silence
                Err(error) if error.raw_os_error() == Some(nix::libc::ENETDOWN) => {}
                Err(error) => {
                    return Err(LinkError::HungUp { path: self.name.clone(), reason: error.to_string() });
                }
            }
            if steady_now_ns() >= until_ns {
                return Ok(None);
            }
        }
    }

    fn now_ns(&self) -> u64 {
        steady_now_ns()
    }

    fn counters(&self) -> LinkCounters {
        self.counters
    }

    fn device_errors(&self, _axis: usize) -> Vec<String> {
        self.trouble.iter().map(|trouble| format!("CAN controller: {trouble}")).collect()
    }

    fn is_busy(&self) -> bool {
        false
    }

    fn name(&self) -> &str {
        &self.name
    }
}
