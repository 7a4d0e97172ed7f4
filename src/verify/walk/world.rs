//! The trajectory by which returns are placed: a file, the recording's own, or odometry.

use std::path::Path;

use super::by_odometry::OdometrySpec;
use super::error::WalkError;
use crate::recording::decoding::{DecodingSpec, OutputFrame};
use crate::recording::export::Format;
use crate::recording::mounted::{AxisZeros, Mounts, each_frame, revolutions_ns};
use crate::recording::registered::{Registration, Target, TimeOffset};
use crate::recording::{Recording, TrajectorySource, read_trajectory};
use crate::world::trajectory::{ReadTrajectory, Trajectory, suspicions};

/// A trajectory and how its times count.
struct Found {
    pub trajectory: Trajectory,
    pub offset: TimeOffset,
    /// What the user should know of it.
    pub notices: Vec<String>,
}

/// Where the sensors sit, and how their points are moved; none of the first where they stay.
pub(crate) fn registration(
    spec: &DecodingSpec,
    recording: &Recording,
    notices: &mut Vec<String>,
) -> Result<(Option<Mounts>, Registration), WalkError> {
    if !spec.is_moved() {
        return stated(spec, recording, notices);
    }
    let mut mounts = Mounts::of(recording, spec.mount.as_deref(), &AxisZeros::default())?;
    let target = match spec.frame {
        OutputFrame::World => {
            let found = find(spec.trajectory.as_ref(), spec.time_offset, recording, &mut mounts)?;
            notices.extend(found.notices);
            Target::World { trajectory: found.trajectory, offset: found.offset }
        }
        OutputFrame::Rig | OutputFrame::Sensor => Target::Rig,
    };
    notices.extend(mounts.notices.iter().cloned());
    Ok((Some(mounts), Registration::new(target, spec.filter.clone())))
}

/// The same where points stay in their sensors' frames, for a file that has a place for transforms.
fn stated(
    spec: &DecodingSpec,
    recording: &Recording,
    notices: &mut Vec<String>,
) -> Result<(Option<Mounts>, Registration), WalkError> {
    let stay = Target::Sensor;
    if !spec.file_format().is_some_and(Format::holds_transforms) {
        return Ok((None, Registration::new(stay, spec.filter.clone())));
    }
    let mut mounts = Mounts::of(recording, spec.mount.as_deref(), &AxisZeros::default())?;
    let own = recording.checked_session().map(|session| session.trajectory()).transpose()?.flatten();
    let target = match (&spec.trajectory, own) {
        (None, None) => stay,
        (None, Some(ReadTrajectory { trajectory, notes })) => {
            notices.extend(notes);
            Target::SensorOnTrajectory { trajectory, offset: spec.time_offset }
        }
        (Some(TrajectorySource::Still), _) => stay,
        (Some(source), _) => {
            let found = find(Some(source), spec.time_offset, recording, &mut mounts)?;
            notices.extend(found.notices);
            Target::SensorOnTrajectory { trajectory: found.trajectory, offset: found.offset }
        }
    };
    let is_stated = mounts.is_known() || matches!(target, Target::SensorOnTrajectory { .. });
    if is_stated {
        notices.extend(mounts.notices.iter().cloned());
    }
    Ok((is_stated.then_some(mounts), Registration::new(target, spec.filter.clone())))
}

/// From the file named (`odometry`: by odometry), or what the recording holds itself.
fn find(
    source: Option<&TrajectorySource>,
    offset: TimeOffset,
    recording: &Recording,
    mounts: &mut Mounts,
) -> Result<Found, WalkError> {
    let path = match source {
        None => return own(offset, recording),
        Some(TrajectorySource::Still) => {
            return Ok(Found {
                trajectory: Trajectory::still(),
                offset: TimeOffset::Fixed(0),
                notices: Vec::new(),
            });
        }
        Some(TrajectorySource::Odometry) => return by_odometry(recording, mounts),
        Some(TrajectorySource::File(path)) => path,
    };
    match read_trajectory(path, None) {
        Ok((trajectory, mut notices)) => {
            notices.extend(suspicions(&trajectory, "trajectory"));
            Ok(Found { trajectory, offset, notices })
        }
        // poses without times, one per revolution
        Err(error) => match read_trajectory(path, Some(1.0)) {
            Ok((poses, notices)) => by_revolution(path, &poses, notices, offset, recording, mounts),
            Err(_) => Err(error.into()),
        },
    }
}

fn own(offset: TimeOffset, recording: &Recording) -> Result<Found, WalkError> {
    if let Some(session) = recording.checked_session() {
        let without = || WalkError::SessionWithout { recording: recording.name() };
        let ReadTrajectory { trajectory, notes } = session.trajectory()?.ok_or_else(without)?;
        return Ok(Found { trajectory, offset, notices: notes });
    }
    if !recording.is_bag() {
        return Err(WalkError::CaptureWithout { recording: recording.name() });
    }
    let (trajectory, notices) = read_trajectory(recording.path(), None).map_err(WalkError::BagWithout)?;
    Ok(Found { trajectory, offset, notices })
}

fn by_odometry(recording: &Recording, mounts: &mut Mounts) -> Result<Found, WalkError> {
    let mut pass = OdometrySpec::default().pass(mounts.sensors());
    each_frame(recording, mounts, &mut |mounted| {
        pass.add_frame(mounted.slot, mounted.model, mounted.body_from_sensor, mounted.frame);
        Ok::<(), WalkError>(())
    })?;
    let mut notices = Vec::new();
    let (walked, _) = pass.finish(&mut notices)?;
    notices.extend(walked.problems.iter().cloned());
    notices.extend(walked.open_direction());
    notices.push(
        "the world is the rig's frame at the first return: the trajectory was found by odometry".into(),
    );
    Ok(Found { trajectory: walked.trajectory, offset: TimeOffset::Fixed(0), notices })
}

fn by_revolution(
    path: &Path,
    poses: &Trajectory,
    mut notices: Vec<String>,
    offset: TimeOffset,
    recording: &Recording,
    mounts: &mut Mounts,
) -> Result<Found, WalkError> {
    let name = path.display().to_string();
    let middles_ns = revolutions_ns(recording, mounts).map_err(WalkError::Revolutions)?;
    let count = poses.stamped().count();
    if count != middles_ns.len() {
        let (recording, revolutions) = (recording.name(), middles_ns.len());
        return Err(WalkError::PosesPerRevolution { name, poses: count, recording, revolutions });
    }
    notices.push(format!(
        "{name}: poses without times: each is used for the middle of its revolution, {count} of {count}"
    ));
    let stamped = middles_ns.into_iter().zip(poses.stamped().map(|(_, pose)| pose));
    let trajectory = Trajectory::of_revolutions(stamped.collect())
        .map_err(|source| WalkError::TrajectoryFile { name, source })?;
    Ok(Found { trajectory, offset, notices })
}
