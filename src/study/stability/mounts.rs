//! Mounts at the end of what can be built, and built not quite as planned.

use super::sampling::{objective, pair, score};
use super::{Case, Measured};
use crate::base::statistics::{index_of_max, mean_and_deviation};
use crate::design::robustness::{Robustness, Tolerance};
use crate::rig::{MountDeg, Path};
use crate::study::StudyError;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "mounts on their side",
        about: "pitch of ±90 degrees: beams parallel to the walls' axes",
        measure: on_their_side,
    },
    Case {
        name: "two sensors in one place",
        about: "both masters at the same point with the same angles",
        measure: coincident,
    },
    Case {
        name: "tolerance, 1 cm and 1 degree",
        about: "every coordinate and angle of both sensors off at random, free phase",
        measure: |quick| tolerance(1.0, quick),
    },
    Case {
        name: "tolerance, 2 cm and 2 degrees",
        about: "the same with twice the errors",
        measure: |quick| tolerance(2.0, quick),
    },
];

fn on_their_side(_quick: bool) -> Result<Measured, StudyError> {
    let objective = objective("paper-vlp-16", Path::Lateral)?;
    let simulator = objective.simulator();
    let mut differing = 0;
    let mut seen = Vec::new();
    for pitch_deg in [-90.0, -89.999_999, 0.0, 89.999_999, 90.0] {
        let sensors = [MountDeg { x_m: 0.1, pitch_deg, ..MountDeg::default() }];
        let fast = simulator.cover(&sensors).map_err(StudyError::of)?;
        let exact = simulator.coverage_by_definition(&sensors).map_err(StudyError::of)?;
        let (fast, exact) = (fast.coverage.union(), exact.coverage.union());
        differing += fast.iter().zip(&exact).map(|(a, b)| (a ^ b).count_ones()).sum::<u32>();
        seen.push(exact.iter().map(|word| word.count_ones()).sum::<u32>());
    }
    Ok(Measured::judge(
        f64::from(differing),
        "voxels differ between the fast kernel and the definition",
        0.0,
        "a kernel that is exact elsewhere must be exact where its cases meet",
    )
    .happens(format!(
        "a VLP-16 sees {} voxels at -90, {} level, {} at +90 degrees; a millionth of a degree off them {} and {}",
        seen[0], seen[2], seen[4], seen[1], seen[3]
    )))
}

fn coincident(_quick: bool) -> Result<Measured, StudyError> {
    let objective = objective("paper-os1-64", Path::Lateral)?;
    let one = MountDeg { x_m: 0.1, pitch_deg: 30.0, ..MountDeg::default() };
    let evaluate =
        |sensors: &[MountDeg]| objective.evaluate_rig(&objective.mounted(sensors)).map_err(StudyError::of);
    let (single, twice) = (evaluate(&[one])?, evaluate(&[one, one])?);
    let gained = twice.unique_voxels as f64 - single.unique_voxels as f64;
    let says = twice.violations.first().map(|violation| violation.to_string());
    Ok(Measured::judge(
        if twice.feasible { 1.0 } else { 0.0 },
        "such rigs pass for buildable",
        0.0,
        "two housings cannot share a place",
    )
    .happens(format!(
        "the second sensor adds {gained:.0} voxels; overlap ratio {:.2}, angle between spin axes {:.0} degrees",
        twice.overlap_ratio,
        twice.min_angle_deg.unwrap_or(f64::NAN)
    ))
    .says(says))
}

fn tolerance(times: f64, quick: bool) -> Result<Measured, StudyError> {
    let objective = objective("paper-os1-64", Path::Lateral)?;
    let pitches: Vec<f64> = (0..=90).step_by(if quick { 6 } else { 1 }).map(f64::from).collect();
    let seen: Vec<f64> = pitches.iter().map(|pitch| score(&objective, *pitch)).collect::<Result<_, _>>()?;
    let best = pitches[index_of_max(&seen)];
    let draws = if quick { 40 } else { 400 };
    let of = |times: f64| -> Result<[f64; 3], StudyError> {
        let tolerance = Tolerance { position_m: 0.01 * times, angle_deg: times, free_phase: true };
        let robust = Robustness::new(&objective, tolerance, draws, 1).map_err(StudyError::of)?;
        let mut scores = robust.scores(&pair(&objective, best)).map_err(StudyError::of)?;
        scores.sort_by(f64::total_cmp);
        let (mean, sd) = mean_and_deviation(&scores);
        Ok([mean, sd, scores[draws / 20]])
    };
    let [mean, sd, p5] = of(times)?;
    let [half_mean, half_sd, half_p5] = of(times / 2.0)?;
    let lost = 100.0 * (mean - p5) / mean;
    let half_lost = 100.0 * (half_mean - half_p5) / half_mean;
    Ok(Measured::judge(
        lost,
        "% of J lost at the 5th percentile",
        0.5,
        "what the best pitch gains over one 5 degrees off it",
    )
    .happens(format!(
        "at {best} degrees J is {mean:.0} in the mean, sd {sd:.0}, p5 {p5:.0}; with half the errors sd {half_sd:.0} and {half_lost:.2} % lost"
    ))
    .says(Some(format!("--robust expected --tolerance {},{times}: {mean:.0}, sd {sd:.0}", 0.01 * times)))
    .gracefully(lost <= 4.0 * half_lost.max(0.05)))
}
