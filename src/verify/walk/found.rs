//! The trajectory of a recording, and where it lies in the scene.

use super::by_odometry::OdometryResult;
use super::error::WalkError;
use super::in_scene::{Placed, RAYS, Walk, in_scene};
use super::spec::WalkSiteSpec;
use crate::base::geometry::Pose;
use crate::recording::mounted::MountedRecording;
use crate::recording::{RecordingError, TrajectorySource, read_trajectory};
use crate::verify::compare::RaySample;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// A trajectory, and what odometry read of the recording.
pub(super) enum Found {
    Elsewhere(Trajectory),
    Odometry(Box<OdometryResult>),
}

impl Found {
    pub(super) fn trajectory(&self) -> &Trajectory {
        match self {
            Self::Elsewhere(trajectory) => trajectory,
            Self::Odometry(result) => &result.walked.trajectory,
        }
    }
}

/// From a file, the recording's own, or by odometry.
pub(super) fn find_trajectory(
    spec: &WalkSiteSpec,
    recorded: &MountedRecording,
    notices: &mut Vec<String>,
) -> Result<Found, WalkError> {
    let by_odometry = |notices: &mut Vec<String>| -> Result<Found, WalkError> {
        let result = OdometryResult::of_rig(recorded, &spec.odometry, spec.map_of.is_none())?;
        notices.extend(result.remarks());
        Ok(Found::Odometry(Box::new(result)))
    };
    let path = match &spec.trajectory {
        Some(TrajectorySource::Still) => return Ok(Found::Elsewhere(recorded.still()?)),
        Some(TrajectorySource::Odometry) => return by_odometry(notices),
        Some(TrajectorySource::File(path)) => path,
        None => {
            let is_mapped = spec.map_of.is_some();
            let of_bag = recorded.poses_of_bag()?;
            let words = match of_bag {
                Some(_) => {
                    "odometry finds the trajectory: --trajectory BAG --align takes the bag's own poses".into()
                }
                None => format!("{} holds no trajectory: odometry finds one", recorded.what()),
            };
            // a map of the recording itself lies in any frame
            return match recorded.own_trajectory()?.or(of_bag.filter(|_| is_mapped)) {
                Some(own) => {
                    notices.extend(own.notes);
                    Ok(Found::Elsewhere(own.trajectory))
                }
                None if is_mapped => Err(WalkError::NoTrajectoryOfMap { what: recorded.what() }),
                None => {
                    notices.push(words);
                    by_odometry(notices)
                }
            };
        }
    };
    let (poses, notes) = read_trajectory(path, spec.rate_hz)?;
    notices.extend(notes);
    let Some(rate_hz) = spec.rate_hz else {
        return Ok(Found::Elsewhere(poses));
    };
    let [first_ns, _] = recorded.span_ns()?.ok_or(RecordingError::NoFrame)?;
    let first_ns = first_ns + (0.5e9 / rate_hz).round() as u64; // poses are those of the middles
    let stamped: Vec<(u64, Pose)> =
        poses.stamped().map(|(time_ns, pose)| (time_ns + first_ns, pose)).collect();
    Ok(Found::Elsewhere(Trajectory::of_revolutions(stamped)?))
}

/// Where a trajectory of a frame of its own lies in the scene, which begins at `origin`.
pub(super) fn placed(
    spec: &WalkSiteSpec,
    recorded: &MountedRecording,
    found: &Found,
    (scene, origin): (&Scene, LocalOrigin),
    time_offset_ns: i64,
) -> Result<Placed, WalkError> {
    let walk = |rays, sensors, drifts| Walk {
        trajectory: found.trajectory(),
        rays,
        sensors,
        time_offset_ns,
        drifts,
    };
    match found {
        Found::Odometry(result) => {
            let walk = walk(&result.rays[..], &result.mounted[..], true);
            in_scene(&walk, scene, origin, spec.near, spec.observer)
        }
        Found::Elsewhere(_) => {
            let sample = RaySample::of(recorded, RAYS)?;
            let walk = walk(&sample.rays[..], &sample.sensors[..], false);
            in_scene(&walk, scene, origin, spec.near, spec.observer)
        }
    }
}
