//! The revolutions along a trajectory and the body's pose at each column.

use glam::{DMat3, DVec3};

use super::{Fan, ViewError};
use crate::world::trajectory::Trajectory;

/// How much of a revolution the end of a trajectory may lack, s: times in files are rounded.
const END_SLACK_S: f64 = 1e-9;

/// The revolutions of a sensor that are cast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scans {
    /// How many.
    pub count: u64,
    /// From the start of one to the start of the next, ns.
    step_ns: f64,
    /// From a column to the next, ns.
    column_ns: f64,
    columns: usize,
}

impl Scans {
    /// Whole revolutions that fit the trajectory, every `scan_stride`-th of them.
    ///
    /// # Errors
    /// Not one.
    pub fn of(fan: &Fan, trajectory: &Trajectory) -> Result<Self, ViewError> {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        let duration_s = (end_ns - start_ns) as f64 * 1e-9;
        let revolution_s = 1.0 / fan.rate_hz;
        let left_s = duration_s - revolution_s + END_SLACK_S;
        if left_s < 0.0 {
            return Err(ViewError::NoRevolution { duration_s, revolution_s });
        }
        let step_s = revolution_s * fan.scan_stride as f64;
        Ok(Self {
            count: (left_s / step_s).floor() as u64 + 1,
            step_ns: step_s * 1e9,
            column_ns: revolution_s * 1e9 / fan.columns as f64,
            columns: fan.columns,
        })
    }

    /// One in so many of these, from the first.
    pub(super) fn every(&self, times: u64) -> Self {
        Self { count: self.count.div_ceil(times), step_ns: self.step_ns * times as f64, ..*self }
    }

    /// World from body at every column of a scan: axes, and origin, m.
    pub(super) fn poses(&self, trajectory: &Trajectory, scan: u64) -> Vec<(DMat3, DVec3)> {
        (0..self.columns).map(|column| self.pose(trajectory, scan, column as f64)).collect()
    }

    /// World from body in the middle of a scan.
    pub(super) fn middle(&self, trajectory: &Trajectory, scan: u64) -> (DMat3, DVec3) {
        self.pose(trajectory, scan, 0.5 * self.columns as f64)
    }

    fn pose(&self, trajectory: &Trajectory, scan: u64, column: f64) -> (DMat3, DVec3) {
        let after_ns = scan as f64 * self.step_ns + column * self.column_ns;
        let pose = trajectory.at_offset_ns(after_ns);
        (DMat3::from_quat(pose.rotation), pose.translation_m)
    }
}
