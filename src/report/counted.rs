//! Counts and score of a rig in a scene, as the documents of all predictions there have them.

use serde::Serialize;

use super::chart::number;
use crate::design::objective::{Terms, angle_deg};
use crate::design::scene_search::{SceneWeights, WeightRule};
use crate::rig::Rig;
use crate::simulate::view::Seen;
use crate::world::coverage::Counts;

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Counted {
    /// J.
    pub objective: f64,
    pub unique_voxels: u64,
    /// Voxels that can be seen from the trajectory, and no fewer than are seen.
    pub reachable_voxels: u64,
    overlap_voxels: u64,
    overlap_ratio: f64,
    min_angle_deg: Option<f64>,
    per_sensor_voxels: Vec<u64>,
    unique_per_sensor: Vec<u64>,
    terms: Terms,
}

impl Counted {
    /// `observable` are the voxels that can be seen from the trajectory.
    pub(crate) fn new(rig: &Rig, counts: &Counts, observable: u64, rule: WeightRule) -> Self {
        let terms = SceneWeights::new(rule, observable).terms(rig, &Seen::exact(counts, 0), None);
        Self {
            objective: terms.objective(),
            unique_voxels: counts.union,
            reachable_voxels: observable.max(counts.union),
            overlap_voxels: counts.overlap,
            overlap_ratio: counts.overlap_ratio(),
            min_angle_deg: angle_deg(rig),
            per_sensor_voxels: counts.per_sensor.clone(),
            unique_per_sensor: counts.unique_per_sensor.clone(),
            terms,
        }
    }

    /// Of the voxels that can be seen, %.
    pub(crate) fn percent(&self) -> f64 {
        100.0 * self.unique_voxels as f64 / self.reachable_voxels.max(1) as f64
    }

    /// In words, each with a label.
    pub(crate) fn figures(&self) -> [(&'static str, String); 2] {
        let overlap = 100.0 * self.overlap_ratio;
        [
            ("overlap", format!("{overlap:.2} % of the voxels seen are seen by two sensors or more")),
            ("score", format!("J {}", number(self.objective, 1))),
        ]
    }
}
