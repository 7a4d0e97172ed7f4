//! What a score rests on, and in what it differs from what another one rested on.

use super::prices::Prices;
use crate::design::objective::Objective;
use crate::rig::{FoundWith, MountFile};
use crate::simulate::published::Preset;

/// What a score by this objective rests on.
pub fn found_with(objective: &Objective) -> FoundWith {
    let experiment = objective.simulator().experiment();
    FoundWith {
        path: experiment.path,
        voxel_m: experiment.voxel_m,
        azimuths: experiment.azimuths,
        sub_poses: experiment.sub_poses,
        phase: experiment.phase,
        lambda: objective.prices().to_vec(),
        registration_weight: objective.weights().registration,
        least_conditioning: objective.weights().least_conditioning,
        least_distance_m: objective.least_distance_m(),
    }
}

/// Whether two lists of presets, with commas between them, name the same ones: their order says nothing.
pub fn are_same_presets(one: &str, other: &str) -> bool {
    let sorted = |names: &str| {
        let mut names: Vec<_> = names.split(',').map(|name| name.trim().to_owned()).collect();
        names.sort();
        names
    };
    sorted(one) == sorted(other)
}

/// The price of a sensor of each of these presets, by model in alphabetical order.
pub fn prices(presets: &str, lambda: &[f64]) -> Vec<(String, f64)> {
    let model = |name: &str| Preset::named(name.trim()).ok().map(|preset| preset.model.to_owned());
    let models = presets.split(',').filter_map(model);
    let mut prices: Vec<_> = models.zip(lambda.iter().copied()).collect();
    prices.sort_by(|a, b| a.0.cmp(&b.0));
    prices
}

/// Every setting of a mount file's score that is another one now, by its flag, with both values.
pub fn differences(file: &MountFile, objective: &Objective) -> Vec<String> {
    let now = found_with(objective);
    let name = objective.simulator().experiment().name();
    let mut pairs = Vec::new();
    let is_same_rig = file.preset.as_ref().is_none_or(|then| are_same_presets(then, &name));
    if let Some(then) = file.preset.as_ref().filter(|_| !is_same_rig) {
        pairs.push(("--preset", then.clone(), name.clone()));
    }
    if let Some(then) = file.found_with.as_deref() {
        pairs.extend([
            ("--path", then.path.name().to_owned(), now.path.name().to_owned()),
            ("--voxel", then.voxel_m.to_string(), now.voxel_m.to_string()),
            ("--azimuths", then.azimuths.to_string(), now.azimuths.to_string()),
            ("--sub-poses", then.sub_poses.to_string(), now.sub_poses.to_string()),
            ("--phase", then.phase.name().to_owned(), now.phase.name().to_owned()),
            (
                "--registration-weight",
                then.registration_weight.to_string(),
                now.registration_weight.to_string(),
            ),
            ("--min-conditioning", then.least_conditioning.to_string(), now.least_conditioning.to_string()),
            ("--least-distance", then.least_distance_m.to_string(), now.least_distance_m.to_string()),
        ]);
        if let Some(presets) = file.preset.as_ref().filter(|_| is_same_rig) {
            let [then, now] = [prices(presets, &then.lambda), prices(&name, &now.lambda)];
            pairs.push(("--lambda", Prices::ByModel(then).to_string(), Prices::ByModel(now).to_string()));
        }
    }
    let differs = |(flag, then, now): (&str, String, String)| {
        (then != now).then(|| format!("{flag} {then} (here {now})"))
    };
    pairs.into_iter().filter_map(differs).collect()
}
