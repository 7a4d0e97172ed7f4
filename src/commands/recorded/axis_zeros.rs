//! Zeros of servo axes, as typed.

use anyhow::ensure;

use crate::rig::Rig;
use crate::verify::compare::TiltHistory;

/// Zeros of servo axes, as typed.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct AxisZeros {
    /// What the angles that an axis measured lack, degrees, as `compare` found it for the axis of this sensor; once per
    /// sensor. Of the recording alone: the servo itself is not changed.
    #[arg(long = "axis-zero", value_name = "SENSOR=DEG", value_parser = axis_zero)]
    zeros_deg: Vec<(String, f64)>,
}

fn axis_zero(text: &str) -> Result<(String, f64), String> {
    let (sensor, degrees) = text.split_once('=').ok_or("expected SENSOR=DEG")?;
    let degrees: f64 = degrees.parse().map_err(|error| format!("{degrees:?}: {error}"))?;
    if degrees.is_nan() || degrees.abs() > 180.0 {
        return Err(format!("{degrees}: expected degrees within 180 of nothing"));
    }
    Ok((sensor.into(), degrees))
}

impl AxisZeros {
    /// That of a sensor's axis.
    pub(super) fn rad(&self, sensor: &str) -> f64 {
        let zero = self.zeros_deg.iter().find(|(name, _)| name == sensor);
        zero.map_or(0.0, |(_, degrees)| degrees.to_radians())
    }

    /// Each belongs to an axis that measured something.
    pub(crate) fn ensure_measured(&self, rig: &Rig, tilts: &[TiltHistory]) -> anyhow::Result<()> {
        let measured = || rig.sensors.iter().zip(tilts).filter(|(_, tilt)| tilt.is_measured());
        for (name, _) in &self.zeros_deg {
            ensure!(
                measured().any(|(sensor, _)| sensor.name == *name),
                "--axis-zero {name}=...: the recording holds no angle that an axis of a sensor of this name measured"
            );
        }
        Ok(())
    }
}
