//! A walk with a trajectory in a frame of its own, placed in a scene.

use super::error::WalkError;
use crate::base::geometry::Pose;
use crate::recording::Observer;
use crate::rig::MountedSensor;
use crate::verify::align::{Alignment, Answer, Hint, Target, WalkReturn, follow, place, track, walk_returns};
use crate::verify::compare::RecordedRay;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::{Trajectory, TrajectoryError};

/// Returns by which a walk is placed.
pub(crate) const RAYS: usize = 400_000;
/// Pieces that fit too badly are worth a word from this share.
const UNSURE: f64 = 0.05;

/// What of a recording is placed.
pub(crate) struct Walk<'a> {
    pub trajectory: &'a Trajectory,
    /// In order of time, on the recording's clock.
    pub rays: &'a [RecordedRay],
    pub sensors: &'a [MountedSensor],
    /// From the recording's clock to the trajectory's.
    pub time_offset_ns: i64,
    /// Whether the trajectory is odometry, which drifts: it is then laid against the scene piece by piece.
    pub drifts: bool,
}

/// A trajectory in the scene's frame; none where no placement is sure.
pub(crate) struct Placed {
    pub alignment: Alignment,
    pub trajectory: Option<Trajectory>,
    pub notices: Vec<String>,
}

/// Finds where a walk lies in a scene. The trajectory is in the scene's local frame, which begins at `origin`; what is
/// reported of the alignment, and `near`, are in the frame of the scene's file.
pub(crate) fn in_scene(
    walk: &Walk<'_>,
    scene: &Scene,
    origin: LocalOrigin,
    near: Option<Hint>,
    observer: Observer,
) -> Result<Placed, WalkError> {
    let stage = (observer.stage)("looking for the walk's place in the scene");
    let on_its_clock = |ray: &RecordedRay| RecordedRay {
        time_ns: ray.time_ns.saturating_add_signed(walk.time_offset_ns),
        ..*ray
    };
    let rays: Vec<RecordedRay> = walk.rays.iter().map(on_its_clock).collect();
    let returns = walk_returns(&rays, walk.sensors, walk.trajectory);
    let (_, start) = walk.trajectory.stamped().next().ok_or(TrajectoryError::Empty)?;
    let hint = near.map(|hint| Hint { at_m: hint.at_m - origin.world_m().truncate(), ..hint });
    let target = Target::of(scene);
    let found = place(&returns, &start, &target, hint)?;
    drop(stage);
    let is_bent = match found.answer {
        Answer::Placed => found.misfit.is_some(),
        Answer::NotFound => true,
        Answer::Ambiguous | Answer::Slides => false,
    };
    if walk.drifts && is_bent {
        let _stage = (observer.stage)("tracking the walk through the scene");
        if let Some(tracked) = track(&returns, walk.trajectory, &target, hint) {
            let alignment = tracked.alignment.moved(origin.world_m());
            let mut notices = vec![alignment.words(), tracked.words()];
            let returns = walk_returns(&rays, walk.sensors, &tracked.trajectory);
            let trajectory = followed(&returns, &tracked.trajectory, &target, &Pose::IDENTITY, &mut notices)?;
            return Ok(Placed { alignment, trajectory: Some(trajectory), notices });
        }
    }
    let alignment = found.moved(origin.world_m());
    let mut notices: Vec<String> = alignment.doubt().into_iter().collect();
    let Some(scene_from_walk) = found.placed() else {
        return Ok(Placed { alignment, trajectory: None, notices });
    };
    notices.insert(0, alignment.words());
    let trajectory = if walk.drifts {
        let _stage = (observer.stage)("laying the walk against the scene, piece by piece");
        followed(&returns, walk.trajectory, &target, &scene_from_walk, &mut notices)?
    } else {
        let placed = walk.trajectory.stamped().map(|(time_ns, pose)| (time_ns, scene_from_walk * pose));
        Trajectory::new(placed.collect())?
    };
    Ok(Placed { alignment, trajectory: Some(trajectory), notices })
}

/// Laid against the scene piece by piece.
fn followed(
    returns: &[WalkReturn],
    trajectory: &Trajectory,
    target: &Target<'_>,
    scene_from_walk: &Pose,
    notices: &mut Vec<String>,
) -> Result<Trajectory, TrajectoryError> {
    let followed = follow(returns, trajectory, target, scene_from_walk)?;
    notices.push(format!("drift corrected by the scene: up to {:.3} m", followed.drift_m));
    if followed.unsure as f64 > UNSURE * followed.pieces as f64 {
        notices.push(format!(
            "{} of {} pieces of the walk fit the scene too badly to be corrected",
            followed.unsure, followed.pieces
        ));
    }
    Ok(followed.trajectory)
}
