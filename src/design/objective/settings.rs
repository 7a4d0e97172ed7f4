//! The settings of a score, and in what they differ from those of another one.

use super::{Objective, Prices, prices_by_model};
use crate::rig::{FoundWith, MountDeg, MountFile, SensorEntry};

impl Objective {
    /// The settings of a score by this objective.
    pub(crate) fn settings(&self) -> FoundWith {
        let experiment = self.simulator().experiment();
        FoundWith {
            path: experiment.path,
            voxel_m: experiment.voxel_m,
            azimuths: experiment.azimuths,
            sub_poses: experiment.sub_poses,
            phase: experiment.phase,
            lambda: self.prices().to_vec(),
            registration_weight: self.weights().registration,
            least_conditioning: self.weights().least_conditioning,
            least_distance_m: self.least_distance_m(),
        }
    }
}

/// A sensor that the experiment does not simulate.
#[derive(Debug, thiserror::Error)]
#[error(
    "sensor {name:?} is a {model}, but preset {preset} simulates {simulated}: give the preset of that sensor, or of a \
     mixed rig those of all its sensors with commas between them"
)]
pub(crate) struct OtherSensor {
    name: String,
    model: String,
    preset: String,
    simulated: String,
}

impl Objective {
    /// The sensors of a mount file as they are listed.
    pub(crate) fn listed(&self, file: &MountFile) -> Result<Vec<MountDeg>, OtherSensor> {
        let experiment = self.simulator().experiment();
        let models = experiment.models();
        let mount = |sensor: &SensorEntry| {
            let SensorEntry { x_m, y_m, z_m, pitch_deg, roll_deg, .. } = *sensor;
            let sensor_type = models.iter().position(|model| sensor.model.eq_ignore_ascii_case(model));
            let sensor_type = sensor_type.ok_or_else(|| OtherSensor {
                name: sensor.name.clone(),
                model: sensor.model.clone(),
                preset: experiment.name(),
                simulated: models.join(" and "),
            })?;
            Ok(MountDeg { sensor_type, ..MountDeg::from([x_m, y_m, z_m, pitch_deg, roll_deg]) })
        };
        file.sensors.iter().map(mount).collect()
    }
}

/// Whether two lists of presets, with commas between them, name the same ones: their order says nothing.
pub(crate) fn are_same_presets(one: &str, other: &str) -> bool {
    let sorted = |names: &str| {
        let mut names: Vec<_> = names.split(',').map(|name| name.trim().to_owned()).collect();
        names.sort();
        names
    };
    sorted(one) == sorted(other)
}

/// Why the score that a mount file states may be another one than is found here.
pub(crate) fn other_score(file: &MountFile, objective: &Objective, is_roll_replaced: bool) -> String {
    let mut differences = differences(file, objective);
    differences.extend(is_roll_replaced.then(|| "the rolls in it (here replaced)".to_owned()));
    match (differences.is_empty(), &file.found_with) {
        (false, _) => format!("found with {}", differences.join(", ")),
        (true, Some(_)) => "and was found with the settings of here: its sensors were changed since".into(),
        (true, None) => {
            "and not with which --path, --voxel, --azimuths, --sub-poses, --phase, --lambda ... that was \
                         found: they were others than here, or its sensors were changed since"
                .into()
        }
    }
}

/// Every setting of a mount file's score that is another one now, by its flag, with both values.
fn differences(file: &MountFile, objective: &Objective) -> Vec<String> {
    let now = objective.settings();
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
            let [then, now] = [prices_by_model(presets, &then.lambda), prices_by_model(&name, &now.lambda)];
            pairs.push(("--lambda", Prices::ByModel(then).to_string(), Prices::ByModel(now).to_string()));
        }
    }
    let differs = |(flag, then, now): (&str, String, String)| {
        (then != now).then(|| format!("{flag} {then} (here {now})"))
    };
    pairs.into_iter().filter_map(differs).collect()
}
