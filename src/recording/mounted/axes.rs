//! What the axes of a session measured.

use serde::Serialize;

use super::axis_zeros::AxisZeros;
use super::homing::{self, CONTRADICTS_RAD};
use super::pitches::Pitches;
use super::tilt::{TiltHistory, TiltReading};
use crate::base::numbers::signed;
use crate::recording::source::RecordingError;
use crate::recording::{ServoReport, Session};
use crate::rig::{MountedSensor, Rig};

/// One servo axis.
#[derive(Debug, Serialize)]
pub(crate) struct AxisSummary {
    pub sensor: String,
    pub target_pitch_deg: f64,
    /// Mean of what the axis measured at the times of its sensor's frames.
    pub measured_pitch_deg: f64,
    /// What was typed to be added to it.
    pub zero_deg: f64,
    /// Maximum minus minimum of that.
    pub measured_span_deg: f64,
    /// Readings at those times.
    pub reports: usize,
}

/// What a session's axes reported, with readings that have no zero named so, each `axis` as the place of its sensor in `rig`. Axis 0 turns the first sensor of the
/// session's own mount file, wherever another file of the same sensors may list it.
pub(crate) fn reports_of(session: &Session, rig: &Rig) -> Result<Vec<ServoReport>, RecordingError> {
    let mut reports: Vec<ServoReport> = session.servo()?;
    // a session without its copy can still be compared with a named file
    let own = session.mount().ok().flatten();
    let slots: Option<Vec<usize>> =
        own.and_then(|own| own.sensors.iter().map(|sensor| rig.slot(&sensor.name).ok()).collect());
    // with other names the order is all that is known
    for report in &mut reports {
        let slot = slots.as_ref().and_then(|slots| slots.get(report.axis));
        report.axis = slot.copied().unwrap_or(report.axis);
    }
    homing::doubt_old(&mut reports, rig);
    Ok(reports)
}

/// What a session's axes measured.
#[derive(Default)]
pub(crate) struct Tilts {
    /// Pitches of each sensor of the rig, zeros added; none for a sensor on an axis that measured nothing.
    pub histories: Vec<TiltHistory>,
    /// Axes that were not homed, in words.
    pub notices: Vec<String>,
}

/// Pitches of a session's sensors as their axes measured them; nothing where it holds no reports.
pub(crate) fn tilts(session: &Session, rig: &Rig, zeros: &AxisZeros) -> Result<Tilts, RecordingError> {
    let reports = reports_of(session, rig)?;
    let mut tilts = Tilts::default();
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let rad = |urad: i32| f64::from(urad) * 1e-6;
        let zero_rad = zeros.rad(&sensor.name);
        let own: Vec<&ServoReport> = reports.iter().filter(|report| report.axis == axis).collect();
        let measured = own.iter().filter(|report| report.source == "measured");
        let readings = measured.map(|report| TiltReading {
            time_ns: report.time_ns,
            pitch_rad: rad(report.position_urad) + zero_rad,
            uncertainty_rad: report.uncertainty_urad.map(rad),
            held_rad: (report.state == "holding").then(|| rad(report.target_urad) + zero_rad),
        });
        let tilt = TiltHistory::new(readings.collect());
        tilts.histories.push(tilt.with_times_without_zero(homing::without_zero_ns(&own)));
        tilts.notices.extend(homing::notice(sensor, &own));
    }
    Ok(tilts)
}

/// What the axes measured while their sensors recorded.
pub(crate) fn summaries(rig: &Rig, zeros: &AxisZeros, pitches: &[Pitches]) -> Vec<AxisSummary> {
    let summary = |(sensor, pitches): (&MountedSensor, &Pitches)| {
        let [least_rad, max_rad] = pitches.span_rad?;
        let zero_rad = zeros.rad(&sensor.name);
        Some(AxisSummary {
            sensor: sensor.name.clone(),
            target_pitch_deg: sensor.mount.pitch_rad.to_degrees(),
            measured_pitch_deg: (pitches.sum_rad / pitches.frames as f64 - zero_rad).to_degrees(),
            zero_deg: zero_rad.to_degrees(),
            measured_span_deg: (max_rad - least_rad).to_degrees(),
            reports: pitches.readings,
        })
    };
    rig.sensors.iter().zip(pitches).filter_map(summary).collect()
}

/// Mounts with a pitch that their axis never measured: the axis counts, whatever the mount file says. Whoever typed a zero
/// knows.
pub(crate) fn contradicted(rig: &Rig, zeros: &AxisZeros, pitches: &[Pitches]) -> Vec<String> {
    let words = |(sensor, pitches): (&MountedSensor, &Pitches)| {
        let (nominal_rad, [least_rad, max_rad]) = (sensor.mount.pitch_rad, pitches.span_rad?);
        let is_typed = zeros.rad(&sensor.name) != 0.0;
        let differs = nominal_rad < least_rad - CONTRADICTS_RAD || nominal_rad > max_rad + CONTRADICTS_RAD;
        let degrees = |rad: f64| signed(rad.to_degrees(), 2);
        (differs && !is_typed).then(|| {
            format!(
                "{}: the mount file says {} degrees, its axis {} to {}: the axis counts (--axis-zero adds to it)",
                sensor.name,
                degrees(nominal_rad),
                degrees(least_rad),
                degrees(max_rad)
            )
        })
    };
    rig.sensors.iter().zip(pitches).filter_map(words).collect()
}
