//! Frames of all sensors of a rig, cut into sweeps of one revolution by the times of their returns.

use glam::DVec3;
use sensors::projection::sample_azimuth_rad;
use sensors::{Frame, SensorModel};

use crate::geometry::Pose;

/// A revolution where the sensor does not say how fast it turns, ns.
const USUAL_TURN_NS: u64 = 100_000_000;
/// A sensor that is so many revolutions behind the others is not waited for.
const PATIENCE: u64 = 4;

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
    pub fn middle_ns(&self) -> u64 {
        self.start_ns + (self.end_ns - self.start_ns) / 2
    }

    /// Distance of the farthest return from the body, m.
    pub fn farthest_m(&self) -> f64 {
        self.points.iter().map(|point| point.body_m.length_squared()).fold(0.0, f64::max).sqrt()
    }
}

/// Which returns are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least range, m; that of the sensor where that is greater.
    pub nearest_m: f64,
    /// Greatest range, m.
    pub farthest_m: f64,
}

/// Frames go in, sweeps come out.
#[derive(Clone, Debug)]
pub struct Sweeps {
    limits: Limits,
    turn_ns: u64,
    start_ns: Option<u64>,
    /// By sensor, the last time that was seen.
    latest_ns: Vec<Option<u64>>,
    waiting: Vec<SweepPoint>,
    late: u64,
}

impl Sweeps {
    /// Of a rig of so many sensors.
    pub fn new(sensors: usize, limits: Limits) -> Self {
        Self {
            limits,
            turn_ns: 0,
            start_ns: None,
            latest_ns: vec![None; sensors],
            waiting: Vec::new(),
            late: 0,
        }
    }

    /// Adds a frame of a sensor that then sat there.
    pub fn add_frame(&mut self, sensor: usize, model: &SensorModel, body_from_sensor: &Pose, frame: &Frame) {
        let Some([first_ns, last_ns]) = frame.time_span_ns() else { return };
        if self.start_ns.is_none() {
            let rate = frame.azimuth_rate_rad_per_ns;
            self.turn_ns =
                if rate > 0.0 { (std::f64::consts::TAU / rate).round() as u64 } else { USUAL_TURN_NS };
            self.start_ns = Some(first_ns);
        }
        let known_ns = self.latest_ns[sensor].unwrap_or(0);
        self.latest_ns[sensor] = Some(known_ns.max(last_ns));
        let start_ns = self.start_ns.unwrap_or(0);
        let nearest_m = self.limits.nearest_m.max(model.min_range_m);
        for column in (0..frame.columns()).filter(|column| frame.column_valid[*column]) {
            for channel in 0..frame.channels.min(model.channels()) {
                let range_m = f64::from(frame.first.range_mm[frame.index(column, channel)]) * 1e-3;
                if range_m < nearest_m || range_m > self.limits.farthest_m {
                    continue;
                }
                let offset_ns = model.beams()[channel].fire_offset_ns.round() as i64;
                let time_ns = frame.column_time_ns[column].saturating_add_signed(offset_ns);
                if time_ns < start_ns {
                    self.late += 1;
                    continue;
                }
                let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
                let point_m = model.point(channel, azimuth_rad, range_m);
                self.waiting.push(SweepPoint { time_ns, body_m: body_from_sensor.transform_point(point_m) });
            }
        }
    }

    /// The next sweep that is whole.
    pub fn next_whole(&mut self) -> Option<Sweep> {
        let end_ns = self.start_ns? + self.turn_ns;
        let seen = self.latest_ns.iter().flatten();
        let newest_ns = *seen.clone().max()?;
        let waits = |latest_ns: &u64| *latest_ns < end_ns && newest_ns < end_ns + PATIENCE * self.turn_ns;
        if newest_ns < end_ns || seen.clone().any(waits) {
            return None;
        }
        Some(self.cut(end_ns))
    }

    /// What is left at the end of the recording, call after call: the last sweep ends with its last return, and a rest
    /// of less than half a revolution is left out.
    pub fn next_rest(&mut self) -> Option<Sweep> {
        let start_ns = self.start_ns?;
        let last_ns = self.waiting.iter().map(|point| point.time_ns).max()?;
        if last_ns >= start_ns + self.turn_ns {
            return Some(self.cut(start_ns + self.turn_ns));
        }
        (last_ns >= start_ns + self.turn_ns / 2).then(|| self.cut(last_ns + 1))
    }

    /// Returns that were older than a sweep that was already given out.
    pub fn late(&self) -> u64 {
        self.late
    }

    fn cut(&mut self, mut end_ns: u64) -> Sweep {
        let mut start_ns = self.start_ns.unwrap_or(0);
        // a hole in the recording is stepped over in whole revolutions
        if let Some(next_ns) = self.waiting.iter().map(|point| point.time_ns).min()
            && next_ns >= end_ns
        {
            let over_ns = (next_ns - start_ns) / self.turn_ns * self.turn_ns;
            (start_ns, end_ns) = (start_ns + over_ns, end_ns + over_ns);
        }
        let (points, waiting) = self.waiting.drain(..).partition(|point| point.time_ns < end_ns);
        self.waiting = waiting;
        self.start_ns = Some(end_ns);
        Sweep { start_ns, end_ns, points }
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
                    &Pose::IDENTITY,
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
    fn a_sensor_that_fell_silent_is_not_waited_for() {
        let model = sensors::catalogue::nominal("os1-16").unwrap();
        let mut sweeps = Sweeps::new(2, Limits { nearest_m: 0.1, farthest_m: 100.0 });
        sweeps.add_frame(1, &model, &Pose::IDENTITY, &frame(&model, 0));
        let mut cut = 0;
        for turn in 0..12 {
            sweeps.add_frame(0, &model, &Pose::IDENTITY, &frame(&model, turn * 100_000_000));
            cut += std::iter::from_fn(|| sweeps.next_whole()).count();
        }
        assert!(cut >= 6, "{cut}");
    }
}
