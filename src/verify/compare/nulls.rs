//! What a recording would look like if nothing were wrong with it: the mount is nominal, the trajectory off by what
//! trajectories are off by. Where the recording stands among such runs is its p-value; how often a patch is covered in
//! them is the chance that it is.

use rayon::prelude::*;

use super::{Patches, PlacedRay, RayClass, RecordedRay};
use crate::base::rng::Rng;
use crate::rig::MountedSensor;
use crate::world::scene::Scene;
use crate::world::trajectory::{PoseError, Trajectory};

/// A ray that ends this far from where it should met something else, m: poses and mounts are not off by so much.
const FAR_OFF_M: f64 = 0.5;
/// Bins of the calibration curve.
const BINS: usize = 10;

/// What is assumed about a healthy recording.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Healthy {
    /// Of the trajectory.
    pub pose: PoseError,
    /// Standard deviation of a range, m.
    pub range_sd_m: f64,
    /// Share of returns that are lost at random.
    pub drop_out: f64,
    /// Simulated runs.
    pub runs: usize,
    /// Of all of it.
    pub seed: u64,
}

impl Default for Healthy {
    fn default() -> Self {
        Self { pose: PoseError::default(), range_sd_m: 0.02, drop_out: 0.05, runs: 19, seed: 1 }
    }
}

impl Healthy {
    /// The least p value that so many runs can give.
    pub(crate) fn least_p_value(&self) -> f64 {
        1.0 / (1.0 + self.runs as f64)
    }
}

/// Where a recording stands among healthy runs.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct NullTest {
    /// What was assumed.
    pub healthy: Healthy,
    /// Rays of each run.
    pub rays: usize,
    /// IoU of the patches of these rays, of the recording; none without a prediction.
    pub iou: Option<f64>,
    /// Share of the rays that agree, of the recording.
    pub agree_share: Option<f64>,
    /// Mean and least IoU of the healthy runs.
    pub iou_of_runs: Option<[f64; 2]>,
    /// Mean and least share of agreeing rays of the healthy runs.
    pub agree_share_of_runs: Option<[f64; 2]>,
    /// How often healthy runs agree no better, by IoU: (1 + count) / (1 + runs).
    pub p_value: Option<f64>,
    /// The same by share of agreeing rays.
    pub agree_p_value: Option<f64>,
    /// Of the patches that no healthy run misses, the share that the recording misses; none without runs or patches. A patch is
    /// missed when most of its rays return nothing or end far from it: wrong poses hardly do that, hidden surface does.
    pub missed_share: Option<f64>,
    /// The same of the healthy runs, each held against all others: mean and most.
    pub missed_share_of_runs: Option<[f64; 2]>,
    /// How often healthy runs miss as much.
    pub missed_p_value: Option<f64>,
    /// Chance of every patch against what came of it.
    pub calibration: Calibration,
}

/// Predicted chance of being covered against the share that was.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Calibration {
    /// Mean squared difference of chance and outcome; none without patches.
    pub brier: Option<f64>,
    /// Mean chance, share covered and number of patches of every tenth of chance that has any.
    pub curve: Vec<[f64; 3]>,
}

/// The rays and all that is needed to cast them.
#[derive(Clone, Copy)]
pub struct Field<'a> {
    /// What they are cast into.
    pub scene: &'a Scene,
    /// As recorded.
    pub trajectory: &'a Trajectory,
    /// With the models of their packets.
    pub sensors: &'a [MountedSensor],
    /// In order of time.
    pub rays: &'a [RecordedRay],
    /// A recorded and a predicted range agree within this, m.
    pub agree_within_m: f64,
}

/// A ray's prediction.
struct Foreseen {
    range_m: Option<f64>,
    patch: Option<u32>,
}

/// Outcome of one run: by patch whether it is covered or missed, and the share of agreeing rays.
struct Run {
    covered: Vec<bool>,
    missed: Vec<bool>,
    iou: Option<f64>,
    agree_share: Option<f64>,
}

impl NullTest {
    /// Simulates healthy runs and puts the recording among them; `progress` is called for each.
    pub(crate) fn run(field: &Field<'_>, patches: &Patches, healthy: Healthy, progress: impl Fn()) -> Self {
        let foreseen: Vec<Foreseen> = field.rays.par_iter().map(|ray| field.foresee(ray, patches)).collect();
        let recorded: Vec<Option<f64>> = field.rays.iter().map(|ray| ray.range_m).collect();
        let actual = judge(field, &foreseen, &recorded, patches.len());
        let runs: Vec<Run> = (0..healthy.runs as u64)
            .map(|run| {
                let simulated = simulate(field, healthy, healthy.seed.wrapping_add(run));
                let run = judge(field, &foreseen, &simulated, patches.len());
                progress();
                run
            })
            .collect();
        let among = |value: Option<f64>, of: fn(&Run) -> Option<f64>| {
            standing(
                value,
                &runs.iter().filter_map(of).collect::<Vec<_>>(),
                |other, value| other <= value,
                f64::min,
            )
        };
        let (p_value, iou_of_runs) = among(actual.iou, |run| run.iou);
        let (agree_p_value, agree_share_of_runs) = among(actual.agree_share, |run| run.agree_share);
        let foreseen_patches = touched(&foreseen, patches.len());
        let (missed_share, missed_of_runs) = missed_shares(&foreseen_patches, &runs, &actual);
        let (missed_p_value, missed_share_of_runs) =
            standing(missed_share, &missed_of_runs, |other, missed| other >= missed, f64::max);
        Self {
            healthy,
            rays: field.rays.len(),
            iou: actual.iou,
            agree_share: actual.agree_share,
            iou_of_runs,
            agree_share_of_runs,
            p_value,
            agree_p_value,
            missed_share,
            missed_share_of_runs,
            missed_p_value,
            calibration: Calibration::of(&foreseen_patches, &runs, &actual),
        }
    }
}

/// How often healthy runs are no better than the recording, with their mean and the worst of them.
fn standing(
    value: Option<f64>,
    of_runs: &[f64],
    is_no_better: fn(f64, f64) -> bool,
    worse: fn(f64, f64) -> f64,
) -> (Option<f64>, Option<[f64; 2]>) {
    let Some(worst) = of_runs.iter().copied().reduce(worse) else { return (None, None) };
    let p_value = value.map(|value| {
        let no_better = of_runs.iter().filter(|other| is_no_better(**other, value)).count();
        (1 + no_better) as f64 / (1 + of_runs.len()) as f64
    });
    (p_value, Some([of_runs.iter().sum::<f64>() / of_runs.len() as f64, worst]))
}

/// Of the patches that no healthy run misses, the share that the recording misses; and the same for each run, held against all others.
fn missed_shares(foreseen: &[bool], runs: &[Run], actual: &Run) -> (Option<f64>, Vec<f64>) {
    if runs.is_empty() {
        return (None, Vec::new());
    }
    let patches: Vec<usize> = (0..foreseen.len()).filter(|patch| foreseen[*patch]).collect();
    let counts: Vec<usize> =
        patches.iter().map(|patch| runs.iter().filter(|run| run.missed[*patch]).count()).collect();
    let share = |run: &Run, is_counted: bool| {
        let (mut sure, mut missed) = (0_u64, 0_u64);
        for (patch, count) in patches.iter().zip(&counts) {
            let is_missed = run.missed[*patch];
            if count - usize::from(is_counted && is_missed) == 0 {
                sure += 1;
                missed += u64::from(is_missed);
            }
        }
        (sure > 0).then(|| missed as f64 / sure as f64)
    };
    (share(actual, false), runs.iter().filter_map(|run| share(run, true)).collect())
}

impl Calibration {
    fn of(foreseen: &[bool], runs: &[Run], actual: &Run) -> Self {
        if runs.is_empty() {
            return Self::default();
        }
        let mut bins = [[0.0; 3]; BINS];
        let (mut squares, mut count) = (0.0, 0.0);
        for patch in (0..foreseen.len()).filter(|patch| foreseen[*patch]) {
            let chance = runs.iter().filter(|run| run.covered[patch]).count() as f64 / runs.len() as f64;
            let outcome = f64::from(u8::from(actual.covered[patch]));
            squares += (chance - outcome) * (chance - outcome);
            count += 1.0;
            let bin = &mut bins[((chance * BINS as f64) as usize).min(BINS - 1)];
            *bin = [bin[0] + chance, bin[1] + outcome, bin[2] + 1.0];
        }
        let curve =
            bins.iter().filter(|bin| bin[2] > 0.0).map(|bin| [bin[0] / bin[2], bin[1] / bin[2], bin[2]]);
        Self { brier: (count > 0.0).then_some(squares / count), curve: curve.collect() }
    }
}

impl Field<'_> {
    /// A ray where the nominal mount and the trajectory put it; none outside the trajectory's time.
    pub(super) fn place(&self, ray: &RecordedRay) -> Option<PlacedRay> {
        ray.place_on(self.sensors, self.trajectory, ray.time_ns)
    }

    fn foresee(&self, ray: &RecordedRay, patches: &Patches) -> Foreseen {
        let nothing = Foreseen { range_m: None, patch: None };
        let Some(placed) = self.place(ray) else { return nothing };
        let Some((range_m, normal)) = placed.cast(self.scene, &self.sensors[ray.sensor]) else {
            return nothing;
        };
        let patch = patches.patch_at(placed.at_range(range_m), normal, self.scene);
        Foreseen { range_m: Some(range_m), patch: patch.map(|patch| patch as u32) }
    }
}

/// Ranges that a healthy rig would have recorded.
fn simulate(field: &Field<'_>, healthy: Healthy, seed: u64) -> Vec<Option<f64>> {
    let true_trajectory =
        healthy.pose.disturb_near(field.trajectory, seed, field.rays.iter().map(|ray| ray.time_ns));
    let rays = field.rays.par_iter().enumerate();
    rays.map(|(number, ray)| {
        let mut rng = Rng::new(seed, number as u64);
        let is_recorded = rng.uniform() >= healthy.drop_out;
        let noise_m = healthy.range_sd_m * rng.normal();
        let placed = ray.place_on(field.sensors, &true_trajectory, ray.time_ns)?;
        let (range_m, _) = placed.cast(field.scene, &field.sensors[ray.sensor])?;
        is_recorded.then_some(range_m + noise_m)
    })
    .collect()
}

/// A patch is covered by a run when at least half of the rays that should end there do.
fn judge(field: &Field<'_>, foreseen: &[Foreseen], recorded: &[Option<f64>], patches: usize) -> Run {
    let is_map = matches!(field.scene, Scene::Voxels(_));
    let mut tally = vec![[0u32; 3]; patches];
    let (mut agree, mut informative) = (0u64, 0u64);
    for ((foreseen, recorded), ray) in foreseen.iter().zip(recorded).zip(field.rays) {
        let end_m = |range_m| field.place(ray).map(|placed| placed.at_range(range_m));
        let class = RayClass::in_scene(field.scene, foreseen.range_m, *recorded, field.agree_within_m, end_m);
        informative += u64::from(class != RayClass::Nothing);
        agree += u64::from(class == RayClass::Agree);
        if let Some(patch) = foreseen.patch {
            tally[patch as usize][0] += 1;
            tally[patch as usize][1] += u32::from(class == RayClass::Agree);
            let is_far_off = foreseen.range_m.zip(*recorded).is_none_or(|(foreseen_m, recorded_m)| {
                let late_m = recorded_m - foreseen_m;
                // past the edge of a map's cell a ray goes on
                late_m < -FAR_OFF_M || (late_m > FAR_OFF_M && !is_map)
            });
            tally[patch as usize][2] += u32::from(is_far_off);
        }
    }
    let covered: Vec<bool> = tally.iter().map(|[all, agree, _]| *agree > 0 && 2 * agree >= *all).collect();
    let missed = tally.iter().map(|[all, _, far_off]| 2 * far_off > *all).collect();
    let predicted = tally.iter().filter(|[all, ..]| *all > 0).count();
    let both = covered.iter().filter(|covered| **covered).count();
    Run {
        covered,
        missed,
        iou: (predicted > 0).then(|| both as f64 / predicted as f64),
        agree_share: (informative > 0).then(|| agree as f64 / informative as f64),
    }
}

fn touched(foreseen: &[Foreseen], patches: usize) -> Vec<bool> {
    let mut touched = vec![false; patches];
    foreseen.iter().filter_map(|foreseen| foreseen.patch).for_each(|patch| touched[patch as usize] = true);
    touched
}
