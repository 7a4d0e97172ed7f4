//! Second stage: a mock servo rig is homed, armed and driven to the pitches over its serial line.

use super::error::DemoError;
use crate::drive;
use crate::mock::rig::{MockConfig, MockRig};
use crate::rig::Rig;

/// A rig that holds its pitches.
pub(crate) struct Tilted {
    /// The device at the other end of the line.
    pub device: MockRig,
    /// This end of it.
    pub servo: drive::Rig,
    /// Where the axes really are, rad: what the mock sensors see by. The encoders report something close to it.
    pub true_pitch_rad: [f64; 2],
}

/// Drives axis i to the pitch of sensor i.
pub(crate) fn drive(rig: &Rig, seed: u64) -> Result<Tilted, DemoError> {
    let device = MockRig::start(MockConfig::default(), seed).map_err(DemoError::NoPty)?;
    let servo = drive::Rig::connect(device.path())?;
    servo.arm()?;
    servo.home()?;
    let pitches_rad: Vec<f64> = rig.sensors.iter().map(|sensor| sensor.mount.pitch_rad).collect();
    servo.apply(&pitches_rad)?;
    let true_pitch_rad = device.true_positions_rad().ok_or(DemoError::RigHungUp)?;
    Ok(Tilted { device, servo, true_pitch_rad })
}
