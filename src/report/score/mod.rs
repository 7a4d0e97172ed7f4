//! The score of mounts in a published experiment: the JSON document and its summary.

mod page;

pub(crate) use page::page;

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
        let scans = objective.scans(sensors);
        let first_m = -0.5 * experiment.preset.path_length_m;
        let along = |(scan, [translation, rotation_m2]): (usize, [f64; 2])| {
            [first_m + (scan * POSE_STEP_M) as f64, translation, rotation_m2]
        };
        let union = coverage.union();
        let unseen = simulator.reachable_cells().filter(|cell| union[cell / 64] >> (cell % 64) & 1 == 0);
        let mut evaluation = objective.score_counts(sensors, &coverage.counts());
        evaluation.registration = RegistrationQuality::of_scans(&scans);
        Self {
            evaluation,
            baselines: None,
            rescored: None,
            fidelity: None,
            registration_path: least_along(&scans).into_iter().enumerate().map(along).collect(),
            blind_spots: blind_spots(&simulator.grid(), unseen, MAX_BLIND_SPOTS),
            touching: objective.rig(sensors).touching(),
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

    /// The result in words.
    pub(crate) fn summary(&self) -> String {
        let evaluation = &self.evaluation;
        let terms = &evaluation.terms;
        let angle =
            evaluation.min_angle_deg.map_or("one sensor".into(), |angle| format!("{angle:.2} degrees"));
        let registration = match terms.registration {
            0.0 => String::new(),
            term => format!(" {term:+.2} registration"),
        };
        let mut text = format!(
            "{}, path {}\n\
         J              {:.2} = coverage {:.0} {:+.2} overlap {:+.2} angular {:+.0} cost{registration}\n\
         voxels seen    {} of {} that can be hit ({:.2} %)\n\
         overlap        {:.2} %\n\
         least angle    {angle}\n",
            self.preset,
            self.path.name(),
            evaluation.objective,
            terms.coverage,
            terms.overlap,
            terms.angular,
            terms.cost,
            evaluation.unique_voxels,
            evaluation.reachable_voxels,
            100.0 * evaluation.unique_voxels as f64 / evaluation.reachable_voxels as f64,
            100.0 * evaluation.overlap_ratio,
        );
        text += &self.sensor_lines();
        if let Some(quality) = &evaluation.registration {
            text += &quality.line();
        }
        if let Some(rescored) = &self.rescored {
            text += &rescored.line();
        }
        for (title, words) in self.fidelity.iter().flat_map(MountFidelity::verdicts) {
            text += &format!("{title:<15}{words}\n");
        }
        if evaluation.feasible {
            text += "allowed        yes: every pair of sensors keeps its distance\n";
        }
        text += &evaluation.saturation().map_or(String::new(), |words| format!("{words}\n"));
        for violation in &evaluation.violations {
            text += &format!("allowed        no: {violation}\n");
        }
        for pair in &self.touching {
            text += &format!("can be built   no: {pair}\n");
        }
        text + &format!("{} rays in {:.4} s\n", evaluation.rays, self.wall_s)
    }

    /// A line per sensor, and one per baseline.
    fn sensor_lines(&self) -> String {
        let evaluation = &self.evaluation;
        let mut text =
            String::from("sensor       x m      y m      z m    pitch     roll   voxels    alone  model\n");
        for (index, [x_m, y_m, z_m, pitch_deg, roll_deg]) in self.mounts.iter().enumerate() {
            text += &format!(
                "{:6} {x_m:9.4}{y_m:9.4}{z_m:9.4}{pitch_deg:9.3}{roll_deg:9.3}{:9}{:9}  {}\n",
                index + 1,
                evaluation.per_sensor_voxels[index],
                evaluation.unique_per_sensor[index],
                evaluation.models[index]
            );
        }
        for (name, single) in self.baselines.iter().flat_map(Baselines::named) {
            text += &format!(
                "{name:15}{} at pitch {:.0}: J {:.2}, {} voxels; the mounts see {:+}\n",
                single.model,
                single.pitch_deg,
                single.seen.objective,
                single.seen.unique_voxels,
                single.seen.gain_voxels
            );
        }
        text
    }
}
