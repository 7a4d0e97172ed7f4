//! Score: the terms of J, each with its own number.
//!
//! J = U + R_ov(rho) + R_ang(delta) - lambda N: cells seen, a window for the share seen twice, an angle between spin
//! axes, a price per sensor. Method: "Mixed Discrete-Continuous Constrained Optimization of Symmetric Multi-LiDAR
//! Mount Configurations for Mapping Systems", equations 8 to 15.

use crate::coverage::Counts;

/// Coefficients of J.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Price of one physical sensor (lambda).
    pub sensor_cost: f64,
    /// Least overlap ratio of the window.
    pub overlap_min: f64,
    /// Greatest overlap ratio of the window.
    pub overlap_max: f64,
    /// Added inside the window.
    pub overlap_reward: f64,
    /// Taken off per unit of overlap ratio below the window.
    pub overlap_too_little: f64,
    /// Taken off per unit of overlap ratio above the window.
    pub overlap_too_much: f64,
    /// Least angle between two spin axes, degrees.
    pub angle_min_deg: f64,
    /// Added when every pair keeps it, and for a single sensor.
    pub angle_reward: f64,
    /// Taken off at angle zero; in proportion in between.
    pub angle_penalty: f64,
}

impl Default for Weights {
    /// As published.
    fn default() -> Self {
        Self {
            sensor_cost: 2000.0,
            overlap_min: 0.05,
            overlap_max: 0.10,
            overlap_reward: 300.0,
            overlap_too_little: 1000.0,
            overlap_too_much: 600.0,
            angle_min_deg: 30.0,
            angle_reward: 100.0,
            angle_penalty: 2000.0,
        }
    }
}

/// The terms of J; their sum is J.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Terms {
    /// Cells seen.
    pub coverage: f64,
    /// Reward or penalty for the overlap ratio.
    pub overlap: f64,
    /// Reward or penalty for the least angle between spin axes.
    pub angular: f64,
    /// Price of the sensors, zero or less.
    pub cost: f64,
}

impl Terms {
    /// J.
    pub fn objective(&self) -> f64 {
        self.coverage + self.overlap + self.angular + self.cost
    }
}

/// The terms of J from what was seen, the least angle between spin axes (none for a single sensor) and the number of
/// sensors.
pub fn score(weights: &Weights, counts: &Counts, min_angle_deg: Option<f64>, sensors: usize) -> Terms {
    let ratio = counts.overlap_ratio();
    let overlap = if ratio < weights.overlap_min {
        -weights.overlap_too_little * (weights.overlap_min - ratio)
    } else if ratio > weights.overlap_max {
        -weights.overlap_too_much * (ratio - weights.overlap_max)
    } else {
        weights.overlap_reward
    };
    let angular = match min_angle_deg {
        Some(angle_deg) if angle_deg < weights.angle_min_deg => {
            -weights.angle_penalty * (weights.angle_min_deg - angle_deg) / weights.angle_min_deg
        }
        _ => weights.angle_reward,
    };
    Terms { coverage: counts.union as f64, overlap, angular, cost: -weights.sensor_cost * sensors as f64 }
}

/// Least angle between any two axes, degrees; none for fewer than two.
pub fn min_angle_deg(axes: &[[f64; 3]]) -> Option<f64> {
    // an arc cosine near 1 turns the last bit of a length into 1e-8 degrees
    let unit = |axis: &[f64; 3]| {
        let norm = (axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]).sqrt();
        axis.map(|value| value / norm)
    };
    let axes: Vec<_> = axes.iter().map(unit).collect();
    let mut least: Option<f64> = None;
    for (index, a) in axes.iter().enumerate() {
        for b in &axes[index + 1..] {
            let cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let angle_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
            least = Some(least.map_or(angle_deg, |best| best.min(angle_deg)));
        }
    }
    least
}
