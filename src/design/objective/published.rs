//! Objectives over the published experiments: only here does design know what they are made of.

use sensors::catalogue::ModelError;

use super::{Objective, Weights};
use crate::design::registration::Information;
use crate::rig::{MountDeg, Rig};
use crate::simulate::published::{Experiment, ExperimentError, Preset, PublishedBox};

/// Why a published experiment makes no objective.
#[derive(Debug, thiserror::Error)]
pub enum ObjectiveError {
    /// It cannot be simulated.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// Its sensor has no housing.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Distance between the poses whose scans registration is judged by, m.
pub(crate) const POSE_STEP_M: usize = 5;
/// Every so many of their columns count.
const COLUMN_STEP: usize = 8;

impl Objective {
    /// A preset with this about it changed, and the published weights.
    ///
    /// # Errors
    /// No such preset, or a change of which no experiment can be made.
    pub fn published(preset: &str, change: impl FnOnce(&mut Experiment)) -> Result<Self, ObjectiveError> {
        let mut experiment = Experiment::published(Preset::named(preset)?);
        change(&mut experiment);
        Ok(Self::new(PublishedBox::new(&experiment)?, Weights::default(), 0.0)?)
    }

    /// The same objective with this about its experiment changed; the sensor types stay.
    ///
    /// # Errors
    /// Those of the experiment.
    pub(crate) fn changed(&self, change: impl FnOnce(&mut Experiment)) -> Result<Self, ExperimentError> {
        let mut experiment = *self.simulator.experiment();
        change(&mut experiment);
        Ok(Self { simulator: PublishedBox::new(&experiment)?, ..self.clone() })
    }

    /// Every physical sensor of these masters.
    pub(crate) fn sensors(&self, masters: &[MountDeg]) -> Vec<MountDeg> {
        self.simulator.experiment().sensors(masters)
    }

    /// One sum of hits for every 5 m of the walk: every 8th column, all sensors together, in the axes of the mount frame.
    pub(crate) fn scans(&self, rig: &Rig) -> Vec<Information> {
        let (experiment, sensors) = (self.simulator.experiment(), self.simulator.sensors(rig));
        let poses = (0..experiment.poses()).step_by(POSE_STEP_M * experiment.sub_poses);
        let scan = |pose: usize| {
            let mut information = Information::default();
            for sensor in &sensors {
                self.simulator.sparse_hits(sensor, pose, COLUMN_STEP, |from_body_m, normal| {
                    information.add(from_body_m.into(), normal.into());
                });
            }
            information
        };
        poses.map(scan).collect()
    }
}

/// The sensor model of a preset.
pub(super) fn model_of(preset: &str) -> Option<&'static str> {
    Preset::named(preset).ok().map(|preset| preset.model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::registration::RegistrationQuality;

    /// Figures from an independent program (numpy, a pseudo-inverse instead of the eigenvalues): 5th percentile and
    /// median of translation, then of rotation.
    #[test]
    fn the_published_walk_is_observable_as_computed_elsewhere() {
        let level = vec![[0.0; 5].into()];
        let pair = vec![[0.06, 0.1, -0.05, 25.0, 0.0].into(), [-0.06, 0.1, -0.05, -25.0, 0.0].into()];
        for (preset, sensors, expected) in [
            (
                "paper-vlp-16",
                &level,
                [0.138288494449793, 0.230837286303301, 21.4151798202883, 29.0757096375488],
            ),
            (
                "paper-os1-64",
                &level,
                [0.121667394451864, 0.198121632756250, 22.6942660467668, 27.0964059335269],
            ),
            (
                "paper-vlp-16",
                &pair,
                [0.128500624184174, 0.140083579198435, 31.9657589393340, 35.4218688838908],
            ),
            (
                "paper-os1-64",
                &pair,
                [0.126918368385795, 0.168801114529027, 32.8552570066808, 37.1828226925162],
            ),
        ] {
            let objective = Objective::published(preset, |_| ()).unwrap();
            let scans = objective.scans(&objective.mounted(sensors));
            assert_eq!(scans.len(), 9);
            let quality = RegistrationQuality::of_scans(&scans).unwrap();
            let found = [
                quality.translation_p5,
                quality.translation_median,
                quality.rotation_p5_m2,
                quality.rotation_median_m2,
            ];
            let off = found.iter().zip(expected).map(|(found, expected)| (found / expected - 1.0).abs());
            assert!(off.fold(0.0, f64::max) < 1e-9, "{preset}: {found:?}");
        }
    }
}
