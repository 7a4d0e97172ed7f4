//! A placed walk laid against the scene piece by piece: what its trajectory drifted is taken out.

use glam::DVec3;
use rayon::prelude::*;

use super::rays::{Refining, Target};
use super::returns::{WalkReturn, evenly};
use super::surface::Surface;
use crate::base::geometry::Pose;
use crate::world::scene::Scene;
use crate::world::trajectory::{Trajectory, TrajectoryError};

/// Time between two corrections, ns, and of the returns that one stands on.
const STEP_NS: u64 = 250_000_000;
const WINDOW_NS: u64 = 500_000_000;
/// Most returns of one.
const RETURNS: usize = 2500;
/// How much a correction may differ from the one before, m and rad: what odometry drifts in a step, several times over.
const CHANGE_SD: [f64; 2] = [0.02, 0.005];
/// Corrections by fewer returns that fit are not believed.
const LEAST_SHARE: f64 = 0.4;

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
    scene: &Scene,
    scene_from_walk: &Pose,
) -> Result<Followed, TrajectoryError> {
    let surface = Surface::of(scene);
    let target = Target { scene, map: &surface.map };
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let settings = Refining { rounds: 8, gate_m: 0.3, guess_sd: Some(CHANGE_SD) };
    let mut corrected = *scene_from_walk;
    let mut found: Vec<(u64, Pose)> = Vec::new();
    let mut unsure = 0;
    let mut from = 0;
    // steps without returns cost nothing: a clock that was set makes them many
    while let Some(next) = returns.get(from) {
        let middle_ns = next.time_ns.saturating_add(STEP_NS / 2).clamp(start_ns, end_ns);
        let near = |of: &WalkReturn| of.time_ns < middle_ns.saturating_sub(WINDOW_NS / 2);
        let first = returns.partition_point(near);
        let last = returns.partition_point(|of| of.time_ns <= middle_ns.saturating_add(WINDOW_NS / 2));
        let window = evenly(&returns[first..last.max(first)], RETURNS);
        let refined = target.refine(&corrected, &window, &settings);
        let fits = |pose: &Pose| {
            target.fits(pose, &window).iter().filter(|fits| **fits).count() as f64
                / window.len().max(1) as f64
        };
        match refined.filter(|refined| fits(&refined.pose) >= LEAST_SHARE) {
            Some(refined) => corrected = refined.pose,
            None => unsure += 1,
        }
        found.push((middle_ns, corrected));
        from = returns.partition_point(|of| of.time_ns < next.time_ns.saturating_add(STEP_NS)).max(from + 1);
    }
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
