//! Zeros of servo axes that are added to what the axes measured.

use super::tilt::TiltHistory;
use crate::recording::source::RecordingError;
use crate::rig::Rig;

/// Zeros of servo axes by the names of their sensors, degrees.
#[derive(Clone, Debug, Default)]
pub(crate) struct AxisZeros(pub Vec<(String, f64)>);

impl AxisZeros {
    /// That of a sensor's axis.
    pub(super) fn rad(&self, sensor: &str) -> f64 {
        let zero = self.0.iter().find(|(name, _)| name == sensor);
        zero.map_or(0.0, |(_, degrees)| degrees.to_radians())
    }

    /// Each belongs to an axis that measured something.
    pub(super) fn ensure_measured(&self, rig: &Rig, tilts: &[TiltHistory]) -> Result<(), RecordingError> {
        let measured = || rig.sensors.iter().zip(tilts).filter(|(_, tilt)| tilt.is_measured());
        let other = self.0.iter().find(|(name, _)| !measured().any(|(sensor, _)| sensor.name == *name));
        other.map_or(Ok(()), |(name, _)| Err(RecordingError::ZeroOfNothing { sensor: name.clone() }))
    }
}
