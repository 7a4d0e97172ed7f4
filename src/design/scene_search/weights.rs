//! J in any scene: the published weights, as they are or as shares of what can be seen.

use crate::design::objective::{Terms, Weights, min_angle_deg};
use crate::rig::{MountedSensor, Rig};
use crate::simulate::view::Seen;

/// Voxels that can be hit in the published room, for which the published weights were made.
const PUBLISHED_REACHABLE: f64 = 35_048.0;

/// How the published weights are scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum WeightRule {
    /// As the same shares of the voxels that can be seen here.
    #[default]
    Shares,
    /// As they are, whatever the scene.
    Published,
}

/// The coefficients of J in one scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneWeights {
    pub weights: Weights,
    /// Voxels that can be seen.
    pub observable: u64,
}

impl SceneWeights {
    pub(crate) fn new(rule: WeightRule, observable: u64) -> Self {
        let published = Weights::default();
        let scale = match rule {
            WeightRule::Published => 1.0,
            WeightRule::Shares => observable as f64 / PUBLISHED_REACHABLE,
        };
        let weights = Weights {
            sensor_cost: scale * published.sensor_cost,
            overlap_reward: scale * published.overlap_reward,
            overlap_too_little: scale * published.overlap_too_little,
            overlap_too_much: scale * published.overlap_too_much,
            angle_reward: scale * published.angle_reward,
            angle_penalty: scale * published.angle_penalty,
            ..published
        };
        Self { weights, observable }
    }

    /// The terms of J of a rig.
    pub(crate) fn terms(&self, rig: &Rig, seen: &Seen) -> Terms {
        let weights = &self.weights;
        Terms {
            coverage: seen.union,
            overlap: weights.overlap_term(seen.overlap_ratio()),
            angular: weights.angular_term(angle_deg(rig)),
            cost: -weights.sensor_cost * rig.sensors.len() as f64,
            registration: 0.0,
        }
    }
}

/// Least angle between the spin axes of a rig, degrees; none for a single sensor.
pub(crate) fn angle_deg(rig: &Rig) -> Option<f64> {
    let axes: Vec<[f64; 3]> =
        rig.sensors.iter().map(|sensor| MountedSensor::spin_axis(sensor).to_array()).collect();
    min_angle_deg(&axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_the_published_room_are_the_published_weights() {
        assert_eq!(SceneWeights::new(WeightRule::Shares, 35_048).weights, Weights::default());
        let small = SceneWeights::new(WeightRule::Shares, 3_505).weights;
        assert!((small.sensor_cost - 200.0).abs() < 0.1 && small.overlap_max == 0.10);
        assert_eq!(SceneWeights::new(WeightRule::Published, 3_505).weights, Weights::default());
    }
}
