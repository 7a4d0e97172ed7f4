//! One registered cloud out of a recording: the returns of all sensors in the frame of the rig or of the world, each moved by
//! the pose at its own time; and which of them are written.

mod clip;
mod clock;
mod filter;
mod voxels;

pub(crate) use clip::ClipBox;
pub(crate) use clock::TimeOffset;
pub(crate) use filter::{Mask, PointFilter, RangeLimits, Returns, TimeWindow};
pub(crate) use voxels::VoxelThinning;

use std::collections::HashMap;

use self::clock::SensorClock;
use super::export::{Cloud, place};
use crate::base::geometry::Pose;
use crate::rig::BASE;
use crate::world::local_origin::LocalOrigin;
use crate::world::trajectory::Trajectory;

/// The frame of a trajectory.
pub(crate) const WORLD: &str = "world";

/// The frame in which points are wanted.
pub(crate) enum Target {
    /// Each sensor's own.
    Sensor,
    /// The same, in a file that says where the rig was.
    SensorOnTrajectory { trajectory: Trajectory, offset: TimeOffset },
    /// The rig's: x forward, y left, z up.
    Rig,
    /// That of a trajectory.
    World { trajectory: Trajectory, offset: TimeOffset },
}

impl Target {
    fn trajectory(&self) -> Option<(&Trajectory, TimeOffset)> {
        match self {
            Self::World { trajectory, offset } | Self::SensorOnTrajectory { trajectory, offset } => {
                Some((trajectory, *offset))
            }
            Self::Sensor | Self::Rig => None,
        }
    }
}

/// Moves clouds into one frame and leaves out what is not wanted.
pub(crate) struct Registration {
    target: Target,
    filter: PointFilter,
    clocks: HashMap<usize, SensorClock>,
    /// Points without a pose.
    outside: u64,
    /// Poses of the trajectory that were handed on.
    handed_on: usize,
}

impl Registration {
    pub(crate) fn new(target: Target, filter: PointFilter) -> Self {
        Self { target, filter, clocks: HashMap::new(), outside: 0, handed_on: 0 }
    }

    /// Name of the frame of the points, as ROS has it; none of sensors' own frames.
    pub(crate) fn frame_name(&self) -> Option<&'static str> {
        match self.target {
            Target::Sensor | Target::SensorOnTrajectory { .. } => None,
            Target::Rig => Some(BASE),
            Target::World { .. } => Some(WORLD),
        }
    }

    /// Where the local frame begins: near the trajectory, where that lies far from the origin.
    pub(crate) fn origin(&self) -> LocalOrigin {
        match &self.target {
            Target::World { trajectory, .. } => LocalOrigin::of_box(trajectory.bounds_m()),
            _ => LocalOrigin::default(),
        }
    }

    /// Notes when the first packet of the recording arrived (host clock, ns): times since the start count from there.
    pub(crate) fn begin(&mut self, host_time_ns: u64) {
        self.filter.window.begin(host_time_ns);
    }

    /// Whether a frame that arrived at these times (host clock, ns) has anything that is wanted.
    pub(crate) fn is_wanted(&self, host_time_ns: [u64; 2]) -> bool {
        self.filter.window.overlaps(host_time_ns)
    }

    /// Moves the points of a sensor's frame, given where the sensor sat on the body at a time of its clock (ns).
    pub(crate) fn apply(&mut self, sensor: usize, cloud: &mut Cloud, body_from_sensor: &dyn Fn(u64) -> Pose) {
        cloud.points_in = self.frame_name();
        let clock = self.clocks.entry(sensor).or_insert_with(|| SensorClock::starting(cloud, &self.target));
        clock.follow(cloud.start_time_ns, cloud.host_time_ns);
        self.filter.select_returns(&mut cloud.points, clock.host_from_device_ns());
        match &self.target {
            Target::Sensor | Target::SensorOnTrajectory { .. } => {}
            Target::Rig => {
                place(&mut cloud.points, |time_ns| Some(body_from_sensor(time_ns)));
                self.filter.mask(&mut cloud.points);
            }
            Target::World { trajectory, .. } => {
                clock.count(cloud, trajectory);
                let world_from_body = |time_ns: u64| trajectory.at(clock.trajectory_ns(time_ns)?);
                self.outside += match self.filter.masks() {
                    false => place(&mut cloud.points, |time_ns| {
                        Some(world_from_body(time_ns)? * body_from_sensor(time_ns))
                    }),
                    true => {
                        place(&mut cloud.points, |time_ns| Some(body_from_sensor(time_ns)));
                        self.filter.mask(&mut cloud.points);
                        place(&mut cloud.points, world_from_body)
                    }
                };
            }
        }
        self.filter.select_places(&mut cloud.points);
    }

    /// The poses of the trajectory from just before a cloud that was moved to just behind it, each once and with its time on the
    /// clock of the cloud's stamp, ns.
    pub(crate) fn poses(&mut self, sensor: usize, cloud: &Cloud) -> Vec<(u64, Pose)> {
        let (Some((trajectory, _)), Some(clock)) = (self.target.trajectory(), self.clocks.get(&sensor))
        else {
            return Vec::new();
        };
        let last_ns = cloud.points.iter().map(|point| point.time_ns).max().unwrap_or(cloud.start_time_ns);
        let span_ns = clock.trajectory_ns(cloud.start_time_ns).zip(clock.trajectory_ns(last_ns));
        let Some((start_ns, end_ns)) = span_ns else { return Vec::new() };
        let first = self.handed_on.max(trajectory.poses_until(start_ns).saturating_sub(1));
        let behind = trajectory.poses_until(end_ns) + 1;
        self.handed_on = self.handed_on.max(behind);
        let to_stamp_ns = i128::from(cloud.stamp_ns()) - i128::from(start_ns);
        let stamped = trajectory.stamped().skip(first).take(behind.saturating_sub(first));
        stamped
            .filter_map(|(time_ns, pose)| {
                Some((u64::try_from(i128::from(time_ns) + to_stamp_ns).ok()?, pose))
            })
            .collect()
    }

    /// Points that lie outside of the trajectory's time, in words; none where all have a pose.
    pub(crate) fn losses(&self) -> Option<String> {
        let Target::World { trajectory, .. } = &self.target else { return None };
        let [first_ns, last_ns] = trajectory.time_span_ns().map(|time_ns| time_ns as f64 * 1e-9);
        let spans: Vec<String> = self.clocks.values().filter_map(SensorClock::words_of_span).collect();
        (self.outside > 0).then(|| {
            format!(
                "{} points lie outside of the trajectory's time, {first_ns:.3} to {last_ns:.3} s, and were left out (the recording: \
                 {}); --time-offset moves the recording's times",
                self.outside,
                spans.join(", ")
            )
        })
    }

    /// How the clocks of the sensors were read, and what the filters had to leave open, in words.
    pub(crate) fn notices(&self, names: &dyn Fn(usize) -> String) -> Vec<String> {
        let mut sensors: Vec<_> = self.clocks.iter().collect();
        sensors.sort_by_key(|(sensor, _)| **sensor);
        let is_world = matches!(self.target, Target::World { .. });
        let of_clocks = sensors
            .into_iter()
            .filter(|_| is_world)
            .filter_map(|(sensor, clock)| Some(format!("{}: {}", names(*sensor), clock.notice()?)));
        of_clocks.chain(self.filter.notice()).collect()
    }
}

#[cfg(test)]
mod tests;
