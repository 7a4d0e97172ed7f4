//! From a published experiment as typed to its objective.

use super::ExperimentArgs;
use crate::commands::{ensure_consistent, wrong_usage};
use crate::design::objective::{Objective, Prices, Weights, are_same_presets, prices_by_model};
use crate::rig::{MountFile, Roll};
use crate::simulate::published::{Experiment, ExperimentError, Preset, PublishedBox};

/// Most columns of a published experiment.
const MAX_COLUMNS: usize = 8192;

impl ExperimentArgs {
    /// What is not specified here comes from the score in a mount file; a mount found in another experiment than that which is
    /// asked for gives nothing.
    fn or_as_found(&self, file: &MountFile) -> Self {
        let asked = self.clone();
        let (Some(found), Some(names)) = (&file.found_with, &file.preset) else { return asked };
        if !self.preset.is_empty() && !are_same_presets(&self.preset.join(","), names) {
            return asked;
        }
        let prices = Prices::ByModel(prices_by_model(names, &found.lambda));
        Self {
            path: self.path.or(Some(found.path)),
            voxel: self.voxel.or(Some(found.voxel_m)),
            azimuths: self.azimuths.or(Some(found.azimuths)),
            sub_poses: self.sub_poses.or(Some(found.sub_poses)),
            phase: self.phase.or(Some(found.phase)),
            lambda: self.lambda.clone().or(Some(prices)),
            least_distance: self.least_distance.or(Some(found.least_distance_m)),
            registration_weight: self.registration_weight.or(Some(found.registration_weight)),
            min_conditioning: self.min_conditioning.or(Some(found.least_conditioning)),
            ..asked
        }
    }

    /// Weight of registration strength in J, and the least conditioning that is allowed.
    pub(crate) fn registration(&self) -> anyhow::Result<(f64, f64)> {
        let (weight, least_conditioning) =
            (self.registration_weight.unwrap_or(0.0), self.min_conditioning.unwrap_or(0.0));
        ensure_consistent([
            (
                !(weight.is_finite() && weight >= 0.0),
                format!("--registration-weight {weight}, expected a number of at least 0"),
            ),
            (
                !(0.0..1.0 / 3.0).contains(&least_conditioning),
                format!("--min-conditioning {least_conditioning}, expected at least 0 and below 1/3"),
            ),
        ])?;
        Ok((weight, least_conditioning))
    }

    /// The objective that was asked for; `roll` is the rule where none is given.
    pub(crate) fn objective(&self, roll: Roll) -> anyhow::Result<Objective> {
        self.made(None, roll).map_err(refused)
    }

    /// The same for the sensors of a mount file, which gives what is not specified here.
    pub(crate) fn objective_for(
        &self,
        file: &MountFile,
        path: &std::path::Path,
    ) -> anyhow::Result<Objective> {
        let is_silent = self.preset.is_empty()
            && self.voxel.is_none()
            && self.azimuths.is_none()
            && self.sub_poses.is_none();
        self.or_as_found(file).made(file.preset.as_deref(), Roll::Free).map_err(|error| match is_silent {
            true => error.context(format!("mount file {}", path.display())),
            false => refused(error),
        })
    }

    /// `otherwise` names presets (with commas) where none are given.
    fn made(&self, otherwise: Option<&str>, roll: Roll) -> anyhow::Result<Objective> {
        let given = self.preset.iter().map(String::as_str);
        let otherwise = otherwise.filter(|_| self.preset.is_empty());
        let names = given.chain(otherwise.iter().flat_map(|names| names.split(',')));
        let presets = names.map(|name| Preset::named(name.trim())).collect::<Result<Vec<_>, _>>()?;
        let Some(preset) = presets.first() else {
            refuse!(
                "where? Give --scene, --room, or a published experiment by --preset, one of {}",
                Preset::names()
            );
        };
        let columns = self.azimuths.unwrap_or(preset.azimuths);
        let words = format!("--azimuths {columns}, expected {MAX_COLUMNS} at most in a published experiment");
        ensure_consistent([(columns > MAX_COLUMNS, words)])?;
        let experiment = Experiment {
            path: self.path.unwrap_or_default(),
            voxel_m: self.voxel.unwrap_or(preset.voxel_m),
            azimuths: columns,
            roll: self.roll.map_or(roll, |rule| rule.0),
            mirror: !self.no_mirror,
            sub_poses: self.sub_poses.unwrap_or(1),
            phase: self.phase.unwrap_or_default(),
            ..Experiment::mixed(&presets)?
        };
        let least_distance_m = self.least_distance.unwrap_or(0.0);
        let (registration, least_conditioning) = self.registration()?;
        let prices = self.lambda.clone().unwrap_or_default().of(&experiment.models()).map_err(wrong_usage)?;
        ensure_consistent([(
            !(least_distance_m.is_finite() && least_distance_m >= 0.0),
            format!("--least-distance {least_distance_m}, expected a finite number of at least 0"),
        )])?;
        let weights =
            Weights { sensor_cost: prices[0], registration, least_conditioning, ..Weights::default() };
        let objective = Objective::new(PublishedBox::new(&experiment)?, weights, least_distance_m)?;
        Ok(objective.with_prices(prices))
    }
}

/// What cannot be simulated was asked for.
fn refused(error: anyhow::Error) -> anyhow::Error {
    match error.downcast::<ExperimentError>() {
        Ok(error) => wrong_usage(error),
        Err(error) => error,
    }
}
