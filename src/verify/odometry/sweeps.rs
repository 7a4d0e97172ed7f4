//! Frames of all sensors of a rig, cut into sweeps of one revolution by the times of their returns.

use std::collections::BTreeMap;

use glam::DVec3;
use sensors::projection::{returns, sample_azimuth_rad, sample_time_ns};
use sensors::{Frame, SensorModel};

use crate::base::geometry::Pose;

/// A revolution where the sensor does not say how fast it turns, ns.
const USUAL_TURN_NS: u64 = 100_000_000;
/// Returns that wait for the other sensors, at most (128 MiB); captures may hold one sensor after the other.
const MOST_WAITING: usize = 1 << 22;

/// One return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// When, on the recording's clock, ns.
    pub time_ns: u64,
    /// Where, in the body as it then stood, m.
    pub body_m: DVec3,
}

/// The returns of one revolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Begin, ns.
    pub start_ns: u64,
    /// End, ns; belongs to the next.
    pub end_ns: u64,
    /// In the order of their frames.
    pub points: Vec<SweepPoint>,
}

impl Sweep {
    /// Between both ends, ns.
    pub(crate) fn middle_ns(&self) -> u64 {
        self.start_ns + (self.end_ns - self.start_ns) / 2
    }

    /// Distance of the farthest return from the body, m.
    pub(crate) fn farthest_m(&self) -> f64 {
        self.points.iter().map(|point| point.body_m.length_squared()).fold(0.0, f64::max).sqrt()
    }
}

/// Which returns are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least range, m; that of the sensor where that is greater.
    pub nearest_m: f64,
    /// Maximum range, m.
    pub farthest_m: f64,
}

/// Frames go in, sweeps come out.
#[derive(Clone, Debug)]
pub struct Sweeps {
    limits: Limits,
    most_waiting: usize,
    turn_ns: u64,
    /// Begin of sweep 0: of the first frame that came.
    start_ns: Option<u64>,
    /// By sensor, the last time that was seen.
    latest_ns: Vec<Option<u64>>,
    /// By number of the sweep.
    waiting: BTreeMap<i64, Vec<SweepPoint>>,
    count: usize,
    /// Number of the last sweep that was given out.
    given: Option<i64>,
    late: u64,
}

impl Sweeps {
    /// Of a rig of so many sensors.
    pub(crate) fn new(sensors: usize, limits: Limits) -> Self {
        Self {
            limits,
            most_waiting: MOST_WAITING,
            turn_ns: 0,
            start_ns: None,
            latest_ns: vec![None; sensors],
            waiting: BTreeMap::new(),
            count: 0,
            given: None,
            late: 0,
        }
    }

    /// Adds a frame of a sensor; `body_from_sensor_at`: at a time of its clock, ns.
    pub(crate) fn add_frame(
        &mut self,
        sensor: usize,
        model: &SensorModel,
        body_from_sensor_at: &dyn Fn(u64) -> Pose,
        frame: &Frame,
    ) {
        let Some([first_ns, last_ns]) = frame.time_span_ns() else { return };
        if self.start_ns.is_none() {
            let rate = frame.azimuth_rate_rad_per_ns;
            self.turn_ns =
                if rate > 0.0 { (std::f64::consts::TAU / rate).round() as u64 } else { USUAL_TURN_NS };
            self.start_ns = Some(first_ns);
        }
        let known_ns = self.latest_ns[sensor].unwrap_or(0);
        self.latest_ns[sensor] = Some(known_ns.max(last_ns));
        let nearest_m = self.limits.nearest_m.max(model.min_range_m);
        let (mut of_column, mut body_from_sensor) = (usize::MAX, Pose::IDENTITY);
        for (column, channel, range_mm) in returns(model, frame) {
            if column != of_column {
                (of_column, body_from_sensor) = (column, body_from_sensor_at(frame.column_time_ns[column]));
            }
            let range_m = f64::from(range_mm) * 1e-3;
            if range_m < nearest_m || range_m > self.limits.farthest_m {
                continue;
            }
            let time_ns = sample_time_ns(model, frame, column, channel);
            let number = self.number(time_ns);
            if self.given.is_some_and(|given| number <= given) {
                self.late += 1;
                continue;
            }
            let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
            let body_m = body_from_sensor.transform_point(model.point(channel, azimuth_rad, range_m));
            self.waiting.entry(number).or_default().push(SweepPoint { time_ns, body_m });
            self.count += 1;
        }
    }

    /// The next sweep to which no sensor has anything more to add. A sensor that is silent is waited for until too much
    /// waits with it.
    pub(crate) fn next_whole(&mut self) -> Option<Sweep> {
        let (number, _) = self.waiting.first_key_value()?;
        let is_over = |latest_ns: &Option<u64>| latest_ns.is_some_and(|at| self.number(at) > *number);
        let is_whole = self.latest_ns.iter().all(is_over) || self.count > self.most_waiting;
        let sweep = if is_whole { self.give() } else { return None };
        // what one sensor saw before the others began
        if self.is_scrap(&sweep) { self.next_whole() } else { Some(sweep) }
    }

    /// What is left at the end of the recording, call after call. The last sweep ends with its last return; less than half
    /// a revolution at either end is left out.
    pub(crate) fn next_rest(&mut self) -> Option<Sweep> {
        let is_first = self.given.is_none();
        self.waiting.first_key_value()?;
        let mut sweep = self.give();
        if self.waiting.is_empty() {
            sweep.end_ns = sweep.points.iter().map(|point| point.time_ns + 1).max()?;
        }
        let is_short = sweep.end_ns - sweep.start_ns < self.turn_ns / 2;
        if is_short || is_first && self.is_scrap(&sweep) { self.next_rest() } else { Some(sweep) }
    }

    /// Returns that were older than a sweep that was already given out.
    pub(crate) fn late(&self) -> u64 {
        self.late
    }

    /// Of the sweep of a time.
    fn number(&self, time_ns: u64) -> i64 {
        let start_ns = self.start_ns.unwrap_or(0);
        (i128::from(time_ns) - i128::from(start_ns)).div_euclid(i128::from(self.turn_ns.max(1))) as i64
    }

    fn give(&mut self) -> Sweep {
        let (number, points) = self.waiting.pop_first().unwrap_or_default();
        self.count -= points.len();
        self.given = Some(number);
        let begin = i128::from(self.start_ns.unwrap_or(0)) + i128::from(number) * i128::from(self.turn_ns);
        let start_ns = begin.max(0) as u64;
        Sweep { start_ns, end_ns: start_ns + self.turn_ns, points }
    }

    /// Whether a sweep before the first frame that came holds less than half a revolution.
    fn is_scrap(&self, sweep: &Sweep) -> bool {
        let first_ns = sweep.points.iter().map(|point| point.time_ns).min().unwrap_or(sweep.end_ns);
        self.given.is_some_and(|given| given < 0) && sweep.end_ns - first_ns < self.turn_ns / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(model: &SensorModel, start_ns: u64) -> Frame {
        let columns = 8;
        Frame {
            channels: model.channels(),
            column_time_ns: (0..columns).map(|n| start_ns + n * 12_500_000).collect(),
            column_azimuth_rad: (0..columns).map(|n| n as f64 * std::f64::consts::TAU / 8.0).collect(),
            column_valid: vec![true; columns as usize],
            azimuth_rate_rad_per_ns: std::f64::consts::TAU / 1e8,
            first: sensors::Layer {
                range_mm: vec![2000; columns as usize * model.channels()],
                ..Default::default()
            },
            ..Frame::default()
        }
    }

    #[test]
    fn two_sensors_out_of_step_are_cut_at_the_same_times() {
        let model = sensors::catalogue::nominal("os1-16").unwrap();
        let limits = Limits { nearest_m: 0.1, farthest_m: 100.0 };
        let mut sweeps = Sweeps::new(3, limits);
        let mut cut = Vec::new();
        for turn in 0..5_u64 {
            for (sensor, shift_ns) in [(0, 0), (2, 40_000_000)] {
                sweeps.add_frame(
                    sensor,
                    &model,
                    &|_| Pose::IDENTITY,
                    &frame(&model, 1_000_000_000 + turn * 100_000_000 + shift_ns),
                );
                cut.extend(std::iter::from_fn(|| sweeps.next_whole()));
            }
        }
        cut.extend(std::iter::from_fn(|| sweeps.next_rest()));
        assert_eq!(sweeps.late(), 0);
        // the second sensor begins in the middle of the first sweep
        let counts: Vec<usize> = cut.iter().map(|sweep| sweep.points.len() / 16).collect();
        assert_eq!(counts, [13, 16, 16, 16, 16], "the rest of a third of a revolution is left out");
        for (number, sweep) in cut.iter().enumerate() {
            assert_eq!(sweep.start_ns, 1_000_000_000 + number as u64 * 100_000_000);
            assert!(sweep.points.iter().all(|p| (sweep.start_ns..sweep.end_ns).contains(&p.time_ns)));
        }
    }

    #[test]
    fn one_sensor_after_the_other_is_put_together_as_long_as_there_is_room() {
        let model = sensors::catalogue::nominal("os1-16").unwrap();
        let start_ns = 1_000_000_000;
        let run = |most_waiting: usize| {
            let mut sweeps = Sweeps::new(2, Limits { nearest_m: 0.1, farthest_m: 100.0 });
            sweeps.most_waiting = most_waiting;
            let mut counts = Vec::new();
            for (sensor, early_ns) in [(0, 0), (1, 40_000_000)] {
                for turn in 0..6 {
                    let at_ns = start_ns - early_ns + turn * 100_000_000;
                    sweeps.add_frame(sensor, &model, &|_| Pose::IDENTITY, &frame(&model, at_ns));
                    counts.extend(
                        std::iter::from_fn(|| sweeps.next_whole()).map(|sweep| sweep.points.len() / 16),
                    );
                }
            }
            counts.extend(std::iter::from_fn(|| sweeps.next_rest()).map(|sweep| sweep.points.len() / 16));
            (counts, sweeps.late())
        };
        // the 4 columns that the second saw before the first began are left out
        assert_eq!(run(MOST_WAITING), (vec![16, 16, 16, 16, 16, 12], 0));
        let (counts, late) = run(200);
        assert!(counts.len() == 6 && late > 300, "{counts:?} {late}");
    }

    #[test]
    fn a_hole_is_stepped_over() {
        let model = sensors::catalogue::nominal("os1-16").unwrap();
        let mut sweeps = Sweeps::new(1, Limits { nearest_m: 0.1, farthest_m: 100.0 });
        for at_ns in [0, 100_000_000, 3_000_000_000_000_000] {
            sweeps.add_frame(0, &model, &|_| Pose::IDENTITY, &frame(&model, at_ns));
        }
        let starts: Vec<u64> =
            std::iter::from_fn(|| sweeps.next_rest()).map(|sweep| sweep.start_ns).collect();
        assert_eq!(starts, [0, 100_000_000, 3_000_000_000_000_000]);
    }
}
