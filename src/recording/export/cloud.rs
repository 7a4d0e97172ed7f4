//! The points of one frame, as files want them.

use std::sync::Arc;

use glam::DVec3;
use sensors::ouster::TimestampMode;
use sensors::projection::{Projector, sample_time_ns};
use sensors::router::Sensor;
use sensors::{Frame, Layer, SensorModel};

use super::scale::{FIRST_DATE_NS, TimeScale};
use crate::base::geometry::Pose;

/// Which sensor points come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Name in files and topics.
    pub id: String,
    /// Number among the sensors of a recording, from 0.
    pub number: u16,
    /// `Ouster` or `Velodyne`.
    pub vendor: String,
    /// Product.
    pub model: String,
    /// Serial number; empty when not known.
    pub serial: String,
    /// Where it takes its time from, where that is known.
    pub timestamp_mode: Option<TimestampMode>,
}

impl Source {
    /// A sensor of a recording.
    pub(crate) fn of(sensor: &Sensor, id: String, number: usize) -> Self {
        Self {
            id,
            number: number as u16, // the router keeps to a few sensors
            vendor: sensor.vendor().into(),
            model: sensor.product(),
            serial: sensor.serial().into(),
            timestamp_mode: sensor.timestamp_mode(),
        }
    }
}

/// One return of one firing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// In the frame of its cloud, m.
    pub position_m: DVec3,
    /// As measured, mm.
    pub range_mm: u32,
    /// Device time of the firing, ns.
    pub time_ns: u64,
    /// Beam: channel from top to bottom for Ouster; by rising elevation for Velodyne, as its ROS driver numbers them.
    pub ring: u16,
    /// Column of the frame.
    pub column: u32,
    /// 1 or 2.
    pub return_number: u8,
    /// Signal photons where the sensor sends them; otherwise the reflectivity, of an HDL-64E as its calibration says.
    pub intensity: f32,
    /// Calibrated reflectivity.
    pub reflectivity: u8,
    /// Ambient light, where it is sent: once for all returns of a firing.
    pub near_ir: Option<u16>,
}

/// Which of a firing's returns a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Echo {
    /// From 1.
    pub number: u8,
    /// How many there are.
    pub of: u8,
}

/// Moves points into another frame, each by the pose at its own time (ns, the sensor's clock); how many had none and are
/// left out.
pub(crate) fn place(points: &mut Vec<Point>, to_from_points: impl Fn(u64) -> Option<Pose>) -> u64 {
    let count = points.len();
    let mut last: Option<(u64, Option<Pose>)> = None; // the points of a column have one time
    points.retain_mut(|point| {
        let pose = match last {
            Some((at_ns, pose)) if at_ns == point.time_ns => pose,
            _ => to_from_points(point.time_ns),
        };
        last = Some((point.time_ns, pose));
        let Some(pose) = pose else { return false };
        point.position_m = pose.transform_point(point.position_m);
        true
    });
    (count - points.len()) as u64
}

/// The points of one frame; samples without a return are left out.
pub struct Cloud {
    /// The sensor of the points.
    pub source: Arc<Source>,
    /// The sensor's frame counter.
    pub frame_id: u32,
    /// Device time of the first column that came, ns.
    pub start_time_ns: u64,
    /// Host arrival of the first packet, ns.
    pub host_time_ns: u64,
    /// In order of columns, then channels, then returns.
    pub points: Vec<Point>,
    /// The frame that the points are in, where that is not their sensor's own.
    pub(crate) points_in: Option<&'static str>,
    scale: Option<TimeScale>,
    rings: Vec<u16>,
    placer: Option<Placer>,
}

impl Cloud {
    /// An empty cloud of a sensor with the given beams.
    pub fn new(source: Arc<Source>, model: &SensorModel) -> Self {
        let rings = rings(&source, model);
        Self {
            source,
            frame_id: 0,
            start_time_ns: 0,
            host_time_ns: 0,
            points: Vec::new(),
            points_in: None,
            scale: None,
            rings,
            placer: Some(Placer::new(model)),
        }
    }

    /// Points that were placed already, by when the first was measured and when they came, ns.
    pub(crate) fn of_points(
        source: Arc<Source>,
        frame_id: u32,
        times_ns: [u64; 2],
        points: Vec<Point>,
    ) -> Self {
        let [start_time_ns, host_time_ns] = times_ns;
        Self {
            source,
            frame_id,
            start_time_ns,
            host_time_ns,
            points,
            points_in: None,
            scale: None,
            rings: Vec::new(),
            placer: None,
        }
    }

    /// Replaces the points by those of a frame.
    pub fn fill(&mut self, model: &SensorModel, frame: &Frame) {
        self.points.clear();
        self.points_in = None;
        // an HDL-64E may send its beam angles during the recording
        self.rings = rings(&self.source, model);
        self.frame_id = frame.frame_id;
        self.start_time_ns = frame.time_span_ns().map_or(0, |[first, _]| first);
        self.host_time_ns = frame.host_time_ns[0];
        let scale = TimeScale::of(self.source.timestamp_mode, self.start_time_ns, self.host_time_ns);
        self.scale.get_or_insert(scale);
        self.fill_layer(model, frame, &frame.first, 1);
        if let Some(second) = &frame.second {
            self.fill_layer(model, frame, second, 2);
            self.points.sort_by_key(|point| (point.column, point.ring, point.return_number));
        }
    }

    /// The frame of the points, for a message header.
    pub(crate) fn frame_name(&self) -> &str {
        self.points_in.unwrap_or(&self.source.id)
    }

    /// Time for a message header, ns since 1970.
    pub(crate) fn stamp_ns(&self) -> u64 {
        stamp_ns(self.start_time_ns, self.host_time_ns)
    }

    /// The time that the stamp is in: as the sensor's first frame showed.
    pub fn scale(&self) -> TimeScale {
        self.scale.unwrap_or_default()
    }

    /// Every point with its place among the returns of its firing, as LAS and E57 count them: a second return
    /// without a first is the first of one.
    pub(crate) fn echoes(&self) -> impl Iterator<Item = (&Point, Echo)> {
        let same = |a: Option<&Point>, b: &Point| a.is_some_and(|a| (a.column, a.ring) == (b.column, b.ring));
        self.points.iter().enumerate().map(move |(at, point)| {
            let after = at.checked_sub(1).is_some_and(|before| same(self.points.get(before), point));
            let before = same(self.points.get(at + 1), point);
            (point, Echo { number: 1 + u8::from(after), of: 1 + u8::from(before || after) })
        })
    }

    /// Time of a point since the frame's first column, ns.
    pub(crate) fn since_start_ns(&self, point: &Point) -> u32 {
        u32::try_from(point.time_ns.saturating_sub(self.start_time_ns)).unwrap_or(u32::MAX)
    }

    fn fill_layer(&mut self, model: &SensorModel, frame: &Frame, layer: &Layer, return_number: u8) {
        let placer = self.placer.get_or_insert_with(|| Placer::new(model));
        let positions_m = placer.positions_m(model, frame, layer);
        for column in 0..frame.columns() {
            for channel in 0..frame.channels {
                let at = frame.index(column, channel);
                let range_mm = layer.range_mm[at];
                if range_mm == 0 {
                    continue;
                }
                let reflectivity = layer.reflectivity.get(at).copied().unwrap_or(0);
                let signal = layer.signal.get(at).copied();
                let compensated =
                    || model.intensity(channel, f64::from(range_mm) * 1e-3, reflectivity) as f32;
                self.points.push(Point {
                    position_m: DVec3::from_array(positions_m[at]),
                    range_mm,
                    time_ns: sample_time_ns(model, frame, column, channel),
                    ring: self.rings.get(channel).copied().unwrap_or(0),
                    column: column as u32,
                    return_number,
                    intensity: signal.map_or_else(compensated, f32::from),
                    reflectivity,
                    near_ir: frame.first.near_ir.get(at).copied(),
                });
            }
        }
    }
}

/// Places the samples of one sensor's frames, also of one that learns its calibration during the recording.
pub struct Placer {
    projector: Projector,
    positions_m: Vec<[f64; 3]>,
}

impl Placer {
    /// For a sensor with these beams.
    pub(crate) fn new(model: &SensorModel) -> Self {
        Self { projector: Projector::new(model), positions_m: Vec::new() }
    }

    /// Positions in the sensor frame, m, in the order of the layer; zero where nothing came back.
    pub(crate) fn positions_m(&mut self, model: &SensorModel, frame: &Frame, layer: &Layer) -> &[[f64; 3]] {
        self.projector.follow(model);
        self.projector.points_f64(frame, layer, &mut self.positions_m);
        &self.positions_m
    }
}

/// Time for a message header, ns since 1970: the device's if it keeps a date, the host's otherwise.
pub(super) fn stamp_ns(device_time_ns: u64, host_time_ns: u64) -> u64 {
    if device_time_ns >= FIRST_DATE_NS { device_time_ns } else { host_time_ns }
}

fn rings(source: &Source, model: &SensorModel) -> Vec<u16> {
    match source.vendor.as_str() {
        "Velodyne" => model.rings_by_elevation(),
        _ => (0..model.channels() as u16).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_of_a_velodyne_rise_with_elevation() {
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let source = |vendor: &str| Source {
            id: "a".into(),
            number: 0,
            vendor: vendor.into(),
            model: "vlp-16".into(),
            serial: String::new(),
            timestamp_mode: None,
        };
        // lasers 0 and 1 of a VLP-16 point to -15 and +1 degrees
        assert_eq!(rings(&source("Velodyne"), &model)[..2], [0, 8]);
        assert_eq!(rings(&source("Ouster"), &model)[..2], [0, 1]);
    }
}
