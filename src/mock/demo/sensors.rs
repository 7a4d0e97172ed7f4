//! The mock sensors of the walk, and what the rig reports meanwhile.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use ::sensors::ouster::{ImuProfile, Metadata, Profile, Synthetic};
use ::sensors::velodyne::{Product, ReturnMode};

use super::error::DemoError;
use super::setup::Walk;
use crate::mock::sensor::{MockSensor, Surroundings};
use crate::mock::transmit::{Clock, Transmitter};
use crate::recording::LiveRecording;
use crate::recording::ServoReport;
use crate::rig::Mount;

/// Longest pause between two looks at the recording and the devices.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Columns per revolution of a mock Ouster.
const COLUMNS: usize = 512;
/// Revolutions per second.
pub(super) const SPIN_HZ: f64 = 10.0;

pub(super) fn mock_sensor(
    model: &str,
    index: usize,
    port: u16,
) -> Result<(MockSensor, Option<String>), DemoError> {
    if let Some(product) = Product::from_name(model) {
        return Ok((MockSensor::velodyne(product, ReturnMode::Strongest, SPIN_HZ)?, None));
    }
    let serial = 122_000_000_001 + index as u64;
    let mut wanted = Synthetic::new(model, serial, Profile::Rng19Rfl8Sig16Nir16).columns(COLUMNS, 16);
    wanted.frame_rate_hz = SPIN_HZ;
    wanted.lidar_port = port;
    // it sends none, and two sensors that say they send it to one port are refused by ouster-sdk
    wanted.imu_profile = ImuProfile::Off;
    let metadata = Metadata::synthetic(&wanted)?;
    let text = metadata.to_json();
    Ok((MockSensor::ouster(metadata), Some(text)))
}

/// What a mock sensor's thread shares with the walk.
pub(super) struct SensorProgress<'a> {
    pub(super) at_ns: &'a AtomicU64,
    pub(super) unplugged: &'a AtomicBool,
    pub(super) sent: &'a AtomicU64,
}

/// Runs a mock sensor to the end of the trajectory, or until it is unplugged.
pub(super) fn send_packets(
    walk: &Walk<'_>,
    sensor: &mut MockSensor,
    mount: &Mount,
    to: SocketAddr,
    clock: Clock,
    progress: &SensorProgress<'_>,
) -> Result<(), DemoError> {
    let mut transmitter = Transmitter::new(None, to, clock).map_err(DemoError::NoSocket)?;
    let around = Surroundings {
        scene: walk.scene,
        trajectory: walk.trajectory,
        body_from_sensor: &|_| mount.body_from_sensor(),
        noise_m: 0.0,
        seed: 0,
    };
    let outcome = sensor.run(&around, |time_ns, payload| {
        if progress.unplugged.load(Ordering::Relaxed) {
            return Err(None::<std::io::Error>);
        }
        transmitter.send(time_ns, payload, to).map_err(Some)?;
        progress.at_ns.store(time_ns, Ordering::Relaxed);
        progress.sent.fetch_add(1, Ordering::Relaxed);
        Ok(())
    });
    match outcome {
        Err(Some(error)) => Err(DemoError::CannotSend(error)),
        Ok(()) | Err(None) => Ok(()),
    }
}

/// Writes waiting servo reports; an error when the rig, the disk or the user ends the walk.
pub(super) fn write_reports(
    walk: &Walk<'_>,
    recording: &LiveRecording,
    servo: &crate::drive::Rig,
    reports: &std::sync::mpsc::Receiver<ServoReport>,
) -> Result<(), DemoError> {
    if walk.stop.load(Ordering::Relaxed) {
        return Err(DemoError::Interrupted);
    }
    // why it ended stands in the session, and closing it will say
    if recording.has_ended() {
        return Err(DemoError::RecordingEnded);
    }
    match reports.recv_timeout(LOOK_EVERY) {
        Ok(report) => {
            recording.session().write_servo(&report)?;
            if !report.faults.is_empty() {
                let faults = report.faults.join(", ");
                return Err(DemoError::AxisFaults { axis: report.axis, faults });
            }
        }
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => {
            servo.status()?;
            return Err(DemoError::RigSilent);
        }
    }
    Ok(())
}
