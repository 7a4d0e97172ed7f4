//! Where a walk lies in a known scene, from its returns and the trajectory in a frame of its own.
//!
//! The walk is turned upright by the floors and ceilings that it saw. Its walls are laid over those of the scene at every
//! turn and every place at once (correlation of horizontal slices by Fourier transforms); feature matchers lose where places
//! repeat, trying every turn does not. The best guesses are scored by rays, so that free space counts, and refined. The best
//! is compared with the others return by return: as many that fit one alone as the other alone make it ambiguous.

mod drift;
mod placement;
mod plan;
mod rays;
mod returns;
mod surface;
mod track;
mod upright;

use std::str::FromStr;

use glam::{DQuat, DVec2, DVec3};
use rayon::prelude::*;

use crate::base::geometry::Pose;
use crate::base::statistics::{mean_and_deviation, median};
use crate::design::registration::DEGENERATE;
use crate::verify::odometry::{Kernel, Memory, PointMap, align_points};

pub(crate) use drift::follow;
pub use placement::{Alignment, Answer, Deviation, Misfit, Placement, SecondBest};
use rays::{Refined, Refining};
use returns::evenly;
pub use returns::{WalkReturn, walk_returns};
pub use surface::Target;
use surface::{Patch, patches_of};
pub use track::{Tracked, track};

/// Fewer returns place nothing.
const LEAST_RETURNS: usize = 1000;
/// Returns by which guesses are scored, laid against the scene, and by which the best are refined and compared.
const SCORED: usize = 1500;
const LAID: usize = 1200;
const COMPARED: usize = 8000;
/// Returns that make the surfaces of the walk.
const MAPPED: usize = 400_000;
/// Guesses that are refined; so far apart, m and rad.
const REFINED: usize = 12;
const GUESSES_APART: [f64; 2] = [1.0, 0.2];
/// Placements nearer than this are one, m and rad: those of the two halves of a walk that odometry bent lie some degrees apart.
const APART: [f64; 2] = [0.3, 0.1];
/// Placements with a share so far below the best are not compared return by return.
const FAR_BELOW: f64 = 0.1;
/// A walk in another building fits to 0.6 (measured on ten pairs), in its own to 0.7 even with furniture moved.
const LEAST_INLIERS: f64 = 0.65;
/// Returns that fit the second placement alone, over those that fit the best alone: at most this where the best fits well,
/// and nothing where it fits as badly as another building may. A walk in another building fitted to 0.76 with 0.32.
const MOST_SECOND: f64 = 0.35;
const FITS_WELL: f64 = 0.85;
const FITS_BADLY: f64 = 0.6;
/// The best is sure all the same where it fits so many returns more than the second, as when odometry bent the rest of the walk:
/// in another building these are 0.11 at most, of those that fit as many as is asked for (120 pairs).
const SURE_LEAD: f64 = 0.25;
/// Placements that look alike have hardly any return that fits one of them alone; those of another building, which fit badly,
/// have many.
const MOST_DIFFERENT: f64 = 0.08;
/// Two placements fit equally well below this difference of their shares, or this multiple of its deviation.
const EQUAL: f64 = 0.002;
const SURE_Z: f64 = 3.0;
/// Blocks of the walk that tell how sure a difference is.
const BLOCKS: usize = 24;
/// A block fits badly below this share of the median block.
const MISFIT: f64 = 0.6;
/// A hint holds within this, m and rad.
const NEAR_M: f64 = 3.0;
const NEAR_RAD: f64 = 0.8;

/// Where the walk begins, about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hint {
    /// In the scene, m.
    pub at_m: DVec2,
    /// Heading of the body; none for any.
    pub yaw_rad: Option<f64>,
}

/// `x,y` or `x,y,yaw`: m and degrees.
impl FromStr for Hint {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok([x, y, rest @ ..]) if rest.len() < 2 && numbers.iter().flatten().all(|n| n.is_finite()) => {
                Ok(Self { at_m: DVec2::new(*x, *y), yaw_rad: rest.first().map(|yaw| yaw.to_radians()) })
            }
            _ => Err(format!("{text:?}: expected x,y in m, or x,y,yaw with the heading in degrees")),
        }
    }
}

/// Why a walk cannot be placed at all.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// Too little to go by.
    #[error("{found} returns lie within the trajectory's time: an alignment needs {LEAST_RETURNS}")]
    TooFew {
        /// Usable returns.
        found: usize,
    },
}

/// Places a walk: `returns` in order of time, in the frame of their trajectory, which begins with `start`.
///
/// # Errors
/// Too few returns.
pub fn place(
    returns: &[WalkReturn],
    start: &Pose,
    target: &Target<'_>,
    hint: Option<Hint>,
) -> Result<Alignment, AlignError> {
    let Some(middle_m) = rays::middle_m(returns).filter(|_| returns.len() >= LEAST_RETURNS) else {
        return Err(AlignError::TooFew { found: returns.len() });
    };
    let guesses = guesses(returns, middle_m, start, target, hint);
    let candidates = candidates(target, returns, middle_m, &guesses);
    Ok(judged(target, returns, candidates))
}

/// A placement with what was found out about it.
struct Candidate {
    refined: Refined,
    fits: Vec<bool>,
    share: f64,
}

/// Scene from walk: what the walls speak for.
fn guesses(
    returns: &[WalkReturn],
    middle_m: DVec3,
    start: &Pose,
    target: &Target<'_>,
    hint: Option<Hint>,
) -> Vec<Pose> {
    let points_m: Vec<DVec3> = evenly(returns, MAPPED).iter().map(|of| of.point_m).collect();
    let walk = patches_of(&points_m);
    let upright = upright::upright_from_walk(&walk).unwrap_or(DQuat::IDENTITY);
    let walk: Vec<Patch> = walk.iter().map(|patch| patch.turned(upright, middle_m)).collect();
    let bounds_m = target.scene.bounds_m();
    let heights_m = upright::heights_m(&walk, &target.patches, bounds_m.map(|corner| corner.z));
    let start_m = (upright * (start.translation_m - middle_m)).truncate();
    let ahead = (upright * start.rotation * DVec3::X).truncate();
    let is_allowed = |at_m: DVec2, yaw_rad: f64| {
        hint.is_none_or(|hint| {
            let turn = DVec2::from_angle(yaw_rad);
            let is_near = hint.at_m.distance(at_m + turn.rotate(start_m)) < NEAR_M;
            let heads = |wanted: f64| turn.rotate(ahead).angle_to(DVec2::from_angle(wanted)).abs() < NEAR_RAD;
            is_near && hint.yaw_rad.is_none_or(heads)
        })
    };
    let found = plan::guesses(&walk, &target.patches, &heights_m, bounds_m, &is_allowed);
    let pose = |guess: &plan::Guess| {
        let rotation = DQuat::from_rotation_z(guess.yaw_rad) * upright;
        Pose::new(rotation, guess.at_m - rotation * middle_m)
    };
    found.iter().map(pose).collect()
}

/// The best guesses by rays, refined; one of each place, best first.
fn candidates(
    target: &Target<'_>,
    returns: &[WalkReturn],
    middle_m: DVec3,
    guesses: &[Pose],
) -> Vec<Candidate> {
    let (few, many) = (evenly(returns, SCORED), evenly(returns, COMPARED));
    let mut scored: Vec<(f64, Pose)> =
        guesses.par_iter().map(|guess| (target.coarse_share(guess, &few), *guess)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<Pose> = Vec::new();
    for (_, guess) in scored {
        if chosen.len() < REFINED && chosen.iter().all(|other| apart(other, &guess, middle_m, GUESSES_APART))
        {
            chosen.push(guess);
        }
    }
    let laid = evenly(returns, LAID);
    let refine = |guess: &Pose| {
        let laid = laid_on(&target.map, &laid, middle_m, guess);
        let refined = target.refine(&laid, &few, &Refining::FROM_FAR)?;
        let share = share(&target.fits(&refined.pose, &few));
        Some((share, refined.pose))
    };
    let mut found: Vec<(f64, Pose)> = chosen.par_iter().filter_map(refine).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut once: Vec<(f64, Pose)> = Vec::new();
    for (share, pose) in found {
        if once.iter().all(|(_, other)| apart(other, &pose, middle_m, APART)) {
            once.push((share, pose));
        }
    }
    let best = once.first().map_or(0.0, |(share, _)| *share);
    let compared = once.iter().enumerate().filter(|(at, (share, _))| *at < 2 || *share > best - FAR_BELOW);
    let mut compared: Vec<Candidate> = compared
        .filter_map(|(_, (_, pose))| {
            let refined = target.refine(pose, &many, &Refining::FROM_NEAR)?;
            let fits = target.fits(&refined.pose, &many);
            Some(Candidate { share: share(&fits), refined, fits })
        })
        .collect();
    compared.sort_by(|a, b| b.share.total_cmp(&a.share));
    // what lay apart may have ended in one place
    let mut placed: Vec<Candidate> = Vec::new();
    for found in compared {
        if placed.iter().all(|other| apart(&other.refined.pose, &found.refined.pose, middle_m, APART)) {
            placed.push(found);
        }
    }
    placed
}

/// The points of the walk laid onto those of the scene: from farther than rays find their surface.
fn laid_on(map: &PointMap, returns: &[WalkReturn], middle_m: DVec3, guess: &Pose) -> Pose {
    let points_m: Vec<DVec3> = returns.iter().map(|of| of.point_m - middle_m).collect();
    let about_middle = *guess * Pose::from_translation(middle_m);
    let kernel = Kernel { width_m: 0.3, reach_cells: 1 };
    let laid = align_points(map, &points_m, &mut Memory::of(points_m.len()), &about_middle, kernel);
    laid.map_or(*guess, |laid| laid.pose * Pose::from_translation(-middle_m))
}

fn judged(target: &Target<'_>, returns: &[WalkReturn], candidates: Vec<Candidate>) -> Alignment {
    let Some(best) = candidates.first() else { return Alignment::nowhere() };
    let others: Vec<SecondBest> = candidates[1..].iter().map(|other| best.against(other)).collect();
    let equal = |other: &&SecondBest| other.only_best - other.only_second < EQUAL || other.z < SURE_Z;
    let differ =
        others.iter().filter(equal).any(|other| other.only_best + other.only_second > MOST_DIFFERENT);
    let mut placements = vec![best.placement()];
    placements.extend(others.iter().filter(equal).map(|other| other.placement.clone()));
    let translation = best.refined.information.conditioning().map(|seen| seen.translation);
    let degenerate = translation.filter(|axes| axes.least() < DEGENERATE);
    let second_best = others.into_iter().next();
    let sureness = ((best.share - FITS_BADLY) / (FITS_WELL - FITS_BADLY)).clamp(0.0, 1.0);
    let is_unclear = second_best.as_ref().is_some_and(|other| {
        other.only_best - other.only_second < SURE_LEAD
            && other.only_second > MOST_SECOND * sureness * other.only_best
    });
    let answer = match () {
        () if best.share < LEAST_INLIERS => Answer::NotFound,
        () if differ && best.share < FITS_WELL => Answer::NotFound,
        () if placements.len() > 1 && degenerate.is_some() => Answer::Slides,
        () if placements.len() > 1 => Answer::Ambiguous,
        () if is_unclear => Answer::NotFound,
        () => Answer::Placed,
    };
    if answer == Answer::NotFound {
        placements.clear();
    }
    // surfaces find the place; of a trajectory that drifts, its pieces say how it lies best
    let mut found = best.placement();
    if answer == Answer::Placed
        && let Some(rigid) = drift::nearest_rigid(target, returns, &best.refined.pose)
    {
        let fits = target.fits(&rigid, &evenly(returns, COMPARED));
        found = Placement::of(rigid, share(&fits));
        placements = vec![found.clone()];
    }
    let slides_along = degenerate.filter(|_| answer == Answer::Slides).map(|axes| axes.weakest.to_array());
    Alignment {
        answer,
        sd: Some(Deviation::of(&best.refined)),
        misfit: misfit(target, returns, &found.scene_from_walk),
        best: Some(found),
        second_best,
        placements,
        slides_along,
    }
}

impl Alignment {
    fn nowhere() -> Self {
        Self {
            answer: Answer::NotFound,
            best: None,
            sd: None,
            second_best: None,
            placements: Vec::new(),
            slides_along: None,
            misfit: None,
        }
    }
}

impl Candidate {
    fn placement(&self) -> Placement {
        Placement::of(self.refined.pose, self.share)
    }

    /// Against another, return by return.
    fn against(&self, other: &Self) -> SecondBest {
        let count = self.fits.len();
        let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
        let (only_best, only_second) = (only(&self.fits, &other.fits), only(&other.fits, &self.fits));
        let of_block = |block: usize| {
            let part = block * count / BLOCKS..(block + 1) * count / BLOCKS;
            let (own, other) = (&self.fits[part.clone()], &other.fits[part]);
            (only(own, other) - only(other, own)) / own.len().max(1) as f64
        };
        let blocks: Vec<f64> = (0..BLOCKS).map(of_block).collect();
        let (mean, deviation) = mean_and_deviation(&blocks);
        let z = if deviation > 0.0 { mean / deviation * (BLOCKS as f64).sqrt() } else { 0.0 };
        SecondBest {
            placement: other.placement(),
            only_best: only_best / count.max(1) as f64,
            only_second: only_second / count.max(1) as f64,
            z,
        }
    }
}

/// The longest stretch of blocks that fit far worse than most.
fn misfit(target: &Target<'_>, returns: &[WalkReturn], pose: &Pose) -> Option<Misfit> {
    let returns = evenly(returns, COMPARED);
    let fits = target.fits(pose, &returns);
    let of = |block: usize| block * fits.len() / BLOCKS..(block + 1) * fits.len() / BLOCKS;
    let shares: Vec<f64> = (0..BLOCKS).map(|block| share(&fits[of(block)])).collect();
    let usual = median(&mut shares.clone())?;
    let is_bad = shares.iter().map(|share| *share < MISFIT * usual);
    let (mut longest, mut run) = (0..0, 0..0);
    for (block, is_bad) in is_bad.enumerate() {
        run = match is_bad {
            true if run.end == block => run.start..block + 1,
            true => block..block + 1,
            false => run,
        };
        if run.len() > longest.len() {
            longest = run.clone();
        }
    }
    let part = of(longest.start).start..if longest.is_empty() { 0 } else { of(longest.end - 1).end };
    let (first, last) = (returns[part.clone()].first()?, returns[part.clone()].last()?);
    let after_s = |time_ns: u64| (time_ns - returns[0].time_ns) as f64 * 1e-9;
    Some(Misfit {
        from_s: after_s(first.time_ns),
        to_s: after_s(last.time_ns),
        inlier_share: share(&fits[part]),
    })
}

fn share(fits: &[bool]) -> f64 {
    fits.iter().filter(|fits| **fits).count() as f64 / fits.len().max(1) as f64
}

/// Whether two placements of a walk lie apart, m and rad.
fn apart(a: &Pose, b: &Pose, middle_m: DVec3, [shift_m, turn_rad]: [f64; 2]) -> bool {
    a.transform_point(middle_m).distance(b.transform_point(middle_m)) > shift_m
        || a.rotation.angle_between(b.rotation) > turn_rad
}

#[cfg(test)]
mod tests;
