//! Searches from other random beginnings.

use super::{Case, Measured};
use crate::base::statistics::mean_and_deviation;
use crate::design::optimize::Kind;
use crate::design::robustness::{Robustness, Tolerance};
use crate::study::StudyError;
use crate::study::searches::SearchTask;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "seeds, default method",
        about: "the default search with 80 evaluations from other random numbers",
        measure: |quick| seeds(Kind::Staged, quick),
    },
    Case {
        name: "seeds, particle swarm",
        about: "a swarm of 60 with 300 evaluations: five rounds",
        measure: |quick| seeds(Kind::ParticleSwarm, quick),
    },
];

fn seeds(method: Kind, quick: bool) -> Result<Measured, StudyError> {
    let evaluations = if method == Kind::Staged { 80 } else { 300 };
    let mut found = Vec::new();
    for seed in 1..=if quick { 3 } else { 20 } {
        let task = SearchTask {
            evaluations,
            as_published: false,
            ..SearchTask::published("stability", "paper-os1-64", method, seed)
        };
        found.push(task.run()?);
    }
    let scores: Vec<f64> = found.iter().filter_map(|found| crate::study::number(&found.row, "j")).collect();
    let (mean, sd) = mean_and_deviation(&scores);
    let worst = scores.iter().copied().fold(f64::INFINITY, f64::min);
    let first = &found[0];
    let rig = first.objective.rig(&first.masters);
    let tolerance = Tolerance { position_m: 0.01, angle_deg: 1.0, free_phase: true };
    let built = Robustness::new(&first.objective, tolerance, 64, 1).map_err(StudyError::of)?;
    let built = built.spread(&rig).map_err(StudyError::of)?;
    Ok(Measured::judge(
        sd / built.deviation,
        "times the spread of a rig built to 1 cm and 1 degree is what seeds differ by",
        1.0,
        "seeds must not matter more than what the workshop does",
    )
    .happens(format!(
        "over {} seeds J is {mean:.0}, sd {sd:.1}, worst {worst:.0}; as built sd {:.1}",
        scores.len(),
        built.deviation
    ))
    .says(Some("study methods states quartiles over seeds for every method and budget".into())))
}
