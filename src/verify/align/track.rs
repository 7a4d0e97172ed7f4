//! A walk whose odometry lost track: a stretch of it is placed, and from there the walk is laid against the scene revolution
//! by revolution, each from where the one before it lies. Odometry is asked only how the body may have moved on.

use std::ops::Range;

use glam::DVec3;

use super::rays::Refining;
use super::surface::Target;
use super::{Alignment, Answer, Hint, WalkReturn, place, share};
use crate::base::geometry::Pose;
use crate::verify::odometry::Motion;
use crate::world::trajectory::Trajectory;

/// Stretches that are tried, evenly over the walk; each a share of it, and at most so long, s.
const STRETCHES: usize = 6;
const STRETCH_SHARE: f64 = 1.0 / 3.0;
const LONGEST_S: f64 = 15.0;
/// Of the stretch, and of the whole walk once it is tracked, at least: in another building a tracked walk fits to 0.82 (60 pairs),
/// in its own to 0.95 even with a sensor that is two degrees off.
const STRETCH_INLIERS: f64 = 0.7;
const WALK_INLIERS: f64 = 0.9;
/// Duration of a revolution, ns, and returns without which it says nothing.
const REVOLUTION_NS: u64 = 100_000_000;
const LEAST_RETURNS: usize = 300;
/// Rounds that find the motion within a revolution.
const ROUNDS: usize = 2;
const OF_REVOLUTION: Refining = Refining { rounds: 10, gate_m: 0.6, guess_sd: Some([0.1, 0.1]) };
/// Where fewer returns fit, turns are tried, rad about the vertical within a revolution: somebody turns on the heel.
const DOUBTED: f64 = 0.7;
const TURNS_RAD: [f64; 6] = [-0.06, 0.06, -0.12, 0.12, -0.2, 0.2];
/// A revolution of which fewer fit lies where it was expected.
const LEAST_SHARE: f64 = 0.4;

/// A walk that was tracked through the scene.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Of the stretch that was placed.
    pub alignment: Alignment,
    /// In the scene's frame.
    pub trajectory: Trajectory,
    /// Of the returns of all revolutions, the share that fits.
    pub inlier_share: f64,
}

impl Tracked {
    pub(crate) fn words(&self) -> String {
        format!(
            "odometry lost track: one stretch of the walk was placed, and the walk tracked from there through the scene, \
             revolution by revolution; {:.0} % of the returns fit",
            100.0 * self.inlier_share
        )
    }
}

/// Tracks a walk by odometry through the scene; none where no stretch of it is sure to lie there, or the rest does not follow, as
/// in another building. `returns`: in order of time, in the frame of their trajectory.
pub fn track(
    returns: &[WalkReturn],
    trajectory: &Trajectory,
    target: &Target<'_>,
    hint: Option<Hint>,
) -> Option<Tracked> {
    let (alignment, stretch) = placed_stretch(returns, trajectory, target, hint)?;
    let tracker = Tracker { target, trajectory, scene_from_walk: alignment.placed()? };
    let revolutions = revolutions(returns, trajectory);
    let middle_ns = returns[(stretch.start + stretch.end) / 2].time_ns;
    let (before, after) = revolutions.split_at(revolutions.partition_point(|of| of.middle_ns < middle_ns));
    let mut laid = tracker.walk(before.iter().rev());
    laid.reverse();
    laid.extend(tracker.walk(after.iter()));
    let inlier_share = laid.iter().map(|laid| laid.inlier_share).sum::<f64>() / laid.len().max(1) as f64;
    if inlier_share < WALK_INLIERS {
        return None;
    }
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let ends = [(start_ns, laid.first()?), (end_ns, laid.last()?)];
    let mut poses: Vec<(u64, Pose)> = laid.iter().map(|laid| (laid.time_ns, laid.pose)).collect();
    poses.extend(ends.map(|(time_ns, laid)| (time_ns, laid.at(time_ns, &laid.motion))));
    poses.sort_by_key(|(time_ns, _)| *time_ns);
    poses.dedup_by_key(|(time_ns, _)| *time_ns);
    let trajectory = Trajectory::new(poses).ok()?;
    Some(Tracked { alignment, trajectory, inlier_share })
}

/// The stretch that fits best of those that are surely placed. A hint says where the walk begins, so with one it is the first.
fn placed_stretch(
    returns: &[WalkReturn],
    trajectory: &Trajectory,
    target: &Target<'_>,
    hint: Option<Hint>,
) -> Option<(Alignment, Range<usize>)> {
    let [first_ns, last_ns] = [returns.first()?, returns.last()?].map(|of| of.time_ns);
    let walk_s = last_ns.saturating_sub(first_ns) as f64 * 1e-9;
    let stretch_s = (STRETCH_SHARE * walk_s).min(LONGEST_S);
    let at = |after_s: f64| {
        let after_ns = (after_s * 1e9) as u64;
        returns.partition_point(|of| of.time_ns - first_ns < after_ns)
    };
    let placed = |number: usize| {
        let from_s = (walk_s - stretch_s) * number as f64 / (STRETCHES - 1) as f64;
        let stretch = at(from_s)..at(from_s + stretch_s);
        let part = &returns[stretch.clone()];
        let start = trajectory.at(part.first()?.time_ns)?;
        let found = place(part, &start, target, hint).ok()?;
        let inlier_share = found.best.as_ref()?.inlier_share;
        let is_sure = found.answer == Answer::Placed && inlier_share >= STRETCH_INLIERS;
        is_sure.then_some((inlier_share, found, stretch))
    };
    let tried = if hint.is_some() { 1 } else { STRETCHES };
    let best = (0..tried).filter_map(placed).max_by(|(a, ..), (b, ..)| a.total_cmp(b));
    best.map(|(_, found, stretch)| (found, stretch))
}

/// Returns of one revolution in the body at their own times.
struct Revolution {
    middle_ns: u64,
    returns: Vec<WalkReturn>,
}

fn revolutions(returns: &[WalkReturn], trajectory: &Trajectory) -> Vec<Revolution> {
    let in_body = |of: &WalkReturn| Some(of.moved(&trajectory.at(of.time_ns)?.inverse()));
    let mut found = Vec::new();
    let mut rest = returns;
    while let Some(first) = rest.first() {
        let count = rest.partition_point(|of| of.time_ns - first.time_ns < REVOLUTION_NS).max(1);
        let (of_this, later) = rest.split_at(count);
        rest = later;
        if count >= LEAST_RETURNS {
            let middle_ns = first.time_ns + (of_this[count - 1].time_ns - first.time_ns) / 2;
            found.push(Revolution { middle_ns, returns: of_this.iter().filter_map(in_body).collect() });
        }
    }
    found
}

impl Revolution {
    /// In the body at the middle, if it moved like this.
    fn straightened(&self, motion: &Motion) -> Vec<WalkReturn> {
        let straight = |of: &WalkReturn| of.moved(&motion.over(seconds(self.middle_ns, of.time_ns)));
        self.returns.iter().map(straight).collect()
    }
}

/// Where a revolution lies in the scene, and how the body came there.
#[derive(Clone, Copy)]
struct Laid {
    time_ns: u64,
    pose: Pose,
    motion: Motion,
    inlier_share: f64,
}

impl Laid {
    /// Where the body is at another time, if it moves like this.
    fn at(&self, time_ns: u64, motion: &Motion) -> Pose {
        self.pose * motion.over(seconds(self.time_ns, time_ns))
    }
}

struct Tracker<'a> {
    target: &'a Target<'a>,
    trajectory: &'a Trajectory,
    scene_from_walk: Pose,
}

impl Tracker<'_> {
    /// One after the other in the order in which they come, forwards or backwards in time.
    fn walk<'r>(&self, revolutions: impl Iterator<Item = &'r Revolution>) -> Vec<Laid> {
        let mut all: Vec<Laid> = Vec::new();
        for revolution in revolutions {
            let Some(last) = all.last().copied().or_else(|| self.start(revolution)) else { continue };
            all.push(self.next(revolution, &last));
        }
        all
    }

    /// Where the placement of the stretch has the body half a revolution before.
    fn start(&self, revolution: &Revolution) -> Option<Laid> {
        let time_ns = revolution.middle_ns.checked_sub(REVOLUTION_NS / 2)?;
        let pose = self.scene_from_walk * self.trajectory.at(time_ns)?;
        let motion = self.by_odometry(time_ns, revolution.middle_ns)?;
        Some(Laid { time_ns, pose, motion, inlier_share: 1.0 })
    }

    fn by_odometry(&self, from_ns: u64, to_ns: u64) -> Option<Motion> {
        let [from, to] = [self.trajectory.at(from_ns)?, self.trajectory.at(to_ns)?];
        Some(Motion::between(&from, &to, seconds(from_ns, to_ns)))
    }

    /// The body moved on as it did, as odometry has it, or turned.
    fn next(&self, revolution: &Revolution, last: &Laid) -> Laid {
        let time_ns = revolution.middle_ns;
        let by_odometry = self.by_odometry(last.time_ns, time_ns);
        let lay = |motion: Motion| self.laid(revolution, last, motion);
        let mut laid: Vec<Laid> = [last.motion].into_iter().chain(by_odometry).filter_map(lay).collect();
        if laid.iter().all(|laid| laid.inlier_share < DOUBTED) {
            let turned = |turn_rad: f64| {
                let turn_rad_s = DVec3::Z * (turn_rad / seconds(last.time_ns, time_ns));
                Motion { turn_rad_s: last.motion.turn_rad_s + turn_rad_s, ..last.motion }
            };
            laid.extend(TURNS_RAD.into_iter().map(turned).filter_map(lay));
        }
        let best = laid.into_iter().max_by(|a, b| a.inlier_share.total_cmp(&b.inlier_share));
        best.filter(|best| best.inlier_share >= LEAST_SHARE).unwrap_or_else(|| {
            let motion = by_odometry.unwrap_or(last.motion);
            Laid { time_ns, pose: last.at(time_ns, &motion), motion, inlier_share: 0.0 }
        })
    }

    /// None where too little meets a surface.
    fn laid(&self, revolution: &Revolution, last: &Laid, mut motion: Motion) -> Option<Laid> {
        let time_ns = revolution.middle_ns;
        let mut found = None;
        for _ in 0..ROUNDS {
            let returns = revolution.straightened(&motion);
            let pose = self.target.refine(&last.at(time_ns, &motion), &returns, &OF_REVOLUTION)?.pose;
            motion = Motion::between(&last.pose, &pose, seconds(last.time_ns, time_ns));
            found =
                Some(Laid { time_ns, pose, motion, inlier_share: share(&self.target.fits(&pose, &returns)) });
        }
        found
    }
}

fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    (to_ns as f64 - from_ns as f64) * 1e-9
}
