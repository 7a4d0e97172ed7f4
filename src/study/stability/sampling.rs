//! Rays in a pattern: what it misses, and what it makes of the best mount.

use super::{Case, Measured};
use crate::base::statistics::index_of_max;
use crate::design::fidelity::{BoxLadder, Rules, rank};
use crate::design::objective::Objective;
use crate::design::robustness::{Robustness, Tolerance};
use crate::rig::{MountDeg, Path, Rig};
use crate::study::StudyError;
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::{BoxScene, Scene};
use glam::DVec3;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "aliasing",
        about: "OS1-64 as published: 180 azimuths at the same places of every pose",
        measure: |quick| aliasing("paper-os1-64", Path::Lateral, quick),
    },
    Case {
        name: "aliasing, few beams",
        about: "VLP-16 as published, walking ahead",
        measure: |quick| aliasing("paper-vlp-16", Path::Forward, quick),
    },
    Case {
        name: "needle optimum",
        about: "the best pitch of the published sampling, to a tenth of a degree",
        measure: needle,
    },
    Case {
        name: "wall on voxel faces",
        about: "a wall in the plane between two layers of voxels, ranges with 2 cm of noise",
        measure: faces,
    },
];

/// An objective of a pair in a published experiment.
pub(super) fn objective(preset: &str, path: Path) -> Result<Objective, StudyError> {
    Objective::published(preset, |experiment| experiment.path = path).map_err(StudyError::of)
}

/// The mirrored pair of a pitch.
pub(super) fn pair(objective: &Objective, pitch_deg: f64) -> Rig {
    let master = MountDeg { x_m: 0.1, pitch_deg, ..MountDeg::default() };
    objective.rig(&[master])
}

/// Score of a pair.
pub(super) fn score(objective: &Objective, pitch_deg: f64) -> Result<f64, StudyError> {
    objective.score(&pair(objective, pitch_deg)).map_err(StudyError::of)
}

/// The same objective with ten times the azimuths, eight poses per metre and a free phase; a tenth of that in a hurry.
fn converged(objective: &Objective, quick: bool) -> Result<Objective, StudyError> {
    crate::study::searches::sampled(objective, if quick { (360, 4) } else { (1800, 8) })
}

/// What a choice among pitches may lose, % of J.
const MAX_LOST: f64 = 0.1;

fn aliasing(preset: &str, path: Path, quick: bool) -> Result<Measured, StudyError> {
    let published = objective(preset, path)?;
    let reference = converged(&published, quick)?;
    let pitches: Vec<f64> = (0..=90).step_by(if quick { 6 } else { 1 }).map(f64::from).collect();
    let line = |objective: &Objective| -> Result<Vec<f64>, StudyError> {
        pitches.iter().map(|pitch| score(objective, *pitch)).collect()
    };
    let (seen, truth) = (line(&published)?, line(&reference)?);
    let (chosen, best) = (index_of_max(&seen), index_of_max(&truth));
    let regret = |at: usize| 100.0 * (truth[best] - truth[at]) / truth[best];
    let pairs: Vec<Rig> = pitches.iter().map(|pitch| pair(&published, *pitch)).collect();
    let ladder = BoxLadder::new(&published).map_err(StudyError::of)?;
    let own_rays = published.simulator().experiment().rays_per_sensor() as f64 * 2.0;
    let rules = Rules { tolerance: 1e-3, rays_per_candidate: 10.0 * own_rays };
    let ranking = rank(&ladder, &pairs, &rules).map_err(StudyError::of)?;
    let ranking = ranking.ok_or_else(|| StudyError("no pitch to rank".into()))?;
    let auto = ranking.best;
    let points =
        pitches.iter().zip(seen.iter().zip(&truth)).map(|(pitch, (a, b))| [*pitch, 100.0 * (a - b) / b]);
    let says = format!(
        "--fidelity auto: {} degrees, which loses {:.3} %, J {:.0} ± {:.0}",
        pitches[auto],
        regret(auto),
        ranking.judged[auto].value,
        ranking.judged[auto].bound
    );
    Ok(Measured::judge(
        regret(chosen),
        "% of J lost by the pitch it prefers",
        MAX_LOST,
        "a tenth of what mounts within a servo's step of each other differ by",
    )
    .happens(format!(
        "prefers {} degrees, converged {} degrees; misses {:.1} to {:.1} % of J, more at some pitches than at others",
        pitches[chosen],
        pitches[best],
        -100.0 * seen.iter().zip(&truth).map(|(a, b)| (a - b) / b).fold(f64::NEG_INFINITY, f64::max),
        -100.0 * seen.iter().zip(&truth).map(|(a, b)| (a - b) / b).fold(f64::INFINITY, f64::min),
    ))
    // a word that leads astray is none
    .says((regret(auto) <= MAX_LOST).then_some(says))
    .line("pitch, degrees", "error of J, %", points.collect()))
}

fn needle(quick: bool) -> Result<Measured, StudyError> {
    let published = objective("paper-os1-64", Path::Lateral)?;
    let reference = converged(&published, quick)?;
    let step_deg = if quick { 0.5 } else { 0.1 };
    let pitches: Vec<f64> = (0..=(40.0 / step_deg) as u32).map(|n| 10.0 + step_deg * f64::from(n)).collect();
    let seen: Vec<f64> = pitches.iter().map(|pitch| score(&published, *pitch)).collect::<Result<_, _>>()?;
    let top = pitches[index_of_max(&seen)];
    let fall = |objective: &Objective| -> Result<f64, StudyError> {
        let [low, here, high] = [-0.5, 0.0, 0.5].map(|off| score(objective, top + off));
        let here = here?;
        Ok(100.0 * (here - low?.min(high?)) / here)
    };
    let (published_fall, true_fall) = (fall(&published)?, fall(&reference)?);
    let tolerance = Tolerance { position_m: 0.0, angle_deg: 0.5, free_phase: false };
    let draws = Robustness::new(&published, tolerance, 32, 1).map_err(StudyError::of)?;
    let spread = draws.spread(&pair(&published, top)).map_err(StudyError::of)?;
    let points = pitches.iter().zip(&seen).map(|(pitch, j)| [*pitch, *j]).collect();
    Ok(Measured::judge(
        (published_fall - true_fall).max(0.0),
        "% of J that half a degree takes from the peak and truth does not",
        0.1,
        "a peak narrower than the rig's tolerance is one of the pattern, not of the mount",
    )
    .happens(format!(
        "peak at {top:.1} degrees; half a degree off it J is {published_fall:.2} % lower, under the converged model {true_fall:.2} %"
    ))
    .says(Some(format!(
        "--robust expected --tolerance 0,0.5: {:.0} in the mean (sd {:.0}, least {:.0}) where the peak says {:.0}",
        spread.mean, spread.deviation, spread.worst, score(&published, top)?
    )))
    .line("pitch, degrees", "J, published sampling", points))
}

/// How much a wall's count of cells grows with noise, on a grid with faces in the wall and on one that is centred
/// on it.
fn faces(_quick: bool) -> Result<Measured, StudyError> {
    const VOXEL_M: f64 = 0.5;
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-5.0, -5.0, 0.0), DVec3::new(5.0, 5.0, 3.0)));
    let bounds_m = scene.bounds_m();
    let centred = VoxelGrid::centred_on(bounds_m, VOXEL_M);
    let on_faces = VoxelGrid { origin_m: bounds_m[0] - VOXEL_M, cells: [22, 22, 8], ..centred.clone() };
    let grows = |grid: &VoxelGrid| {
        let count = |noise_m: f64| {
            let mut coverage = Coverage::new(grid.clone(), 1);
            let mut rng = crate::base::rng::Rng::new(1, 0);
            let from_m = DVec3::new(0.1, 0.2, 1.4);
            for _ in 0..200_000 {
                let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                if let Some(hit) = scene.cast(from_m, direction) {
                    coverage.add(0, from_m + (hit.distance_m + noise_m * rng.normal()) * direction);
                }
            }
            coverage.union_count() as f64
        };
        let [clean, noisy] = [0.0, 0.02].map(count);
        100.0 * (noisy - clean) / clean
    };
    let (ours, other) = (grows(&centred), grows(&on_faces));
    Ok(Measured::judge(
        ours.abs(),
        "% more cells by 2 cm of noise",
        2.0,
        "noise of a twentieth of a voxel must not add surface",
    )
    .happens(format!(
        "on a grid with faces in the walls the same noise adds {other:.0} %: predict and compare centre their cells on flat walls"
    )))
}
