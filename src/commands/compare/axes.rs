//! What the axes of a session measured.

use serde::Serialize;

use crate::compare::{TiltHistory, TiltReading};
use crate::record::Session;
use crate::rig::Rig;
use crate::servo::ServoReport;

/// One servo axis.
#[derive(Debug, Serialize)]
pub struct AxisSummary {
    pub sensor: String,
    pub target_pitch_deg: f64,
    /// Mean of what the axis measured while recording.
    pub measured_pitch_deg: f64,
    /// Greatest minus least of it.
    pub measured_span_deg: f64,
    pub reports: usize,
}

/// What the axes of a session measured; nothing where it holds no reports.
pub fn tilts(session: &Session, rig: &Rig) -> anyhow::Result<(Vec<TiltHistory>, Vec<AxisSummary>)> {
    let reports: Vec<ServoReport> = session.servo()?;
    let (mut tilts, mut axes) = (Vec::new(), Vec::new());
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let rad = |urad: i32| f64::from(urad) * 1e-6;
        let measured: Vec<TiltReading> = reports
            .iter()
            .filter(|report| report.axis == axis && report.source == "measured")
            .map(|report| TiltReading {
                time_ns: report.time_ns,
                pitch_rad: rad(report.position_urad),
                uncertainty_rad: report.uncertainty_urad.map(rad),
                held_rad: (report.state == "holding").then(|| rad(report.target_urad)),
            })
            .collect();
        let count = measured.len();
        let sum: f64 = measured.iter().map(|reading| reading.pitch_rad).sum();
        let tilt = TiltHistory::new(measured);
        if let Some([least, greatest]) = tilt.span_rad() {
            axes.push(AxisSummary {
                sensor: sensor.name.clone(),
                target_pitch_deg: sensor.mount.pitch_rad.to_degrees(),
                measured_pitch_deg: (sum / count as f64).to_degrees(),
                measured_span_deg: (greatest - least).to_degrees(),
                reports: count,
            });
        }
        tilts.push(tilt);
    }
    Ok((tilts, axes))
}
