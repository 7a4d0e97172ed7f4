//! A placed walk compared with the scene piece by piece: corrects the drift of its trajectory.

use glam::DVec3;
use rayon::prelude::*;

use super::rays::{Refining, middle_m};
use super::returns::{WalkReturn, evenly};
use super::share;
use super::surface::Target;
use crate::base::geometry::Pose;
use crate::world::trajectory::{Trajectory, TrajectoryError};

/// Time between two corrections, ns, and of the returns that one stands on.
const STEP_NS: u64 = 250_000_000;
const WINDOW_NS: u64 = 500_000_000;
/// Most returns of one.
const RETURNS: usize = 2500;
/// How much a correction may differ from the one before, m and rad: what odometry drifts in a step, several times over.
const CHANGE_SD: [f64; 2] = [0.02, 0.005];
const OF_PIECES: Refining = Refining { rounds: 8, gate_m: 0.3, guess_sd: Some(CHANGE_SD) };
/// Corrections by fewer returns that fit are not believed.
const LEAST_SHARE: f64 = 0.4;
/// Pieces that tell how a trajectory drifts, and points around the body that stand for its pose, m.
const FEW_PIECES: u64 = 24;
const AROUND_M: f64 = 2.0;
/// Pieces that lie farther than this from a rigid placement of all drift, m.
const DRIFTS_M: f64 = 0.02;

/// A trajectory in the scene's frame.
#[derive(Clone, Debug)]
pub(crate) struct Followed {
    pub trajectory: Trajectory,
    /// Pieces of the walk, and those that fit too badly to be corrected.
    pub pieces: usize,
    pub unsure: usize,
    /// The farthest that a correction moved the body from where the placement alone put it, m.
    pub drift_m: f64,
}

/// Lays a placed walk against the scene, piece by piece, each beginning from the correction of the piece before. `returns`: in
/// order of time, in the trajectory's own frame.
///
/// # Errors
/// Poses that make no trajectory.
pub(crate) fn follow(
    returns: &[WalkReturn],
    trajectory: &Trajectory,
    target: &Target<'_>,
    scene_from_walk: &Pose,
) -> Result<Followed, TrajectoryError> {
    let pieces = pieces(target, returns, STEP_NS, scene_from_walk);
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let unsure = pieces.iter().filter(|piece| !piece.is_sure).count();
    let mut found: Vec<(u64, Pose)> =
        pieces.iter().map(|piece| (piece.time_ns.clamp(start_ns, end_ns), piece.scene_from_walk)).collect();
    found.dedup_by_key(|(time_ns, _)| *time_ns);
    let mut times_ns: Vec<u64> = trajectory.stamped().map(|(time_ns, _)| time_ns).collect();
    times_ns.extend(found.iter().map(|(time_ns, _)| *time_ns));
    times_ns.sort_unstable();
    times_ns.dedup();
    let placed: Vec<(u64, Pose, f64)> = times_ns
        .par_iter()
        .filter_map(|time_ns| {
            let own = trajectory.at(*time_ns)?;
            let pose = between(&found, *time_ns, scene_from_walk, own.translation_m) * own;
            let moved_m = pose.translation_m.distance(scene_from_walk.transform_point(own.translation_m));
            Some((*time_ns, pose, moved_m))
        })
        .collect();
    let drift_m = placed.iter().map(|(_, _, moved_m)| *moved_m).fold(0.0, f64::max);
    let trajectory = Trajectory::new(placed.into_iter().map(|(time_ns, pose, _)| (time_ns, pose)).collect())?;
    Ok(Followed { trajectory, pieces: found.len(), unsure, drift_m })
}

/// Where one piece of a walk lies.
struct Piece {
    time_ns: u64,
    /// Where its beams started, in the middle, m.
    middle_m: DVec3,
    scene_from_walk: Pose,
    /// Whether enough of its returns fit; otherwise it lies as the piece before.
    is_sure: bool,
}

/// Every piece laid against the scene by its own returns. A placement of the whole is best in the middle: pieces follow from
/// there to both ends, each from where the one before lay.
fn pieces(target: &Target<'_>, returns: &[WalkReturn], step_ns: u64, scene_from_walk: &Pose) -> Vec<Piece> {
    // steps without returns cost nothing: a clock that was set makes them many
    let mut starts: Vec<u64> = Vec::new();
    let mut from = 0;
    while let Some(next) = returns.get(from) {
        starts.push(next.time_ns);
        from = returns.partition_point(|of| of.time_ns < next.time_ns.saturating_add(step_ns)).max(from + 1);
    }
    let window = |start_ns: u64| {
        let middle_ns = start_ns.saturating_add(step_ns / 2);
        let half_ns = WINDOW_NS.max(step_ns) / 2;
        let first = returns.partition_point(|of| of.time_ns < middle_ns.saturating_sub(half_ns));
        let last = returns.partition_point(|of| of.time_ns <= middle_ns.saturating_add(half_ns));
        (middle_ns, evenly(&returns[first..last.max(first)], RETURNS))
    };
    let laid = |start_ns: u64, before: &Pose| {
        let (time_ns, window) = window(start_ns);
        let share = |pose: &Pose| share(&target.fits(pose, &window));
        let refined = target.refine(before, &window, &OF_PIECES);
        let found = refined.map(|refined| refined.pose).filter(|pose| share(pose) >= LEAST_SHARE);
        let middle_m = middle_m(&window).unwrap_or_default();
        Piece { time_ns, middle_m, scene_from_walk: found.unwrap_or(*before), is_sure: found.is_some() }
    };
    let (to_start, to_end) = starts.split_at(starts.len() / 2);
    let chain = |starts: &mut dyn Iterator<Item = &u64>| -> Vec<Piece> {
        let mut before = *scene_from_walk;
        let next = |start_ns: &u64| {
            let piece = laid(*start_ns, &before);
            before = piece.scene_from_walk;
            piece
        };
        starts.map(next).collect()
    };
    let mut all = chain(&mut to_start.iter().rev());
    all.reverse();
    all.extend(chain(&mut to_end.iter()));
    all
}

/// The rigid placement that lies nearest to those of all pieces, where the trajectory drifts so much that they differ: surfaces
/// that are seen often or from afar pull a placement of the whole towards their pieces. None where it hardly drifts, or where
/// too little of the walk fits.
pub(super) fn nearest_rigid(
    target: &Target<'_>,
    returns: &[WalkReturn],
    scene_from_walk: &Pose,
) -> Option<Pose> {
    let [first, last] = [returns.first()?, returns.last()?].map(|of| of.time_ns);
    let step_ns = (last.saturating_sub(first) / FEW_PIECES).max(STEP_NS);
    let mut pieces = pieces(target, returns, step_ns, scene_from_walk);
    let all = pieces.len();
    pieces.retain(|piece| piece.is_sure);
    if pieces.len() < 3 || 2 * pieces.len() < all {
        return None;
    }
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let around: Vec<DVec3> = axes.map(|axis| AROUND_M * axis).collect();
    let points =
        pieces.iter().flat_map(|piece| around.iter().map(move |off_m| (piece, piece.middle_m + *off_m)));
    let placed = |(piece, at_m): (&Piece, DVec3)| (at_m, piece.scene_from_walk.transform_point(at_m));
    let (from_m, to_m): (Vec<DVec3>, Vec<DVec3>) = points.map(placed).unzip();
    let rigid = Pose::between_points(&from_m, &to_m)?;
    let left_m =
        from_m.iter().zip(&to_m).map(|(from_m, to_m)| rigid.transform_point(*from_m).distance(*to_m));
    (left_m.fold(0.0, f64::max) > DRIFTS_M).then_some(rigid)
}

/// The correction at a time, between two about the place of the body then: turns about a far origin would swing it.
fn between(found: &[(u64, Pose)], time_ns: u64, otherwise: &Pose, at_m: DVec3) -> Pose {
    let after = found.partition_point(|(at_ns, _)| *at_ns <= time_ns);
    match (after.checked_sub(1).map(|before| found[before]), found.get(after).copied()) {
        (None, None) => *otherwise,
        (Some((_, only)), None) | (None, Some((_, only))) => only,
        (Some((from_ns, from)), Some((to_ns, to))) => {
            let share = (time_ns - from_ns) as f64 / (to_ns - from_ns) as f64;
            let about = Pose::from_translation(at_m);
            (from * about).interpolate(&(to * about), share) * Pose::from_translation(-at_m)
        }
    }
}
