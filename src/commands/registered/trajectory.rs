//! The trajectory by which returns are placed: a file, the recording's own, or odometry.

use std::path::Path;

use anyhow::{Context as _, bail, ensure};

use super::mounts::Mounts;
use super::{each_frame, revolutions_ns};
use crate::commands::recorded_odometry::OdometryArgs;
use crate::commands::recording::Recording;
use crate::commands::trajectory_args::read_trajectory;
use crate::recording::registered::TimeOffset;
use crate::world::trajectory::{Trajectory, suspicions};

/// A trajectory and how its times count.
pub(crate) struct Found {
    pub trajectory: Trajectory,
    pub offset: TimeOffset,
    /// What the user should know of it.
    pub notices: Vec<String>,
}

/// As `--trajectory` says, or what the recording holds itself.
pub(crate) fn find(
    named: Option<&Path>,
    offset: TimeOffset,
    recording: &Recording,
    mounts: &mut Mounts,
) -> anyhow::Result<Found> {
    let Some(path) = named else { return own(offset, recording) };
    if path.as_os_str() == "odometry" {
        return by_odometry(recording, mounts);
    }
    match read_trajectory(path, None) {
        Ok((trajectory, mut notices)) => {
            notices.extend(suspicions(&trajectory, "trajectory"));
            Ok(Found { trajectory, offset, notices })
        }
        // poses without times, one per revolution
        Err(error) => match read_trajectory(path, Some(1.0)) {
            Ok((poses, notices)) => by_revolution(path, &poses, notices, offset, recording, mounts),
            Err(_) => Err(error),
        },
    }
}

fn own(offset: TimeOffset, recording: &Recording) -> anyhow::Result<Found> {
    if let Some(session) = recording.checked_session() {
        let trajectory = session.trajectory()?.with_context(|| {
            format!(
                "{} holds no trajectory: give --trajectory FILE or --trajectory odometry",
                recording.name()
            )
        })?;
        return Ok(Found { trajectory, offset, notices: Vec::new() });
    }
    ensure!(
        recording.is_bag(),
        "--frame world: {} does not say where the rig was: give --trajectory FILE (TUM, KITTI, a bag) or --trajectory odometry",
        recording.name()
    );
    let (trajectory, notices) = read_trajectory(recording.path(), None)
        .context("--frame world: give --trajectory FILE or --trajectory odometry")?;
    Ok(Found { trajectory, offset, notices })
}

fn by_odometry(recording: &Recording, mounts: &mut Mounts) -> anyhow::Result<Found> {
    let mut pass = OdometryArgs::default().pass(mounts.sensors());
    each_frame(recording, mounts, &mut |mounted| {
        pass.add_frame(mounted.slot, mounted.model, mounted.body_from_sensor, mounted.frame);
        Ok(())
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
) -> anyhow::Result<Found> {
    let name = path.display();
    let middles_ns = revolutions_ns(recording, mounts)?;
    let count = poses.stamped().count();
    if count != middles_ns.len() {
        bail!(
            "{name}: {count} poses without times, and {} holds {} revolutions of its first sensor; expected a pose for each, or a \
             trajectory with times (TUM)",
            recording.name(),
            middles_ns.len()
        );
    }
    notices.push(format!(
        "{name}: poses without times: each is used for the middle of its revolution, {count} of {count}"
    ));
    let stamped = middles_ns.into_iter().zip(poses.stamped().map(|(_, pose)| pose));
    let trajectory = Trajectory::of_revolutions(stamped.collect()).with_context(|| name.to_string())?;
    Ok(Found { trajectory, offset, notices })
}
