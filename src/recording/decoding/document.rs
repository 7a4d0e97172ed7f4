//! What `decode` reports: the JSON document and the table.

use std::collections::BTreeMap;

use glam::DVec3;
use sensors::capture::CaptureCounters;
use sensors::ouster::{Correction, TimestampMode};
use sensors::router::{Router, Unclaimed};
use sensors::{DecodeStats, Decoded, Frame, SensorModel};
use serde::Serialize;

use super::error::DecodingError;
use super::output::{Output, WrittenFile};
use super::placing::Placing;
use super::spec::DecodingSpec;
use crate::recording::bags::Topic;
use crate::recording::export::{Cloud, Placer, Source, TimeScale};
use crate::recording::mounted::Mounts;
use crate::recording::registered::Registration;
use crate::recording::source::{Ending, Recording};
use crate::recording::{sensor_ids, unread};

/// The document; sums run over points with range > 0, first return.
#[derive(Default, Serialize)]
pub(crate) struct Document {
    pub(crate) capture: String,
    pub(crate) sensors: Vec<SensorReport>,
    pub(crate) unclaimed: Vec<Unclaimed>,
    pub(crate) fragments_incomplete: u64,
    pub(crate) capture_counters: CaptureCounters,
    pub(crate) data_lost: bool,
    pub(crate) losses: Vec<String>,
    pub(crate) notices: Vec<String>,
    pub(crate) files: Vec<WrittenFile>,
    #[serde(skip)]
    found: BTreeMap<usize, Found>,
    #[serde(skip)]
    placers: BTreeMap<usize, Placer>,
}

#[derive(Serialize)]
pub(crate) struct SensorReport {
    pub(crate) id: String,
    pub(crate) vendor: &'static str,
    pub(crate) model: String,
    pub(crate) format: String,
    pub(crate) source: Option<String>,
    pub(crate) port: Option<u16>,
    pub(crate) serial: String,
    pub(crate) metadata: Option<String>,
    /// Where its beams come from.
    pub(crate) beams: String,
    /// How its packets come to the host, where several sensors have one address.
    pub(crate) link: Option<String>,
    /// The time that its stamps are in.
    pub(crate) clock: Option<String>,
    /// What its metadata say and its packets do not show.
    pub(crate) corrections: Vec<Correction>,
    pub(crate) frames: Vec<FrameRow>,
    pub(crate) totals: Totals,
    pub(crate) counters: DecodeStats,
    pub(crate) imu_samples: u64,
    pub(crate) position_packets: u64,
    pub(crate) zone_reports: u64,
}

#[derive(Serialize)]
pub(crate) struct FrameRow {
    pub(crate) frame_id: u32,
    pub(crate) points: u64,
    pub(crate) points_second: Option<u64>,
    pub(crate) complete: bool,
    pub(crate) valid_columns: usize,
    pub(crate) packets: u32,
    pub(crate) expected_packets: Option<u32>,
    pub(crate) range_sum_mm: u64,
    pub(crate) xyz_sum_m: [f64; 3],
    pub(crate) first_time_ns: Option<u64>,
    pub(crate) last_time_ns: Option<u64>,
    pub(crate) first_host_time_ns: u64,
    pub(crate) last_host_time_ns: u64,
}

#[derive(Default, Serialize)]
pub(crate) struct Totals {
    pub(crate) frames: usize,
    pub(crate) points: u64,
    pub(crate) points_second: u64,
    pub(crate) range_sum_mm: u64,
    pub(crate) xyz_sum_m: [f64; 3],
}

/// What one sensor gave.
#[derive(Default)]
struct Found {
    frames_seen: u64,
    /// Of an Ouster: a Velodyne counts the microseconds of the hour, and the host's clock says which.
    clock: Option<TimeScale>,
    frames: Vec<FrameRow>,
    imu_samples: u64,
    position_packets: u64,
    zone_reports: u64,
}

impl Document {
    /// Counts a frame and returns its number.
    pub(super) fn count_frame(&mut self, sensor: usize) -> u64 {
        let found = self.found.entry(sensor).or_default();
        found.frames_seen += 1;
        found.frames_seen - 1
    }

    /// Measures a frame of a sensor that takes its time from there.
    pub(super) fn add_frame(
        &mut self,
        sensor: usize,
        mode: Option<TimestampMode>,
        model: &SensorModel,
        frame: &Frame,
    ) {
        let placer = self.placers.entry(sensor).or_insert_with(|| Placer::new(model));
        let mut sum = [0.0; 3];
        for position_m in placer.positions_m(model, frame, &frame.first) {
            for axis in 0..3 {
                sum[axis] += position_m[axis];
            }
        }
        let times = frame.time_span_ns();
        let row = FrameRow {
            frame_id: frame.frame_id,
            points: frame.first.points() as u64,
            points_second: frame.second.as_ref().map(|layer| layer.points() as u64),
            complete: frame.complete,
            valid_columns: frame.valid_columns(),
            packets: frame.packets,
            expected_packets: frame.expected_packets,
            range_sum_mm: frame.first.range_mm.iter().map(|range_mm| u64::from(*range_mm)).sum(),
            xyz_sum_m: sum,
            first_time_ns: times.map(|[first, _]| first),
            last_time_ns: times.map(|[_, last]| last),
            first_host_time_ns: frame.host_time_ns[0],
            last_host_time_ns: frame.host_time_ns[1],
        };
        let found = self.found.entry(sensor).or_default();
        if let (Some(mode), Some([first_ns, _])) = (mode, times) {
            found.clock.get_or_insert_with(|| TimeScale::of(Some(mode), first_ns, frame.host_time_ns[0]));
        }
        found.frames.push(row);
    }

    /// Measures a cloud of a bag.
    pub(super) fn add_cloud(&mut self, topic: usize, cloud: &Cloud) {
        let sum = cloud.points.iter().fold(DVec3::ZERO, |sum, point| sum + point.position_m);
        let times_ns = || cloud.points.iter().map(|point| point.time_ns);
        let row = FrameRow {
            frame_id: cloud.frame_id,
            points: cloud.points.len() as u64,
            points_second: None,
            complete: true,
            valid_columns: 0,
            packets: 0,
            expected_packets: None,
            range_sum_mm: cloud.points.iter().map(|point| u64::from(point.range_mm)).sum(),
            xyz_sum_m: sum.to_array(),
            first_time_ns: times_ns().min(),
            last_time_ns: times_ns().max(),
            first_host_time_ns: cloud.host_time_ns,
            last_host_time_ns: cloud.host_time_ns,
        };
        self.found.entry(topic).or_default().frames.push(row);
    }

    /// Takes over what a bag of clouds held.
    pub(super) fn conclude_clouds<'a>(
        &mut self,
        recording: &Recording,
        topics: impl Iterator<Item = (&'a Topic, &'a Source)>,
        losses: Vec<String>,
    ) {
        self.capture = recording.name();
        for (topic, source) in topics {
            let found = self.found.remove(&usize::from(source.number)).unwrap_or_default();
            let mut counters = DecodeStats::default();
            counters.frames = found.frames_seen;
            self.sensors.push(SensorReport {
                id: source.id.clone(),
                vendor: "unknown",
                model: "point cloud".into(),
                format: topic.kind.clone(),
                source: Some(topic.name.clone()),
                port: None,
                serial: String::new(),
                metadata: None,
                beams: "in the clouds".into(),
                link: None,
                clock: None,
                corrections: Vec::new(),
                totals: Totals::of(&found.frames),
                frames: found.frames,
                counters,
                imu_samples: 0,
                position_packets: 0,
                zone_reports: 0,
            });
        }
        self.data_lost = !losses.is_empty();
        self.notices.extend(losses.iter().cloned());
        self.losses = losses;
    }

    /// Counts what is no frame.
    pub(super) fn count_other(&mut self, sensor: usize, decoded: &Decoded<'_>) {
        let found = self.found.entry(sensor).or_default();
        match decoded {
            Decoded::Frame(_) => {}
            Decoded::Imu(_) => found.imu_samples += 1,
            Decoded::Position(_) => found.position_packets += 1,
            Decoded::Zones(_) => found.zone_reports += 1,
        }
    }

    /// Takes over what router and reader counted.
    pub(super) fn conclude(
        &mut self,
        recording: &Recording,
        router: &Router,
        ending: &Ending,
        wants: &dyn Fn(&str, &str) -> bool,
    ) {
        self.capture = recording.name();
        self.fragments_incomplete = ending.counters.fragments_incomplete;
        self.capture_counters = ending.counters.clone();
        self.losses = ending.losses();
        self.notices.clone_from(&ending.notices);
        self.unclaimed = router.unclaimed().cloned().collect();
        let ids = sensor_ids::ids(router);
        for (at, sensor) in router.sensors().iter().enumerate() {
            if !wants(&ids[at], sensor.serial()) {
                continue;
            }
            let found = self.found.remove(&at).unwrap_or_default();
            let counters = sensor.stats().clone();
            if sensor.one_of_several().is_some() {
                self.losses.push(format!(
                    "{}: its packets were not decoded, as another unit's look the same",
                    ids[at]
                ));
            } else if counters.packets == 0 && sensor.position_packets == 0 {
                let name = sensor.metadata_name.as_deref().unwrap_or("a sensor");
                self.notices.push(format!("no packet of {} ({name}) is in the recording", ids[at]));
            }
            self.losses.extend(unread::sensor_losses(&ids[at], sensor));
            self.notices.extend(unread::sensor_notes(&ids[at], sensor));
            self.notices.extend(sensor.only_positions().map(|words| format!("{}: {words}", ids[at])));
            self.sensors.push(SensorReport {
                id: ids[at].clone(),
                vendor: sensor.vendor(),
                model: sensor.product(),
                format: sensor.format(),
                source: sensor.source().map(|source| ending.source(source)),
                port: sensor.data_port(),
                serial: sensor.serial().to_owned(),
                metadata: sensor.metadata_name.clone(),
                beams: sensor.beams().to_string(),
                link: sensor.link().map(|link| link.to_string()),
                clock: found.clock.map(|clock| clock.to_string()),
                corrections: sensor.corrections().to_vec(),
                totals: Totals::of(&found.frames),
                frames: found.frames,
                counters,
                imu_samples: found.imu_samples,
                position_packets: found.position_packets,
                zone_reports: found.zone_reports,
            });
        }
        self.notices.extend(unread::unknown_sources(router));
        self.notices.extend(unread::beam_notices(router));
        self.notices.extend(self.losses.iter().cloned());
        self.data_lost = !self.losses.is_empty();
    }

    /// Adds what there is to say of the frame of the points.
    pub(super) fn add_registration(&mut self, placing: &Placing<'_>, notices: Vec<String>) {
        let names = |at: usize| self.sensors.get(at).map_or(String::new(), |sensor| sensor.id.clone());
        let of_clocks = placing.registration.notices(&names);
        let losses: Vec<String> = placing
            .registration
            .losses()
            .into_iter()
            .chain(placing.mounts.iter().flat_map(Mounts::losses))
            .collect();
        self.notices.extend(notices.into_iter().chain(of_clocks).chain(losses.iter().cloned()));
        self.data_lost |= !losses.is_empty();
        self.losses.extend(losses);
    }

    /// Closes the files; refuses a range of frames in which no sensor has one, and files without points.
    pub(super) fn close(
        mut self,
        spec: &DecodingSpec,
        output: Option<Output>,
        registration: &Registration,
    ) -> Result<Self, DecodingError> {
        let has_frames = self.sensors.iter().any(|sensor| !sensor.frames.is_empty());
        if let Some(asked) = spec.wanted_frames().filter(|_| !has_frames) {
            let has = |sensor: &SensorReport| format!("{} of {}", sensor.counters.frames, sensor.id);
            let found = self.sensors.iter().map(has).collect::<Vec<_>>().join(", ");
            return Err(DecodingError::FewerFrames { asked: asked.to_string(), found });
        }
        let Some(output) = output else { return Ok(self) };
        if output.holds_nothing(spec.is_selective()) {
            return Err(match registration.losses() {
                Some(loss) => DecodingError::NothingPlaced { loss },
                None if spec.is_selective() => DecodingError::NothingLeft,
                None => DecodingError::NoPoint {
                    frames: self.sensors.iter().map(|sensor| sensor.totals.frames).sum(),
                },
            });
        }
        self.files = output.finish()?;
        Ok(self)
    }

    /// No sensor gave anything, or nothing but what fits any sensor (an IMU packet without a serial number) while
    /// lidar packets were left over or could not be read.
    pub(super) fn is_empty(&self) -> bool {
        let left_over = self.unclaimed.iter().any(|entry| entry.needs_metadata);
        let nothing = |sensor: &SensorReport| {
            let unread = left_over || sensor.counters.malformed > 0;
            (sensor.counters.packets == 0 && sensor.frames.is_empty())
                || (unread && sensor.counters.frames == 0)
        };
        self.sensors.iter().all(nothing)
    }

    /// Data is missing.
    pub(crate) fn is_data_lost(&self) -> bool {
        self.data_lost
    }

    /// What the user should know besides the result.
    pub(crate) fn notices(&self) -> &[String] {
        &self.notices
    }
}

impl Totals {
    fn of(frames: &[FrameRow]) -> Self {
        let mut totals = Self { frames: frames.len(), ..Self::default() };
        for frame in frames {
            totals.points += frame.points;
            totals.points_second += frame.points_second.unwrap_or(0);
            totals.range_sum_mm += frame.range_sum_mm;
            for axis in 0..3 {
                totals.xyz_sum_m[axis] += frame.xyz_sum_m[axis];
            }
        }
        totals
    }
}
