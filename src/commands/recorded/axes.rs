//! What the axes of a session measured.

use anyhow::ensure;
use sensors::Frame;
use serde::Serialize;

use crate::drive::ServoReport;
use crate::recording::Session;
use crate::report::chart::signed;
use crate::rig::{MountedSensor, Rig};
use crate::verify::compare::{FramePitch, TiltHistory, TiltReading};

use super::homing::{self, CONTRADICTS_RAD};

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
    fn rad(&self, sensor: &str) -> f64 {
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

/// One servo axis.
#[derive(Debug, Serialize)]
pub struct AxisSummary {
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
pub(crate) fn reports_of(session: &Session, rig: &Rig) -> anyhow::Result<Vec<ServoReport>> {
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
pub struct Tilts {
    /// Pitches of each sensor of the rig, zeros added; none for a sensor on an axis that measured nothing.
    pub histories: Vec<TiltHistory>,
    /// Axes that were not homed, in words.
    pub notices: Vec<String>,
}

/// Pitches of a session's sensors as their axes measured them; nothing where it holds no reports.
pub(crate) fn tilts(session: &Session, rig: &Rig, zeros: &AxisZeros) -> anyhow::Result<Tilts> {
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

/// Angles of an axis at the times of its sensor's frames, their zero added: what it measured before and after counts nothing.
#[derive(Clone, Debug, Default)]
pub struct Pitches {
    frames: u64,
    sum_rad: f64,
    span_rad: Option<[f64; 2]>,
    /// Arrival of the first and the last frame, ns.
    host_ns: Option<[u64; 2]>,
    readings: usize,
    /// Frames near which nothing was read, and how far the nearest reading was from the first of them, ns.
    unknown: u64,
    nearest_ns: u64,
}

impl Pitches {
    /// Takes that of a frame.
    pub(crate) fn add(&mut self, tilt: &TiltHistory, frame: &Frame) -> Option<FramePitch> {
        let device_ns = frame.time_span_ns().unwrap_or_default();
        let Some(pitch) = tilt.pitch_over(frame.host_time_ns, device_ns) else {
            if frame.host_time_ns.iter().any(|time_ns| tilt.lacks_zero(*time_ns)) {
                return None; // reported once for the axis
            }
            if self.unknown == 0 {
                self.nearest_ns = tilt.nearest_ns(frame.host_time_ns[0]).unwrap_or(0);
            }
            self.unknown += 1;
            return None;
        };
        self.frames += 1;
        self.sum_rad += pitch.mean_rad();
        let [least_rad, max_rad] = pitch.span_rad();
        let span_rad = self.span_rad.get_or_insert([least_rad, max_rad]);
        *span_rad = [span_rad[0].min(least_rad), span_rad[1].max(max_rad)];
        let [first_ns, last_ns] = frame.host_time_ns;
        // a reading within two frames' times counts once
        let from_ns = self.host_ns.map_or(first_ns, |host_ns| host_ns[1] + 1);
        self.readings += tilt.readings_within([from_ns, last_ns]);
        let host_ns = self.host_ns.get_or_insert(frame.host_time_ns);
        *host_ns = [host_ns[0].min(first_ns), host_ns[1].max(last_ns)];
        Some(pitch)
    }

    /// Frames with an unknown angle, in words; none where all are known.
    pub(crate) fn unknown(&self, sensor: &str) -> Option<String> {
        (self.unknown > 0).then(|| {
            format!(
                "{sensor}: its axis measured nothing near {} of {} revolutions (the nearest reading is {:.1} s from the first of \
                 these): the angle of the mount file was used for them",
                self.unknown,
                self.unknown + self.frames,
                self.nearest_ns as f64 * 1e-9
            )
        })
    }
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
