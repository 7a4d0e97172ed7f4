//! How much better than what was found any mount of one master could be: branch and bound over regions of mounts.
//!
//! In a region no rig sees more voxels than its mounts could see between them, nor fewer twice than what all of them
//! are certain to see ([`MountRegion`]); that bounds J. The region with the highest bound is cut in two until the work allowed
//! is done (Land, Doig 1960, doi:10.2307/1910129). Bounds fall slowly: a region of a millimetre and a hundredth of a degree
//! may still see almost every voxel.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicBool, Ordering as Memory};

use rayon::prelude::*;
use serde::Serialize;

use super::{MountProblem, SpaceError};
use crate::design::objective::Objective;
use crate::rig::{MountDeg, MountRegion};

/// Regions cut at once: the same on any number of threads.
const CUT_AT_ONCE: usize = 16;
/// How far a hit moves per radian of tilt, m: half the box. It says which side of a region is the longest.
const LEVER_M: f64 = 25.0;

/// What was proved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Certificate {
    /// No rig of one master scores above this.
    pub bound: f64,
    /// That less the score it was compared with.
    pub gap: f64,
    /// Regions that were bounded.
    pub regions: usize,
    /// Share of the space's volume in which nothing can beat that score.
    pub closed_share: f64,
}

struct Open {
    bound: f64,
    region: MountRegion,
    /// Of the whole.
    share: f64,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        let corner = |open: &Self| <[f64; 5]>::from(open.region.low);
        let places = corner(self).into_iter().zip(corner(other));
        let by_place = places.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
        self.bound.total_cmp(&other.bound).then(by_place.unwrap_or(Ordering::Equal))
    }
}

/// Bounds the rigs of one master in at most so many regions, or until `stop` is set; `best` is a score that was found.
/// Of a mixed rig only the first sensor type is bounded. None where `stop` came before the whole space was bounded once.
pub fn certify(
    problem: &MountProblem,
    best: f64,
    most_regions: usize,
    stop: &AtomicBool,
) -> Result<Option<Certificate>, SpaceError> {
    let whole = region(problem)?;
    let bound = |region: &MountRegion| bound(problem.objective(), region, problem.search().is_mirrored);
    // bounds of large regions say little and cost most: half of the work goes to even parts
    let mut parts = vec![whole];
    while 4 * parts.len() <= most_regions {
        parts = parts.iter().flat_map(cut).collect();
    }
    let share = 1.0 / parts.len() as f64;
    let (mut regions, mut open_share) = (parts.len(), 1.0);
    let unless_stopped = |region: &MountRegion| (!stop.load(Memory::Relaxed)).then(|| bound(region));
    let bounded: Option<Vec<f64>> = parts.par_iter().map(unless_stopped).collect();
    let Some(bounded) = bounded else { return Ok(None) };
    let mut open = BinaryHeap::new();
    for (region, bound) in parts.into_iter().zip(bounded) {
        if bound > best {
            open.push(Open { bound, region, share });
        } else {
            open_share -= share;
        }
    }
    while !stop.load(Memory::Relaxed) {
        let cuts = (most_regions.saturating_sub(regions) / 2).min(CUT_AT_ONCE);
        let mut halves = Vec::new();
        while halves.len() < 2 * cuts
            && let Some(next) = open.pop()
        {
            halves.extend(cut(&next.region).map(|half| (half, next.bound, next.share / 2.0)));
        }
        if halves.is_empty() {
            break;
        }
        regions += halves.len();
        // a part is no better than its whole, however the rounding goes
        let of_half = |(half, most, _): &(MountRegion, f64, f64)| {
            unless_stopped(half).map_or(*most, |bound| bound.min(*most))
        };
        let bounded: Vec<f64> = halves.par_iter().map(of_half).collect();
        for ((region, _, share), bound) in halves.into_iter().zip(bounded) {
            if bound > best {
                open.push(Open { bound, region, share });
            } else {
                open_share -= share;
            }
        }
    }
    let bound = open.peek().map_or(best, |max| max.bound);
    Ok(Some(Certificate { bound, gap: bound - best, regions, closed_share: 1.0 - open_share }))
}

/// All mounts of one master, symmetries folded.
fn region(problem: &MountProblem) -> Result<MountRegion, SpaceError> {
    let space = problem.space()?.folded();
    let fixed = problem.search().fixed_roll_deg;
    let corner = |side: fn(&super::Variable) -> f64| {
        let mut values = [0.0; 5];
        for (value, variable) in values.iter_mut().zip(&space.variables()[1..]) {
            *value = side(variable);
        }
        // with a fixed roll the fifth variable is another master's
        values[4] = fixed.unwrap_or(values[4]);
        MountDeg::from(values)
    };
    Ok(MountRegion { low: corner(|v| v.low), high: corner(|v| v.high) })
}

/// Both halves across the side along which hits move farthest.
fn cut(region: &MountRegion) -> [MountRegion; 2] {
    let (low, high) = (<[f64; 5]>::from(region.low), <[f64; 5]>::from(region.high));
    let length_m = |side: usize| {
        let width = high[side] - low[side];
        if side < 3 { width } else { width.to_radians() * LEVER_M }
    };
    let longest = (1..5).fold(0, |best, side| if length_m(side) > length_m(best) { side } else { best });
    let middle = 0.5 * (low[longest] + high[longest]);
    let (mut below, mut above) = (high, low);
    (below[longest], above[longest]) = (middle, middle);
    [
        MountRegion { low: region.low, high: below.into() },
        MountRegion { low: above.into(), high: region.high },
    ]
}

/// What no rig of a region can exceed.
fn bound(objective: &Objective, region: &MountRegion, is_mirrored: bool) -> f64 {
    let (simulator, weights) = (objective.simulator(), objective.weights());
    let count =
        |words: &mut dyn Iterator<Item = u64>| words.map(|w| u64::from(w.count_ones())).sum::<u64>() as f64;
    let one = simulator.reach(region);
    let rewards = weights.best_registration_term();
    if !is_mirrored {
        let most = count(&mut one.possible.iter().copied());
        return most + weights.overlap_term(0.0) + weights.angular_term(None) - objective.prices()[0]
            + rewards;
    }
    let other = simulator.reach(&region.mirrored());
    let either = |a: &[u64], b: &[u64]| count(&mut a.iter().zip(b).map(|(a, b)| a | b));
    let both = |a: &[u64], b: &[u64]| count(&mut a.iter().zip(b).map(|(a, b)| a & b));
    let most_seen = either(&one.possible, &other.possible).max(1.0);
    let least_seen = either(&one.certain, &other.certain).max(1.0);
    let each = count(&mut one.certain.iter().copied()) + count(&mut other.certain.iter().copied());
    let least_twice = both(&one.certain, &other.certain).max(each - most_seen);
    let most_twice = both(&one.possible, &other.possible);
    let (low, high) = (least_twice / most_seen, (most_twice / least_seen).min(1.0));
    // the term rises, has a step up and a step down, and falls: within a range its maximum is at an end or in the window
    let window =
        (low <= weights.overlap_max && high >= weights.overlap_min).then_some(weights.overlap_reward);
    let overlap = [weights.overlap_term(low), weights.overlap_term(high)].into_iter().chain(window);
    let overlap = overlap.fold(f64::NEG_INFINITY, f64::max);
    let angular = weights.angular_term(Some(widest_deg(region.low.pitch_deg, region.high.pitch_deg)));
    most_seen + overlap + angular - 2.0 * objective.prices()[0] + rewards
}

/// The maximum angle between the spin axes of a pair with a pitch in this range, degrees: twice the pitch, and what
/// is missing to a whole turn.
fn widest_deg(low_deg: f64, high_deg: f64) -> f64 {
    let apart = |pitch_deg: f64| {
        let twice = (2.0 * pitch_deg.abs()).rem_euclid(360.0);
        twice.min(360.0 - twice)
    };
    let upright = |pitch_deg: f64| low_deg <= pitch_deg && pitch_deg <= high_deg;
    if upright(90.0) || upright(-90.0) { 180.0 } else { apart(low_deg).max(apart(high_deg)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::design::optimize::KeepApart;
    use crate::rig::Path;

    fn problem(path: Path, mirror: bool) -> MountProblem {
        let objective = Objective::published("paper-vlp-16", |experiment| {
            (experiment.path, experiment.mirror, experiment.azimuths) = (path, mirror, 60);
        })
        .unwrap();
        MountProblem::new(objective, 1, KeepApart::None)
    }

    #[test]
    fn no_rig_of_a_region_exceeds_its_bound() {
        let mut rng = Rng::new(9, 0);
        for (path, mirror) in [(Path::Lateral, true), (Path::Forward, true), (Path::Forward, false)] {
            let problem = problem(path, mirror);
            let mut part = region(&problem).unwrap();
            for _ in 0..9 {
                part = cut(&part)[rng.below(2) as usize];
            }
            let most = bound(problem.objective(), &part, mirror);
            let [low, high] = [part.low, part.high].map(<[f64; 5]>::from);
            for _ in 0..5 {
                let inside: [f64; 5] = std::array::from_fn(|at| rng.between(low[at], high[at]));
                let score = problem.objective().evaluate(&[inside.into()]).unwrap().objective;
                assert!(score <= most, "{path:?}, mirror {mirror}: {inside:?} scores {score}, bound {most}");
            }
        }
    }

    #[test]
    fn work_lowers_the_bound_and_never_below_a_score() {
        let problem = problem(Path::Lateral, true);
        // as if it had been found: above what level sensors can reach
        let best = 30_000.0;
        let after = |regions, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| certify(&problem, best, regions, &AtomicBool::new(false)).unwrap().unwrap())
        };
        let (first, second) = (after(1, 1), after(33, 1));
        assert_eq!(second, after(33, 2), "the same on any number of threads");
        assert!(best <= second.bound && second.bound <= first.bound, "{first:?} {second:?}");
        let ceiling = problem.space().unwrap().ceiling().unwrap();
        assert!(second.bound < ceiling - 100.0, "{second:?} {ceiling}");
        assert!(second.closed_share > 0.1 && second.regions <= 33, "{second:?}");
    }

    #[test]
    fn axes_of_a_pair_are_apart_by_twice_the_pitch() {
        for (low, high, widest) in
            [(10.0, 20.0, 40.0), (-20.0, 5.0, 40.0), (80.0, 95.0, 180.0), (-120.0, -100.0, 160.0)]
        {
            assert_eq!(widest_deg(low, high), widest);
        }
    }
}
