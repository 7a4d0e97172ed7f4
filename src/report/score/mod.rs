//! The score of mounts in a published experiment: the JSON document and the report of it.

mod sections;

pub(crate) use sections::report;

use serde::Serialize;

use super::{BlindSpot, MAX_BLIND_SPOTS, blind_spots};
use crate::design::fidelity::MountFidelity;
use crate::design::objective::baselines::{Rescored, SingleScore};
use crate::design::objective::{Evaluation, Objective, POSE_STEP_M};
use crate::design::registration::{RegistrationQuality, least_along};
use crate::rig::{MountDeg, Path, Phase, Touching};
use crate::simulate::baselines::Baselines;
use crate::world::coverage::Coverage;

/// The document of a score.
#[derive(Serialize)]
pub(crate) struct Document {
    #[serde(flatten)]
    pub evaluation: Evaluation,
    /// Null where they were left out.
    pub baselines: Option<Baselines<SingleScore>>,
    /// Null unless asked for.
    pub rescored: Option<Rescored>,
    /// Null unless asked for.
    pub fidelity: Option<MountFidelity>,
    /// `[position on the walk m, translation, rotation m^2]`: least eigenvalues per hit.
    registration_path: Vec<[f64; 3]>,
    /// Neighbouring voxels that can be hit and are not, the largest groups first.
    blind_spots: Vec<BlindSpot>,
    /// Pairs of housings that touch as they are tilted, far apart as their origins may be.
    touching: Vec<Touching>,
    coverage_sha256: String,
    /// Of a mixed rig all presets, with commas between them.
    preset: String,
    /// Price of a sensor of each of them.
    prices: Vec<f64>,
    path: Path,
    voxel_m: f64,
    azimuths: usize,
    sub_poses: usize,
    phase: Phase,
    /// Rays that the published slab test loses, by sensor.
    lost_rays: Vec<u64>,
    /// Every physical sensor: x_m, y_m, z_m, pitch_deg, roll_deg.
    mounts: Vec<[f64; 5]>,
    wall_s: f64,
}

impl Document {
    /// The score of what these sensors see, with the rays that each of them loses.
    pub(crate) fn new(
        objective: &Objective,
        sensors: &[MountDeg],
        (coverage, lost_rays): (&Coverage, Vec<u64>),
        wall_s: f64,
    ) -> Self {
        let simulator = objective.simulator();
        let experiment = simulator.experiment();
        let rig = objective.mounted(sensors);
        let scans = objective.scans(&rig);
        let first_m = -0.5 * experiment.preset.path_length_m;
        let along = |(scan, [translation, rotation_m2]): (usize, [f64; 2])| {
            [first_m + (scan * POSE_STEP_M) as f64, translation, rotation_m2]
        };
        let union = coverage.union();
        let unseen = simulator.reachable_cells().filter(|cell| union[cell / 64] >> (cell % 64) & 1 == 0);
        let mut evaluation = objective.score_counts(&rig, &coverage.counts());
        evaluation.registration = RegistrationQuality::of_scans(&scans);
        Self {
            evaluation,
            baselines: None,
            rescored: None,
            fidelity: None,
            registration_path: least_along(&scans).into_iter().enumerate().map(along).collect(),
            blind_spots: blind_spots(&simulator.grid(), unseen, MAX_BLIND_SPOTS),
            touching: rig.touching(),
            coverage_sha256: coverage.union_sha256(),
            preset: experiment.name(),
            prices: objective.prices().to_vec(),
            path: experiment.path,
            voxel_m: experiment.voxel_m,
            azimuths: experiment.azimuths,
            sub_poses: experiment.sub_poses,
            phase: experiment.phase,
            lost_rays,
            mounts: sensors.iter().map(|sensor| (*sensor).into()).collect(),
            wall_s,
        }
    }
}
