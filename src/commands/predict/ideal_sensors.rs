//! The ideal sensors of `predict --ideal`.

use anyhow::bail;

use crate::rig::{MountedSensor, Rig, Unit};
use crate::simulate::fan::BeamFan;
use crate::simulate::ideal::IdealSensors;
use crate::simulate::prediction::Site;
use crate::simulate::view::{CastView, Sampling};

pub(super) fn sensors(units: &[Unit], rig: &Rig, site: &Site, sampling: &Sampling) -> IdealSensors {
    IdealSensors {
        scene: site.loaded.scene.clone(),
        trajectory: site.trajectory.clone(),
        rig: rig.clone(),
        fans: units.iter().map(|unit| fan(unit, sampling)).collect(),
        scan_stride: sampling.scan_stride,
    }
}

/// Columns and revolutions of each sensor.
pub(super) fn spins(view: &CastView, rig: &Rig) -> Vec<(usize, u64)> {
    let spin = |sensor: &MountedSensor| {
        let (fan, scans) = view.fan_of(&sensor.model);
        (fan.columns, scans.count)
    };
    rig.sensors.iter().map(spin).collect()
}

fn fan(unit: &Unit, sampling: &Sampling) -> BeamFan {
    let columns = sampling.columns.unwrap_or(unit.columns);
    let mut fan = BeamFan::nominal(&unit.model, columns as usize, sampling.rate_hz.unwrap_or(unit.rate_hz));
    fan.min_range_m = sampling.min_range_m.unwrap_or(fan.min_range_m);
    fan.max_range_m = sampling.quality.max_range_m.unwrap_or(fan.max_range_m);
    fan.min_cosine = sampling.quality.min_cosine();
    fan
}

pub(super) fn ensure_a_revolution(sensors: &IdealSensors, name: &str) -> anyhow::Result<()> {
    let Some(slow) = sensors.fans.iter().find(|fan| fan.scans(&sensors.trajectory) == 0) else {
        return Ok(());
    };
    let [start_ns, end_ns] = sensors.trajectory.time_span_ns();
    bail!(
        "{name}: {} s long, expected at least one revolution of {} s",
        (end_ns - start_ns) as f64 * 1e-9,
        1.0 / slow.rate_hz
    )
}
