//! What a pass over a recording came to.

use sensors::Frame;
use sensors::router::{Router, Sensor, Unclaimed};
use serde::Serialize;

use super::beams::Slot;
use super::data_gaps::DataSpan;
use super::pitches::Pitches;
use crate::recording::fault::Fault;
use crate::recording::source::RecordingError;
use crate::recording::unread;
use crate::rig::{MountedSensor, Rig};

/// One sensor's packets.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct SensorSummary {
    pub sensor: String,
    /// By the demo's mock sensors; 0 where unknown.
    #[serde(skip_serializing_if = "is_zero")]
    pub packets_sent: u64,
    pub packets_recorded: u64,
    /// Losses of every kind, kernel and queue and decoder.
    pub lost: u64,
    pub frames: u64,
    pub complete_frames: u64,
    pub points: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for it")]
fn is_zero(value: &u64) -> bool {
    *value == 0
}

/// How a pass over a recording ended.
#[derive(Default)]
pub(crate) struct PassSummary {
    pub sensors: Vec<SensorSummary>,
    /// Data that is missing, in words.
    pub losses: Vec<String>,
    pub faults: Vec<Fault>,
    /// Longest revolution, ns.
    pub revolution_ns: u64,
    /// When each of the rig's sensors was.
    pub data_spans: Vec<DataSpan>,
    /// Angles of each of the rig's axes at the times of its sensor's frames.
    pub pitches: Vec<Pitches>,
}

impl PassSummary {
    pub(super) fn of(rig: &Rig) -> Self {
        let named = |sensor: &MountedSensor| SensorSummary {
            sensor: sensor.name.clone(),
            ..SensorSummary::default()
        };
        let data_spans = vec![DataSpan::default(); rig.sensors.len()];
        let pitches = vec![Pitches::default(); rig.sensors.len()];
        Self { sensors: rig.sensors.iter().map(named).collect(), data_spans, pitches, ..Self::default() }
    }

    pub(super) fn count(&mut self, sensor: usize, frame: &Frame) -> u64 {
        let summary = &mut self.sensors[sensor];
        summary.frames += 1;
        frame.time_span_ns().into_iter().for_each(|span_ns| self.data_spans[sensor].add(span_ns));
        summary.points += frame.first.points() as u64;
        if frame.azimuth_rate_rad_per_ns > 0.0 {
            let turn_ns = std::f64::consts::TAU / frame.azimuth_rate_rad_per_ns;
            self.revolution_ns = self.revolution_ns.max(turn_ns.round() as u64);
        }
        summary.frames - 1
    }

    /// Takes over what the decoder of a sensor counted, and looks whether it is the sensor that the mount file names.
    pub(super) fn close(
        &mut self,
        place: usize,
        sensor: &Sensor,
        slot: &Slot<'_>,
    ) -> Result<(), RecordingError> {
        let stats = sensor.stats();
        let summary = &mut self.sensors[place];
        if let Some((name, error)) = sensor.calibration_error() {
            let sensor = format!("{}, a {}", summary.sensor, sensor.product());
            let (name, error) = (name.to_owned(), error.to_string());
            return Err(RecordingError::CalibrationDoesNotFit { name, sensor, error });
        }
        summary.lost += stats.lost_packets + stats.malformed + stats.crc_errors + stats.late;
        summary.complete_frames = stats.complete_frames;
        self.losses.extend(unread::sensor_losses(&summary.sensor, sensor));
        let model = sensor.model().filter(|_| stats.packets > 0);
        self.faults.extend(model.and_then(|model| slot.wrong_model(&sensor.product(), model)));
        Ok(())
    }

    /// What came to a sensor's port and is not its own: packets of a second sensor, and those that no sensor claims. Where
    /// all are such, the metadata belong to another unit.
    pub(super) fn report_unknown_sources(&mut self, mounted: &MountedSensor, router: &Router) {
        let sensors = router.sensors();
        for other in sensors.iter().skip(1) {
            let (packets, source) = (other.stats().packets, other.source());
            let from = source.map_or(String::new(), |source| format!(", from {source}"));
            self.losses.push(format!("{}: {packets} packets of a second sensor{from}", mounted.name));
        }
        // two units of one serial number are among its decoder's losses
        let two_sources = sensors.first().and_then(Sensor::two_sources);
        let is_left =
            |entry: &&Unclaimed| entry.is_sensor_data && Some(&entry.reason) != two_sources.as_ref();
        let left: Vec<&Unclaimed> = router.unclaimed().filter(is_left).collect();
        let is_silent = sensors.first().is_some_and(|sensor| sensor.stats().packets == 0);
        match left.first() {
            Some(first) if is_silent => self.faults.push(metadata_of_another_unit(mounted, &first.reason)),
            _ => self.losses.extend(left.iter().map(|entry| {
                let Unclaimed { packets, length, reason, .. } = entry;
                format!("{}: {packets} packets of {length} bytes are not its own: {reason}", mounted.name)
            })),
        }
    }
}

pub(super) fn metadata_of_another_unit(sensor: &MountedSensor, reason: &str) -> Fault {
    let words = format!("the metadata given for {} belong to another unit: {reason}", sensor.name);
    Fault::new("metadata_of_another_unit", vec![sensor.name.clone()], words)
}
