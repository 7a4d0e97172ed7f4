//! What the axes of a session measured.

use anyhow::ensure;
use serde::Serialize;

use crate::drive::ServoReport;
use crate::recording::Session;
use crate::report::chart::signed;
use crate::rig::{MountedSensor, Rig};
use crate::verify::compare::{TiltHistory, TiltReading};

use super::homing::{self, CONTRADICTS_RAD};

/// Zeros of servo axes, as typed.
#[derive(clap::Args, Debug, Default)]
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
    fn rad(&self, sensor: &str) -> f64 {
        let zero = self.zeros_deg.iter().find(|(name, _)| name == sensor);
        zero.map_or(0.0, |(_, degrees)| degrees.to_radians())
    }

    /// Each belongs to an axis that measured something.
    pub fn ensure_measured(&self, axes: &[AxisSummary]) -> anyhow::Result<()> {
        for (name, _) in &self.zeros_deg {
            ensure!(
                axes.iter().any(|axis| axis.sensor == *name),
                "--axis-zero {name}=...: the recording holds no angle that an axis of a sensor of this name measured"
            );
        }
        Ok(())
    }
}

/// One servo axis.
#[derive(Debug, Serialize)]
pub struct AxisSummary {
    pub sensor: String,
    pub target_pitch_deg: f64,
    /// Mean of what the axis measured while recording.
    pub measured_pitch_deg: f64,
    /// What was typed to be added to it.
    pub zero_deg: f64,
    /// Greatest minus least of it.
    pub measured_span_deg: f64,
    pub reports: usize,
}

/// What a session's axes reported, with readings that have no zero named so, each `axis` as the place of its sensor in `rig`. Axis 0 turns the first sensor of the
/// session's own mount file, wherever another file of the same sensors may list it.
pub fn reports_of(session: &Session, rig: &Rig) -> anyhow::Result<Vec<ServoReport>> {
    let mut reports: Vec<ServoReport> = session.servo()?;
    // a session whose copy is gone can still be held against a file that is named
    let own = session.mount().ok().flatten();
    let seats: Option<Vec<usize>> =
        own.and_then(|own| own.sensors.iter().map(|sensor| rig.seat(&sensor.name).ok()).collect());
    // with other names the order is all that is known
    for report in &mut reports {
        let seat = seats.as_ref().and_then(|seats| seats.get(report.axis));
        report.axis = seat.copied().unwrap_or(report.axis);
    }
    homing::doubt_old(&mut reports, rig);
    Ok(reports)
}

/// What a session's axes measured.
#[derive(Default)]
pub struct Tilts {
    /// Pitches of each sensor of the rig, zeros added; of one whose axis measured nothing, none.
    pub histories: Vec<TiltHistory>,
    pub axes: Vec<AxisSummary>,
    /// Axes that were not homed, in words.
    pub notices: Vec<String>,
}

/// Pitches of a session's sensors as their axes measured them; nothing where it holds no reports.
pub fn tilts(session: &Session, rig: &Rig, zeros: &AxisZeros) -> anyhow::Result<Tilts> {
    let reports = reports_of(session, rig)?;
    let mut tilts = Tilts::default();
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let rad = |urad: i32| f64::from(urad) * 1e-6;
        let zero_rad = zeros.rad(&sensor.name);
        let own: Vec<&ServoReport> = reports.iter().filter(|report| report.axis == axis).collect();
        let measured: Vec<TiltReading> = own
            .iter()
            .filter(|report| report.source == "measured")
            .map(|report| TiltReading {
                time_ns: report.time_ns,
                pitch_rad: rad(report.position_urad) + zero_rad,
                uncertainty_rad: report.uncertainty_urad.map(rad),
                held_rad: (report.state == "holding").then(|| rad(report.target_urad) + zero_rad),
            })
            .collect();
        let count = measured.len();
        let sum: f64 = measured.iter().map(|reading| reading.pitch_rad).sum();
        let mut tilt = TiltHistory::new(measured);
        tilt.set_nominal(sensor.mount.pitch_rad, homing::without_zero_ns(&own));
        tilts.notices.extend(homing::notice(sensor, &own));
        if let Some([least, greatest]) = tilt.span_rad() {
            tilts.axes.push(AxisSummary {
                sensor: sensor.name.clone(),
                target_pitch_deg: sensor.mount.pitch_rad.to_degrees(),
                measured_pitch_deg: (sum / count as f64 - zero_rad).to_degrees(),
                zero_deg: zero_rad.to_degrees(),
                measured_span_deg: (greatest - least).to_degrees(),
                reports: count,
            });
        }
        tilts.histories.push(tilt);
    }
    Ok(tilts)
}

/// Mounts whose pitch is none that their axis measured: the axis counts, whatever the mount file says. Whoever typed a zero
/// knows.
pub fn contradicted(rig: &Rig, tilts: &[TiltHistory], zeros: &AxisZeros) -> Vec<String> {
    let words = |(sensor, tilt): (&MountedSensor, &TiltHistory)| {
        let (said_rad, [least_rad, greatest_rad]) = (sensor.mount.pitch_rad, tilt.span_rad()?);
        let is_typed = zeros.rad(&sensor.name) != 0.0;
        let differs = said_rad < least_rad - CONTRADICTS_RAD || said_rad > greatest_rad + CONTRADICTS_RAD;
        let degrees = |rad: f64| signed(rad.to_degrees(), 2);
        (differs && !is_typed).then(|| {
            format!(
                "{}: the mount file says {} degrees, its axis {} to {}: the axis counts (--axis-zero adds to it)",
                sensor.name,
                degrees(said_rad),
                degrees(least_rad),
                degrees(greatest_rad)
            )
        })
    };
    rig.sensors.iter().zip(tilts).filter_map(words).collect()
}
