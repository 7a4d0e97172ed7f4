//! How much a search does: its evaluations by the model and by rays, and which beams are cast.

use super::built::BuildErrors;
use super::is_of_few_channels;
use crate::design::registration::surroundings::Surroundings;
use crate::rig::Rig;
use crate::simulate::view::CastSites;

/// Where an exact evaluation casts fewer rays than this, so many are early, correct the model in all, come amid the second search,
/// judge finalists and climb from the best of these. In small rooms they are cheap or the model is good; of large ones it has more to
/// learn, until time binds.
const EXACT: [(u64, [usize; 5]); 6] = [
    (3_000_000, [0, 16, 6, 20, 0]),
    (8_000_000, [8, 14, 0, 4, 14]),
    (16_000_000, [8, 14, 6, 4, 26]),
    (25_000_000, [8, 14, 6, 4, 10]),
    (32_000_000, [8, 12, 0, 2, 16]),
    (u64::MAX, [8, 12, 0, 2, 5]),
];
/// One in so many mounts more than asked for is looked at around those cast.
const AROUND: usize = 8;
/// Steps of sixteen that a local search aims at the top of a quadratic; second where exact evaluations are so cheap that many finalists
/// decide, which had better differ.
const AIMED: [usize; 2] = [4, 0];
/// Mounts that the model looks at again; second where many exact evaluations need fewer good guesses.
const AGAIN: [[usize; 3]; 2] = [[48, 112, 32], [40, 96, 24]];
/// A thinned view casts at most so many rays of a rig, but one beam in so many at least and so many rays for each voxel that can
/// be seen, the second number of them where the first takes more than so many rays; second that of sensors of few channels, whose gaps many
/// revolutions have to fill. Thinner views count the density of beams, not what is seen.
const THINNEST: [(u64, u32, [u64; 2]); 2] = [(4_000_000, 16, [80, 40]), (8_000_000, 4, [48, 24])];
const MANY_RAYS: u64 = 45_000_000;
/// Finalists of a thinned view whose beams are all cast: the second where each casts more than so many rays, the third where
/// more than so many.
const WHOLE: [usize; 3] = [3, 2, 1];
const RAYS_OF_WHOLE: [u64; 2] = [60_000_000, 200_000_000];

/// How many evaluations there are, and of which kind.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub(crate) struct Plan {
    pub seed: u64,
    /// By the model, before the climb.
    pub evaluations: usize,
    /// Of these, spread over the space.
    pub spread: usize,
    /// And in local searches before the correction.
    pub local: usize,
    /// Exact evaluations by which the model is corrected.
    pub correcting: usize,
    /// So many of these come before the first local search: in large scenes the model alone leads it astray.
    pub early: usize,
    /// Of the best ones within the second local search, which correct the model where the search has arrived.
    pub amid: usize,
    /// Exact evaluations of finalists, in two rounds.
    pub finalists: usize,
    /// Exact evaluations around the best judged mounts.
    pub climbing: usize,
    /// More looks by the model around these, at most.
    pub around: usize,
    /// Mounts that the model looks at again by all voxels: after the spread, after the first local search, after each later one.
    pub again: [usize; 3],
    /// Steps of sixteen that a local search aims at the top of a quadratic through good mounts.
    pub aimed: usize,
    /// Which part of the beams is cast until then, 1 in so many; all beams of the best finalists are.
    pub thinning: u32,
    /// So many of them, where beams are thinned.
    pub whole: usize,
    /// Errors of building that are reckoned with.
    pub errors: BuildErrors,
}

impl Plan {
    /// A quarter spread, a half local, the rest after the correction.
    pub(crate) fn new(
        evaluations: usize,
        seed: u64,
        rays_of_whole: u64,
        thinning: u32,
        errors: BuildErrors,
    ) -> Self {
        let rays = rays_of_whole / u64::from(thinning);
        let class = EXACT.iter().position(|(below, _)| rays < *below).unwrap_or(EXACT.len() - 1);
        let [early, correcting, amid, finalists, climbing] = EXACT[class].1;
        Self {
            seed,
            evaluations,
            spread: (evaluations / 4).clamp(1, 256),
            local: evaluations * 11 / 20,
            early,
            correcting: correcting.min(evaluations),
            amid: amid.min(evaluations),
            finalists: finalists.min(evaluations),
            climbing: climbing.min(evaluations),
            around: if climbing > 0 { evaluations / AROUND } else { 0 },
            again: AGAIN[usize::from(class == 0)],
            aimed: AIMED[usize::from(class == 0)],
            thinning,
            whole: WHOLE[RAYS_OF_WHOLE.iter().filter(|rays| rays_of_whole > **rays).count()],
            errors,
        }
    }
}

/// What casts the beams of rigs.
pub(crate) struct Judges {
    pub cast: CastSites,
    /// With the beams that judge while searching, where these are not all.
    pub thinned: Option<CastSites>,
    /// One beam in so many is among them.
    pub thinning: u32,
    /// By which the model judges registration, where it counts.
    pub surroundings: Option<Surroundings>,
}

impl Judges {
    pub(super) fn while_searching(&self) -> &CastSites {
        self.thinned.as_ref().unwrap_or(&self.cast)
    }
}

/// One in how many beams of rigs like this one is cast while searching where so many voxels can be seen.
pub(super) fn thinning(cast: &CastSites, rig: &Rig, observable: u64) -> u32 {
    let (most_rays, most, rays_of_voxel) = THINNEST[usize::from(is_of_few_channels(rig))];
    let rays = cast.rays(rig);
    let is_dense = |thinning: u32| {
        let many = rays / u64::from(thinning) > MANY_RAYS;
        rays / u64::from(2 * thinning) >= rays_of_voxel[usize::from(many)] * observable
    };
    let mut thinning = 1;
    while rays / u64::from(thinning) > most_rays && thinning < most && is_dense(thinning) {
        thinning *= 2;
    }
    thinning
}
