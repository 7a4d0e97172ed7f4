//! Objectives that cannot choose.

use super::sampling::{objective, score};
use super::{Case, Measured};
use crate::base::statistics::index_of_max;
use crate::design::objective::Objective;
use crate::design::optimize::Kind;
use crate::rig::Path;
use crate::study::StudyError;
use crate::study::searches::SearchTask;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "saturation",
        about: "voxels so large that every mount sees all of them",
        measure: saturation,
    },
    Case {
        name: "one pair or two",
        about: "the price of a sensor at which two sensors and four score alike",
        measure: pairs_are_equal,
    },
];

fn saturation(quick: bool) -> Result<Measured, StudyError> {
    let coarse = Objective::published("paper-os1-64", |experiment| experiment.voxel_m = 2.5);
    let coarse = coarse.map_err(StudyError::of)?;
    let fine = objective("paper-os1-64", Path::Lateral)?;
    let pitches: Vec<f64> = (0..=90).step_by(if quick { 6 } else { 1 }).map(f64::from).collect();
    let alike = |objective: &Objective| -> Result<f64, StudyError> {
        let seen = |pitch: &f64| {
            let found = objective.evaluate_rig(&super::sampling::pair(objective, *pitch));
            found.map(|found| found.unique_voxels).map_err(StudyError::of)
        };
        let unions: Vec<u64> = pitches.iter().map(seen).collect::<Result<_, _>>()?;
        let most = unions.iter().max().copied().unwrap_or(0);
        Ok(100.0 * unions.iter().filter(|count| **count == most).count() as f64 / pitches.len() as f64)
    };
    let best = {
        let scores: Vec<f64> =
            pitches.iter().map(|pitch| score(&coarse, *pitch)).collect::<Result<_, _>>()?;
        pitches[index_of_max(&scores)]
    };
    let evaluation = coarse.evaluate_rig(&super::sampling::pair(&coarse, best)).map_err(StudyError::of)?;
    Ok(Measured::judge(
        alike(&coarse)?,
        "% of the pitches see as many voxels as the best",
        10.0,
        "where a tenth of all mounts is equal, coverage no longer chooses",
    )
    .happens(format!(
        "with voxels of {} m instead it is {:.1} %",
        fine.simulator().experiment().voxel_m,
        alike(&fine)?
    ))
    .says(evaluation.saturation()))
}

fn pairs_are_equal(quick: bool) -> Result<Measured, StudyError> {
    const TIMES: u64 = 5;
    let evaluations = if quick { 60 } else { 300 };
    let search = |lambda: f64, masters: [u32; 2], seed: u64| -> Result<(f64, usize), StudyError> {
        let task = SearchTask {
            lambda,
            masters,
            evaluations,
            as_published: false,
            ..SearchTask::published("stability", "paper-os1-64", Kind::Staged, seed)
        };
        let found = task.run()?;
        let j = crate::study::number(&found.row, "j").unwrap_or(f64::NAN);
        Ok((j, found.masters.len()))
    };
    // J without its price, of the best one pair and of the best two
    let ([one, _], [two, _]) = ([search(0.0, [1, 1], 1)?.0, 2.0], [search(0.0, [2, 2], 1)?.0, 4.0]);
    let equal_price = (two - one) / 2.0;
    let mut fours = 0;
    let mut worst = 0.0_f64;
    let best = (one - 2.0 * equal_price).max(two - 4.0 * equal_price);
    for seed in 1..=TIMES {
        let (j, masters) = search(equal_price, [1, 2], seed)?;
        fours += usize::from(masters == 2);
        worst = worst.max(100.0 * (best - j) / best);
    }
    Ok(Measured::judge(
        worst.max(0.0),
        "% of J lost at worst by a search that may choose",
        0.2,
        "where both are worth the same either may win, but none may be poor",
    )
    .happens(format!(
        "two and four are worth the same at {equal_price:.0} voxels; {fours} of {TIMES} seeds choose four sensors"
    ))
    .says(Some(format!("study sensor-count prints the price at which the count changes, {equal_price:.0} here"))))
}
