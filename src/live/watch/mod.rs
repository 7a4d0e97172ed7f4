//! What is watched of one sensor while it is decoded: rates, losses, its clock, its own warnings.

mod beams;
mod described;
mod first_look;

pub(crate) use beams::silent_channels;
pub(crate) use described::{first_look, read_metadata};
pub(crate) use first_look::correction_words;
pub use first_look::{FirstLook, FirstLooks};

use self::beams::BeamWatch;
use crate::live::clocks::{ClockReport, ClockWatch};

use sensors::router::{Family, Sensor};
use sensors::velodyne::{Fix, Position, Product, PulseState};
use sensors::{DecodeStats, Decoded, Frame, Health, SensorModel};
use serde::Serialize;

/// Running numbers of one sensor.
#[derive(Default)]
pub struct Watch {
    frames: u64,
    complete: u64,
    points: Points,
    points_of_whole: Points,
    beams: BeamWatch,
    /// Revolutions that begin where revolutions do, and when the first and the last of them began, by the device's clock.
    begun: u64,
    begun_span_ns: Option<[u64; 2]>,
    clock: ClockWatch,
    restarts: u64,
    imu_samples: u64,
    position_packets: u64,
    position: Option<Position>,
    zone_reports: u64,
    health: Option<Health>,
}

/// Points of some revolutions.
#[derive(Clone, Copy, Default)]
struct Points {
    first: u64,
    second: u64,
}

/// One sensor as it is reported.
#[derive(Clone, Debug, Serialize)]
pub struct SensorReport {
    /// As in the documents of `decode`.
    pub id: String,
    /// `Ouster` or `Velodyne`.
    pub vendor: &'static str,
    /// Product.
    pub model: String,
    /// Serial number; empty when not known.
    pub serial: String,
    /// Firmware; empty when not known.
    pub firmware: String,
    /// Packet format.
    pub format: String,
    /// What is not as the packets claim.
    pub remark: Option<String>,
    /// Sender.
    pub source: Option<String>,
    /// Metadata it came from.
    pub metadata: Option<String>,
    /// Where its beams come from.
    pub beams: String,
    /// Clock that the metadata says it uses.
    pub timestamp_mode: Option<String>,
    /// Revolutions, whole or not.
    pub frames: u64,
    /// Of these, whole ones.
    pub complete_frames: u64,
    /// By the device's clock.
    pub frame_rate_hz: Option<f64>,
    /// First returns in a whole revolution, on average; in any, where none is whole.
    pub points_per_frame: Option<f64>,
    /// Second returns likewise.
    pub points_second_per_frame: Option<f64>,
    /// Inertial samples.
    pub imu_samples: u64,
    /// Position packets.
    pub position_packets: u64,
    /// Zone packets.
    pub zone_reports: u64,
    /// The device's clock.
    pub clock: Option<ClockReport>,
    /// GPS sentence the sensor passed on last.
    pub gps_sentence: Option<String>,
    /// Whether the receiver calls its position valid; none where the sentence cannot be read.
    pub gps_valid: Option<bool>,
    /// Pulse per second, as the last position packet says.
    pub pulse: Option<PulseState>,
    /// Hours in use, where the sensor says so.
    pub hours_in_use: Option<u16>,
    /// Beams that never return where their neighbours do, by their number in point files.
    pub silent_beams: Vec<u16>,
    /// The sensor's own warnings in its last revolution.
    pub warnings: Vec<String>,
    /// Everything its decoder counted.
    pub counters: DecodeStats,
}

impl Watch {
    /// Counts what was decoded.
    pub(crate) fn take(&mut self, decoded: &Decoded<'_>) {
        match decoded {
            Decoded::Frame(frame) => {
                self.frames += 1;
                self.complete += u64::from(frame.complete);
                self.points.add(frame);
                self.beams.take(frame);
                if frame.complete {
                    self.points_of_whole.add(frame);
                }
                self.health = Some(frame.health);
                if let Some([first_ns, _]) = frame.time_span_ns() {
                    // a recording begins in the middle of a revolution
                    if self.frames > 1 || frame.complete {
                        self.begun += 1;
                        self.begun_span_ns.get_or_insert([first_ns; 2])[1] = first_ns;
                    }
                    if std::mem::replace(&mut self.restarts, frame.restarts) != frame.restarts {
                        self.clock.restart();
                    }
                    self.clock.add(frame.host_time_ns[0], first_ns);
                }
            }
            Decoded::Imu(_) => self.imu_samples += 1,
            Decoded::Position(position) => {
                self.position_packets += 1;
                self.position = Some((*position).clone());
            }
            Decoded::Zones(_) => self.zone_reports += 1,
        }
    }

    fn silent_beams(&self, sensor: &Sensor, model: &SensorModel) -> Vec<u16> {
        let rings = match sensor.family() {
            Family::Velodyne(_) => model.rings_by_elevation(),
            Family::Ouster(_) => (0..model.channels() as u16).collect(),
        };
        self.beams.silent(model, &rings)
    }

    /// Says what was seen.
    pub(crate) fn report(&self, id: String, sensor: &Sensor) -> SensorReport {
        let (points, of) = match self.complete {
            0 => (self.points, self.frames),
            whole => (self.points_of_whole, whole),
        };
        let per_frame = |count: u64| (of > 0).then(|| count as f64 / of as f64);
        let (mut firmware, mut timestamp_mode, mut remark) = (String::new(), None, None);
        let gps_sentence;
        match sensor.family() {
            Family::Ouster(decoder) => {
                firmware.clone_from(&decoder.metadata().firmware);
                timestamp_mode = decoder.metadata().timestamp_mode.map(|mode| mode.name().to_owned());
                gps_sentence = decoder.nmea().map(|(_, text)| text.to_owned());
            }
            Family::Velodyne(decoder) => {
                let sentence = self.position.as_ref().map(|position| position.sentence.clone());
                gps_sentence = sentence.filter(|sentence| !sentence.is_empty());
                remark = decoder.identity().and_then(|identity| identity.remark.clone());
            }
        }
        SensorReport {
            id,
            vendor: sensor.vendor(),
            model: sensor.product(),
            serial: sensor.serial().to_owned(),
            firmware,
            format: sensor.format(),
            remark,
            source: sensor.source().map(|source| source.to_string()),
            metadata: sensor.metadata_name.clone(),
            beams: sensor.beams().to_string(),
            timestamp_mode,
            frames: self.frames,
            complete_frames: self.complete,
            frame_rate_hz: self.begun_span_ns.and_then(|span_ns| rate_hz(self.begun, span_ns)),
            points_per_frame: per_frame(points.first),
            points_second_per_frame: per_frame(points.second).filter(|_| points.second > 0),
            imu_samples: self.imu_samples,
            position_packets: self.position_packets,
            zone_reports: self.zone_reports,
            clock: self.clock.report(),
            gps_valid: gps_sentence.as_deref().and_then(|text| Fix::parse(text).ok()).map(|fix| fix.valid),
            gps_sentence,
            pulse: self.position.as_ref().map(|position| position.pulse),
            hours_in_use: match sensor.family() {
                Family::Velodyne(decoder) => decoder.unit_status().map(|status| status.hours),
                Family::Ouster(_) => None,
            },
            silent_beams: sensor.model().map(|model| self.silent_beams(sensor, model)).unwrap_or_default(),
            warnings: self.health.map(warnings).unwrap_or_default(),
            counters: sensor.stats().clone(),
        }
    }
}

impl Points {
    fn add(&mut self, frame: &Frame) {
        self.first += frame.first.points() as u64;
        self.second += frame.second.as_ref().map_or(0, |layer| layer.points() as u64);
    }
}

fn warnings(health: Health) -> Vec<String> {
    let mut warnings = Vec::new();
    if health.alert_flags & 0x80 != 0 {
        warnings
            .push(format!("alerts are active (flags {:#04x}): ask the sensor for them", health.alert_flags));
    }
    if health.thermal_shutdown != 0 {
        warnings.push(format!("shuts down for heat in {} s", health.thermal_countdown_s));
    }
    match health.shot_limiting {
        0 => {}
        1 => warnings.push(format!("limits its shots for heat in {} s", health.shot_limiting_countdown_s)),
        level => warnings.push(format!("limits its shots for heat, level {}", level - 1)),
    }
    warnings
}

/// Whether a product of packets or metadata, or the model made from it, is what a configuration calls it.
pub(crate) fn is_model(configured: &str, product: &str, model: &str) -> bool {
    let plain = |name: &str| -> String {
        name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase()
    };
    // a Puck LITE sends what a VLP-16 sends
    let velodynes = Product::from_name(configured).zip(Product::from_name(model));
    let configured = plain(configured);
    plain(product).starts_with(&configured)
        || plain(model).starts_with(&configured)
        || velodynes.is_some_and(|(configured, found)| configured.sends_as(found))
}

/// Events per second between the first and the last.
pub(crate) fn rate_hz(count: u64, [first_ns, last_ns]: [u64; 2]) -> Option<f64> {
    let span_s = last_ns.saturating_sub(first_ns) as f64 * 1e-9;
    (count > 1 && span_s > 0.0).then(|| (count - 1) as f64 / span_s)
}
