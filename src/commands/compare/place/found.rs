//! The trajectory of a recording, and where it lies in the scene.

use anyhow::{Context as _, bail};

use super::args::PlaceArgs;
use crate::base::geometry::Pose;
use crate::commands::recorded::Recorded;
use crate::commands::recorded_odometry::{self as odometry, OdometryResult};
use crate::commands::scene_placement::{self, Placed, Walk};
use crate::commands::trajectory_args::read_trajectory;
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
    args: &PlaceArgs,
    recorded: &Recorded,
    notices: &mut Vec<String>,
) -> anyhow::Result<Found> {
    let by_odometry = |notices: &mut Vec<String>| -> anyhow::Result<Found> {
        let result = odometry::of_rig(recorded, &args.odometry, args.map_frames.is_none())?;
        notices.extend(odometry::remarks(&result));
        Ok(Found::Odometry(Box::new(result)))
    };
    let Some(path) = &args.trajectory else {
        return match recorded.own_trajectory()? {
            Some(own) => Ok(Found::Elsewhere(own)),
            None if args.map_frames.is_some() => {
                bail!("give --trajectory (`odometry` finds one): {} holds none", recorded.what())
            }
            None => {
                notices.push(format!("{} holds no trajectory: odometry finds one", recorded.what()));
                by_odometry(notices)
            }
        };
    };
    let name = path.display().to_string();
    if name == "still" {
        return Ok(Found::Elsewhere(recorded.still()?));
    }
    if name == "odometry" {
        return by_odometry(notices);
    }
    let (poses, notes) = read_trajectory(path, args.rate)?;
    notices.extend(notes);
    if args.rate.is_none() {
        return Ok(Found::Elsewhere(poses));
    }
    let first_ns = recorded.span_ns()?.context("the recording holds no frame")?[0];
    let first_ns = first_ns + (0.5e9 / args.rate.unwrap_or(1.0)).round() as u64; // poses are those of the middles
    let stamped: Vec<(u64, Pose)> =
        poses.stamped().map(|(time_ns, pose)| (time_ns + first_ns, pose)).collect();
    Ok(Found::Elsewhere(Trajectory::of_revolutions(stamped)?))
}

/// Where a trajectory of a frame of its own lies in the scene, which begins at `origin`.
pub(super) fn placed(
    args: &PlaceArgs,
    recorded: &Recorded,
    found: &Found,
    (scene, origin): (&Scene, LocalOrigin),
    time_offset_ns: i64,
) -> anyhow::Result<Placed> {
    let walk = |rays, sensors, drifts| Walk {
        trajectory: found.trajectory(),
        rays,
        sensors,
        time_offset_ns,
        drifts,
    };
    match found {
        Found::Odometry(result) => scene_placement::in_scene(
            &walk(&result.rays[..], &result.mounted[..], true),
            scene,
            origin,
            args.align_near,
        ),
        Found::Elsewhere(_) => {
            let sample = recorded.rays(scene_placement::RAYS)?;
            scene_placement::in_scene(
                &walk(&sample.rays[..], &sample.sensors[..], false),
                scene,
                origin,
                args.align_near,
            )
        }
    }
}
