//! The published numbers: "Mixed Discrete-Continuous Constrained Optimization of Symmetric Multi-LiDAR Mount Configurations
//! for Mapping Systems", Tables 3, 4 and 8, section 4.4.

use crate::design::optimize::Kind;

/// One row of Table 3, with its two of Table 4.
pub struct Table3 {
    pub preset: &'static str,
    pub method: Kind,
    pub objective: f64,
    pub unique_voxels: f64,
    pub overlap_percent: f64,
    pub min_angle_deg: f64,
    pub evaluations: f64,
    pub runtime_s: f64,
    pub objective_per_s: f64,
    pub objective_per_evaluation: f64,
}

const fn row(preset: &'static str, method: Kind, numbers: [f64; 8]) -> Table3 {
    let [
        objective,
        unique_voxels,
        overlap_percent,
        min_angle_deg,
        evaluations,
        runtime_s,
        per_s,
        per_evaluation,
    ] = numbers;
    Table3 {
        preset,
        method,
        objective,
        unique_voxels,
        overlap_percent,
        min_angle_deg,
        evaluations,
        runtime_s,
        objective_per_s: per_s,
        objective_per_evaluation: per_evaluation,
    }
}

/// J, U, overlap %, least angle, evaluations, runtime s (Table 3); J per second, J per evaluation (Table 4).
pub const TABLE_3: [Table3; 6] = [
    row("paper-os1-64", Kind::Bayesian, [30730.1, 34887.0, 52.7, 50.5, 56.0, 27.0, 1229.0, 548.0]),
    row("paper-os1-64", Kind::Genetic, [30724.7, 34906.0, 56.9, 65.5, 3910.0, 795.47, 39.0, 7.9]),
    row("paper-os1-64", Kind::ParticleSwarm, [30727.1, 34884.0, 52.8, 52.0, 3420.0, 536.19, 57.0, 9.0]),
    row("paper-vlp-16", Kind::Bayesian, [28924.6, 32998.0, 38.9, 76.0, 80.0, 125.47, 253.0, 368.0]),
    row("paper-vlp-16", Kind::Genetic, [29042.1, 33118.0, 39.3, 75.1, 7585.0, 231.08, 109.0, 3.8]),
    row("paper-vlp-16", Kind::ParticleSwarm, [28898.2, 32992.0, 42.3, 84.0, 3420.0, 157.48, 194.0, 8.5]),
];

/// One row of Table 8; roll is free when none.
pub struct Table8 {
    pub preset: &'static str,
    pub roll_deg: Option<f64>,
    pub unique_voxels: f64,
    pub objective: f64,
    pub pitch_deg: f64,
}

const fn roll(preset: &'static str, roll_deg: Option<f64>, numbers: [f64; 3]) -> Table8 {
    let [unique_voxels, objective, pitch_deg] = numbers;
    Table8 { preset, roll_deg, unique_voxels, objective, pitch_deg }
}

/// U, J, mean pitch.
pub const TABLE_8: [Table8; 12] = [
    roll("paper-vlp-16", Some(0.0), [32777.0, 28705.0, 35.757]),
    roll("paper-vlp-16", Some(5.0), [32748.0, 28667.0, 39.318]),
    roll("paper-vlp-16", Some(-5.0), [32793.0, 28712.0, 38.479]),
    roll("paper-vlp-16", Some(10.0), [32495.0, 28413.0, 40.423]),
    roll("paper-vlp-16", Some(-10.0), [32499.0, 28418.0, 40.321]),
    roll("paper-vlp-16", None, [32292.0, 28214.0, 39.737]),
    roll("paper-os1-64", Some(0.0), [34981.0, 30831.0, 25.481]),
    roll("paper-os1-64", Some(5.0), [34901.0, 30738.0, 27.291]),
    roll("paper-os1-64", Some(-5.0), [34856.0, 30704.0, 24.834]),
    roll("paper-os1-64", Some(10.0), [34937.0, 30773.0, 28.878]),
    roll("paper-os1-64", Some(-10.0), [34904.0, 30747.0, 27.23]),
    roll("paper-os1-64", None, [34714.0, 30540.0, 33.107]),
];

/// Prices of section 4.4.
pub const LAMBDAS: [f64; 3] = [1600.0, 2000.0, 2400.0];
