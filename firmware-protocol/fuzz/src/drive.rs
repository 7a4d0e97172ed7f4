//! What the fuzz targets do with bytes: nothing may panic, what decodes must encode to the same again, and a rig must stay
//! inside its limits whatever order arrives.

use firmware_protocol::simulated::SimulatedAxis;
use firmware_protocol::{Command, Config, Controller, Direction, Frame, Order, Receiver, Report, ResetCause};

/// Any bytes on the line.
pub fn line(bytes: &[u8]) {
    let mut receiver = Receiver::default();
    for frame in bytes.iter().filter_map(|byte| receiver.push(*byte)) {
        let mut again = Receiver::default();
        let decoded = frame.encode().bytes().iter().find_map(|byte| again.push(*byte));
        assert_eq!(decoded, Some(frame));
    }
    if let [message, data @ ..] = bytes {
        if let Ok(command) = Command::decode(*message, data) {
            let frame = Frame::command(0, 1, &command);
            let again = Command::decode(frame.id.message, frame.data());
            // the one angle of a pair message that has no positive twin is clamped
            assert!(
                again == Ok(command)
                    || matches!(command, Command::Order { order: Order::MovePair { .. }, .. })
            );
        }
        if let Ok(report) = Report::decode(*message, data) {
            let frame = Frame::report(0, 1, &report);
            assert_eq!(frame.id.direction, Direction::ToHost);
            assert_eq!(Report::decode(frame.id.message, frame.data()), Ok(report));
        }
    }
}

/// Any commands at any time: chunks of message number, milliseconds to wait (times eight) and eight bytes of data.
pub fn rig(bytes: &[u8]) {
    let config = Config::<2>::default();
    let axes = [SimulatedAxis::new(1, 0, 0), SimulatedAxis::new(2, 0, 0)];
    let mut controller = Controller::new(config, axes, ResetCause::PowerOn, 0);
    let mut now_us = 0;
    for chunk in bytes.chunks_exact(10) {
        for length in 2..=8 {
            if let Ok(command) = Command::decode(chunk[0], &chunk[2..2 + length]) {
                controller.handle(now_us, &command, &mut |report| {
                    let _ = report.encode();
                });
            }
        }
        for _ in 0..u64::from(chunk[1]) * 8 {
            now_us += 1000;
            controller.step(now_us, &mut |report| {
                let _ = report.encode();
            });
            for axis in 0..2 {
                let at = controller.servo_mut(axis).map_or(0, |axis| axis.true_position_urad());
                assert!(at.abs() <= config.axes[0].maximum_urad + 12_000 || limits_were_set(bytes), "{at}");
            }
        }
    }
}

/// Whether the input may have changed the limits, which are then the input's own business.
fn limits_were_set(bytes: &[u8]) -> bool {
    bytes.chunks_exact(10).any(|chunk| chunk[0] == 0x18)
}
