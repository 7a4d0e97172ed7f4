//! The best mount of a search: the JSON document, the report of it and its CSV.

mod sections;

pub(crate) use sections::{Pictures, report};

use serde::Serialize;

use crate::design::objective::Evaluation;
use crate::design::optimize::{Certificate, JudgedShortlist, KeepApart, Kind, Refinement, StoppedBy};
use crate::design::robustness::Spread;
use crate::report::chart::number;
use crate::rig::{MountFile, Path};

/// The document of a search.
#[derive(Serialize)]
pub(crate) struct Document {
    pub method: Kind,
    pub seed: u64,
    pub evaluations: usize,
    pub rays: u64,
    pub wall_s: f64,
    /// Part of `wall_s` during which the objective was at work on some thread.
    pub objective_s: f64,
    /// The rest: what the search itself took.
    pub search_s: f64,
    pub stopped_by: StoppedBy,
    /// J over mount errors, where the search was for it.
    pub robust: Option<Spread>,
    pub best: Best,
    /// No mount of this space can score above this: all reachable voxels with every reward for each number of sensors,
    /// or what was proved of one master.
    pub bound: Option<f64>,
    /// The mount under finer models; null unless asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fidelity: Option<Refinement>,
    /// The best mounts as they would be built; null where they were not looked at again.
    pub final_look: Option<JudgedShortlist>,
    /// What was proved of rigs of one master; null unless asked for.
    pub certificate: Option<Proved>,
    pub command: String,
    /// Evaluation that found the best, from 1.
    pub best_at: usize,
    /// Of a mixed rig all presets, with commas between them.
    pub preset: String,
    /// Price of a sensor of each of them.
    pub prices: Vec<f64>,
    pub path: Path,
    pub clearance: KeepApart,
    pub masters_max: u32,
    /// `[evaluation, best objective so far]`; null while nothing feasible was found.
    pub history: Vec<(usize, Option<f64>)>,
}

/// A proof and what it took.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Proved {
    #[serde(flatten)]
    pub certificate: Certificate,
    pub wall_s: f64,
}

#[derive(Serialize)]
pub(crate) struct Best {
    #[serde(flatten)]
    pub evaluation: Evaluation,
    /// `[x_m, y_m, z_m, pitch_deg, roll_deg]` of each sensor before mirroring.
    pub masters: Vec<[f64; 5]>,
    pub master_models: Vec<&'static str>,
}

impl Document {
    /// Where the search found its highest J, and whether that is the J of the mount.
    fn found_at(&self) -> String {
        let stopped = match self.stopped_by {
            StoppedBy::Budget => "all used",
            StoppedBy::Converged => "then converged",
            StoppedBy::Interrupted => "then interrupted",
            StoppedBy::Rays => "then the rays were used up",
        };
        let is_judged_again = self.final_look.is_some() || self.fidelity.is_some();
        let found = match is_judged_again {
            true => "the best of those looked at again (below); the search's own favourite was found",
            false => "the highest, found",
        };
        format!("{found} at evaluation {} of {} ({stopped})", self.best_at, self.evaluations)
    }

    /// What else was found out about the mount, each with a title; a line that goes on has none.
    fn verdicts(&self) -> Vec<(&'static str, String)> {
        let evaluation = &self.best.evaluation;
        let mut verdicts: Vec<_> =
            evaluation.violations.iter().map(|violation| ("allowed", format!("no: {violation}"))).collect();
        if let Some(bound) = self.bound {
            let more = bound - evaluation.objective;
            verdicts.push((
                "bound",
                format!(
                    "no mount can score above {}, {} more than this one",
                    number(bound, 1),
                    number(more, 1)
                ),
            ));
        }
        if let Some(Proved { certificate, wall_s }) = &self.certificate {
            let words = format!(
                "of one master: {:.1} more at most; {:.1} % of its space closed, {} regions in {wall_s:.1} s",
                certificate.gap,
                100.0 * certificate.closed_share,
                certificate.regions
            );
            verdicts.push(("proved", words));
        }
        verdicts.extend(self.fidelity.iter().flat_map(Refinement::verdicts));
        verdicts.extend(self.final_look.iter().flat_map(JudgedShortlist::verdicts));
        if let Some(spread) = &self.robust {
            let words = format!(
                "J {:.1} on average, {:.1} at worst, standard deviation {:.1} over {} draws",
                spread.mean, spread.worst, spread.deviation, spread.draws
            );
            verdicts.push(("as built", words));
        }
        verdicts
    }

    /// One line per sensor.
    pub(crate) fn csv(&self, file: &MountFile) -> String {
        let mut text = String::from("sensor,model,x_m,y_m,z_m,pitch_deg,roll_deg,voxels,unique_voxels\r\n");
        let evaluation = &self.best.evaluation;
        for (index, sensor) in file.sensors.iter().enumerate() {
            text += &format!(
                "{},{},{},{},{},{},{},{},{}\r\n",
                sensor.name,
                sensor.model,
                sensor.x_m,
                sensor.y_m,
                sensor.z_m,
                sensor.pitch_deg,
                sensor.roll_deg,
                evaluation.per_sensor_voxels[index],
                evaluation.unique_per_sensor[index]
            );
        }
        text
    }
}
