//! The mock rig on a CAN interface.

use std::io;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};

use firmware_protocol::{Frame, Receiver as FrameReceiver};
use socketcan::{CanDataFrame, CanFrame, CanSocket, EmbeddedFrame, ExtendedId, Frame as _, Socket};

use super::{MockConfig, MockDevice, MockFault};

/// Runs a rig on an interface until the channel of faults closes. An interface that goes down is waited for, as a
/// microcontroller would.
pub fn run(interface: &str, config: MockConfig, seed: u64, faults: &Receiver<MockFault>) -> io::Result<()> {
    let socket = CanSocket::open(interface)?;
    socket.set_write_timeout(Duration::from_millis(5))?;
    let mut device = MockDevice::new(config, seed, 0);
    let mut lines = FrameReceiver::default();
    let started = Instant::now();
    let mut out = Vec::new();
    loop {
        let now_us = started.elapsed().as_micros() as u64;
        match faults.try_recv() {
            Ok(MockFault::HangUp) | Err(TryRecvError::Disconnected) => return Ok(()),
            Ok(fault) => device.inject(now_us, fault),
            Err(TryRecvError::Empty) => {}
        }
        // anything wrong with the bus is silence to a rig
        match socket.read_frame_timeout(Duration::from_millis(1)) {
            Ok(CanFrame::Data(wire)) if wire.is_extended() => {
                if let Some(frame) = Frame::from_can(wire.raw_id(), wire.data()) {
                    device.take(now_us, frame.encode().bytes());
                }
            }
            Err(error) if error.raw_os_error() == Some(nix::libc::ENODEV) => return Err(error),
            _ => {}
        }
        device.step(now_us, &mut out);
        for bytes in out.drain(..) {
            for frame in bytes.iter().filter_map(|byte| lines.push(*byte)) {
                let wire =
                    ExtendedId::new(frame.id.encode()).and_then(|id| CanDataFrame::new(id, frame.data()));
                wire.iter().for_each(|wire| drop(socket.write_frame(wire)));
            }
        }
    }
}
