//! Poses over time.

mod checks;
mod columns;
mod disturbed;
mod doubts;
mod files;
mod gait;
mod read;
mod shapes;
mod stamp;
mod upright;

pub use checks::{Suspicion, SuspicionKind, WalkLimits};
pub use disturbed::PoseError;
pub(crate) use doubts::suspicions;
pub use gait::Gait;
pub use read::ReadTrajectory;

use glam::DVec3;

use crate::base::geometry::Pose;

/// Where the body was: poses at strictly increasing times, interpolated in between (slerp and straight line).
///
/// ```
/// use outrigger::world::trajectory::Trajectory;
///
/// let read = Trajectory::read(b"10 0 0 1 0 0 0 1\n12 3 0 1 0 0 0 1\n", None)?; // time, position, quaternion
/// let midpoint = read.trajectory.at(11_000_000_000).unwrap();
/// assert_eq!(midpoint.translation_m.to_array(), [1.5, 0.0, 1.0]);
/// assert!(read.trajectory.at(13_000_000_000).is_none(), "where it went then is unknown");
/// let error = Trajectory::read(b"10 0 0 1 0 0 0 1\n12 3 0 1 0 0 0\n", None).unwrap_err();
/// assert!(error.to_string().contains("line 2"), "{error}");
/// # Ok::<(), outrigger::world::trajectory::TrajectoryError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    time_ns: Vec<u64>,
    world_from_body: Vec<Pose>,
}

impl Trajectory {
    /// From stamped poses. Times must increase strictly; anything else is an error that names the position.
    pub fn new(stamped: Vec<(u64, Pose)>) -> Result<Self, TrajectoryError> {
        if stamped.is_empty() {
            return Err(TrajectoryError::Empty);
        }
        for (index, pair) in stamped.windows(2).enumerate() {
            if pair[1].0 <= pair[0].0 {
                return Err(TrajectoryError::NotIncreasing { index: index + 1 });
            }
        }
        let (time_ns, world_from_body) = stamped.into_iter().unzip();
        Ok(Self { time_ns, world_from_body })
    }

    /// Of a body that never moves.
    pub(crate) fn still() -> Self {
        Self { time_ns: vec![0, u64::MAX], world_from_body: vec![Pose::IDENTITY; 2] }
    }

    /// From the poses in the middle of revolutions: before the first of them and after the last the body moves as it does next
    /// to them.
    pub(crate) fn of_revolutions(mut stamped: Vec<(u64, Pose)>) -> Result<Self, TrajectoryError> {
        if let [(first_ns, first), (second_ns, second), ..] = stamped[..]
            && let [.., (before_ns, before), (last_ns, last)] = stamped[..]
        {
            stamped.push((2 * last_ns - before_ns, last * (before.inverse() * last)));
            let begun_ns = (2 * first_ns).checked_sub(second_ns).filter(|begun_ns| *begun_ns < first_ns);
            if let Some(begun_ns) = begun_ns {
                stamped.insert(0, (begun_ns, first * (second.inverse() * first)));
            }
        }
        Self::new(stamped)
    }

    /// A straight walk at constant speed (m/s > 0) that keeps the orientation of its direction: body x along it.
    pub fn straight(from_m: DVec3, to_m: DVec3, speed_m_s: f64, start_ns: u64) -> Self {
        let step_m = to_m - from_m;
        let yaw = step_m.y.atan2(step_m.x);
        let rotation = glam::DQuat::from_rotation_z(yaw);
        let duration_ns = (step_m.length() / speed_m_s * 1e9).round() as u64;
        let end = Pose::new(rotation, to_m);
        let start = Pose::new(rotation, from_m);
        Self { time_ns: vec![start_ns, start_ns + duration_ns.max(1)], world_from_body: vec![start, end] }
    }

    /// First and last time, ns.
    pub fn time_span_ns(&self) -> [u64; 2] {
        [self.time_ns[0], self.time_ns[self.time_ns.len() - 1]]
    }

    /// Pose at a time inside the span; none outside it.
    pub fn at(&self, time_ns: u64) -> Option<Pose> {
        let after = self.time_ns.partition_point(|t| *t <= time_ns);
        if after == 0 {
            return None;
        }
        let before = after - 1;
        if self.time_ns[before] == time_ns {
            return Some(self.world_from_body[before]);
        }
        if after == self.time_ns.len() {
            return None;
        }
        let span = (self.time_ns[after] - self.time_ns[before]) as f64;
        let share = (time_ns - self.time_ns[before]) as f64 / span;
        Some(self.world_from_body[before].interpolate(&self.world_from_body[after], share))
    }

    /// The poses of a frame that sits fixed to the body.
    pub(crate) fn of_fixed_frame(&self, body_from_frame: &Pose) -> Self {
        let world_from_body = self.world_from_body.iter().map(|pose| *pose * *body_from_frame).collect();
        Self { time_ns: self.time_ns.clone(), world_from_body }
    }

    /// The same poses, moved.
    pub(crate) fn moved(&self, by_m: DVec3) -> Self {
        let moved = |pose: &Pose| Pose::new(pose.rotation, pose.translation_m + by_m);
        Self {
            time_ns: self.time_ns.clone(),
            world_from_body: self.world_from_body.iter().map(moved).collect(),
        }
    }

    /// Least axis-aligned box around the poses, m.
    pub(crate) fn bounds_m(&self) -> [DVec3; 2] {
        let start = self.world_from_body[0].translation_m;
        let extend = |[low, high]: [DVec3; 2], pose: &Pose| {
            [low.min(pose.translation_m), high.max(pose.translation_m)]
        };
        self.world_from_body.iter().fold([start; 2], extend)
    }

    /// Pose so long after the start, ns with their fraction; the last one from the end on.
    pub(crate) fn at_offset_ns(&self, after_start_ns: f64) -> Pose {
        let [start_ns, _] = self.time_span_ns();
        let after_start_ns = after_start_ns.max(0.0);
        let whole_ns = after_start_ns.floor();
        let time_ns = start_ns.saturating_add(whole_ns as u64);
        let after = self.time_ns.partition_point(|t| *t <= time_ns);
        let before = after - 1; // the first time is not after the start
        if after == self.time_ns.len() {
            return self.world_from_body[before];
        }
        let span_ns = (self.time_ns[after] - self.time_ns[before]) as f64;
        let share = ((time_ns - self.time_ns[before]) as f64 + after_start_ns - whole_ns) / span_ns;
        self.world_from_body[before].interpolate(&self.world_from_body[after], share)
    }

    /// How many poses there are up to a time.
    pub(crate) fn poses_until(&self, time_ns: u64) -> usize {
        self.time_ns.partition_point(|stamp_ns| *stamp_ns <= time_ns)
    }

    /// Stamped poses in order.
    pub fn stamped(&self) -> impl Iterator<Item = (u64, Pose)> + '_ {
        self.time_ns.iter().copied().zip(self.world_from_body.iter().copied())
    }
}

/// What can be wrong with a trajectory.
#[derive(Debug, thiserror::Error)]
pub enum TrajectoryError {
    /// No pose at all.
    #[error("a trajectory needs at least one pose")]
    Empty,
    /// Time stands still or runs back.
    #[error("time does not increase at pose {index} (counted from 0)")]
    NotIncreasing {
        /// Position of the offending pose.
        index: usize,
    },
    /// A line of a file is not what its format asks for.
    #[error("line {line}: {found}")]
    Line {
        /// Line number from 1.
        line: usize,
        /// What was found and what was expected.
        found: String,
    },
    /// The file as a whole is not what its format asks for.
    #[error("{reason}")]
    Format {
        /// What was found, what was expected, what to do.
        reason: String,
    },
    /// Poses without times need a rate.
    #[error("a rate of {rate_hz} poses per second, expected 0.001 to 1000000")]
    Rate {
        /// As given, Hz.
        rate_hz: f64,
    },
    /// A planned walk that cannot be walked.
    #[error("{reason}")]
    Shape {
        /// What was found and what was expected.
        reason: String,
    },
}
