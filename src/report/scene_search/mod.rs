//! What a search in a scene found: the JSON document and the report of it.

mod assemble;
mod sections;

pub(crate) use assemble::{SiteSource, masters};
pub(crate) use sections::{Pictures, report};

use serde::Serialize;

use crate::base::numbers::{count, counted, number};
use crate::design::optimize::StoppedBy;
use crate::design::robustness::Criterion;
use crate::design::scene_search::{Answer, Judged, JudgedAtSite, ModelError, Plan, SceneWeights, WeightRule};
use crate::simulate::view::{BuildCost, Quality};

/// The document.
#[derive(Serialize)]
pub(crate) struct Document {
    pub method: &'static str,
    pub seed: u64,
    /// Mounts that the model looked at.
    pub evaluations: usize,
    /// Mounts of which every beam was cast, finalists and what they are compared with.
    pub exact_evaluations: usize,
    pub rays: u64,
    pub wall_s: f64,
    pub stopped_by: StoppedBy,
    pub best: Best,
    #[serde(flatten)]
    pub answer: Answer,
    pub model: ModelDocument,
    pub plan: Plan,
    pub weights: WeightsDocument,
    /// Voxels that can be seen from the trajectory; the mean over several sites.
    pub reachable_voxels: u64,
    pub voxel_m: f64,
    pub sampling: SamplingDocument,
    pub trajectory: TrajectoryDocument,
    /// Where there are several; `by_site` of each judged mount has their order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sites: Vec<SiteDocument>,
    /// Which score of several sites counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robust: Option<Criterion>,
    /// Evaluations and the best exact score then.
    pub history: Vec<(usize, f64)>,
    /// What fewer and more sensors see, where that was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by_count: Vec<CountDocument>,
    pub warnings: Vec<String>,
}

/// The best rig of so many sensors.
#[derive(Clone, Serialize)]
pub(crate) struct CountDocument {
    pub sensors: usize,
    pub unique_voxels: u64,
    pub observable_share: f64,
    pub objective: f64,
}

/// The winner.
#[derive(Serialize)]
pub(crate) struct Best {
    #[serde(flatten)]
    pub judged: Judged,
    /// x_m, y_m, z_m, pitch_deg, roll_deg before mirroring.
    pub masters: Vec<[f64; 5]>,
    /// No mount that was looked at is better by more, in J; null where the model's error is not known.
    pub error_bound: Option<f64>,
}

/// The model that looked at most of them.
#[derive(Serialize)]
pub(crate) struct ModelDocument {
    #[serde(flatten)]
    pub cost: BuildCost,
    /// Exact minus corrected; null for fewer than eight exact evaluations.
    pub model_error: Option<ModelError>,
    /// Voxels that the best mounts of the spread all see for certain.
    pub certain_voxels: usize,
}

/// The coefficients of J.
#[derive(Serialize)]
pub(crate) struct WeightsDocument {
    pub rule: WeightRule,
    pub sensor_cost: f64,
    pub overlap_reward: f64,
    pub angle_reward: f64,
    pub angle_penalty: f64,
    pub registration: f64,
    pub least_conditioning: f64,
}

impl WeightsDocument {
    pub(crate) fn new(rule: WeightRule, of: &SceneWeights) -> Self {
        let weights = &of.weights;
        Self {
            rule,
            sensor_cost: weights.sensor_cost,
            overlap_reward: weights.overlap_reward,
            angle_reward: weights.angle_reward,
            angle_penalty: weights.angle_penalty,
            registration: weights.registration,
            least_conditioning: weights.least_conditioning,
        }
    }
}

/// Which beams judged.
#[derive(Serialize)]
pub(crate) struct SamplingDocument {
    pub is_ideal: bool,
    pub scan_stride: u32,
    /// By model: columns per revolution and revolutions cast.
    pub spins: Vec<(String, usize, u64)>,
    /// When a voxel counts, where that was asked for; `reachable_voxels` has its limits of range and angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
}

/// One of several sites.
#[derive(Serialize)]
pub(crate) struct SiteDocument {
    pub scene: String,
    pub trajectory: TrajectoryDocument,
    pub reachable_voxels: u64,
}

/// Along which trajectory.
#[derive(Serialize)]
pub(crate) struct TrajectoryDocument {
    pub source: String,
    /// Of a walk that was planned here; empty for a file.
    pub corners_m: Vec<[f64; 3]>,
    pub length_m: f64,
    pub duration_s: f64,
}

impl Document {
    /// What the best mount and the present one see of each of several sites: its number, the mount, what it sees.
    fn at_sites(&self) -> Vec<(usize, &'static str, &JudgedAtSite)> {
        let mut seen = Vec::new();
        for site in 0..self.sites.len() {
            let present = self.answer.present.as_ref().map(|present| ("present", present));
            for (name, judged) in [("best", &self.best.judged)].into_iter().chain(present) {
                seen.extend(judged.by_site.get(site).map(|at_site| (site + 1, name, at_site)));
            }
        }
        seen
    }

    /// What the score over several sites is.
    fn sites_line(&self) -> Option<String> {
        let which = match self.robust? {
            Criterion::Expected => "the mean over the sites",
            Criterion::Worst => "that of the worst site",
        };
        let scaled = match self.weights.rule {
            WeightRule::Shares => {
                ", the voxels and J of each site scaled to the mean number that can be seen: a large site counts no more than a small one"
            }
            WeightRule::Published => "",
        };
        Some(format!("J is {which}{scaled}"))
    }

    /// Share of what can be seen, in percent with as many digits as the starts of the revolutions allow.
    fn percent(&self, judged: &Judged) -> String {
        format!("{:.2} %", 100.0 * judged.observable_share)
    }

    /// The answer in one sentence.
    fn sentence(&self) -> String {
        let (name, present) = match &self.answer.present {
            Some(present) => ("Your present mount", present),
            None => ("The level mount", &self.answer.level),
        };
        let most = self.best.error_bound.map_or(String::new(), |bound| {
            let most = self.best.judged.observable_share + bound / self.reachable_voxels.max(1) as f64;
            format!(
                "; of {} mounts tried none sees more than {:.2} %",
                self.evaluations,
                100.0 * most.min(1.0)
            )
        });
        format!(
            "{name} sees {} of what can be seen, the best found {}{most}.",
            self.percent(present),
            self.percent(&self.best.judged)
        )
    }

    /// The rigs that were judged, by name.
    fn compared(&self) -> Vec<(&'static str, &Judged)> {
        let answer = &self.answer;
        let mut compared = vec![("best", &self.best.judged), ("the same, level", &answer.level)];
        compared.extend(answer.present.iter().map(|present| ("present", present)));
        compared.push(("one sensor, level", &answer.level_single));
        compared.push(("one sensor, best pitch", &answer.best_single));
        compared
    }

    fn tolerance_line(&self) -> String {
        let loss = &self.answer.tolerance;
        format!(
            "{} m and {}° off cost {} % on average, {} % at worst of {} draws",
            loss.position_m,
            loss.angle_deg,
            number(100.0 * loss.mean_loss_share, 2),
            number(100.0 * loss.worst_loss_share, 2),
            loss.draws
        )
    }

    fn certainty_line(&self) -> String {
        format!(
            "{} voxels (standard deviation over starts of the revolutions); {} cannot be distinguished",
            number(self.answer.phase_sd_voxels, 0),
            counted(self.answer.indistinguishable.len() as u64, "other mount")
        )
    }

    fn model_line(&self) -> Option<String> {
        let (error, cost) = (self.model.model_error?, &self.model.cost);
        let step =
            error.step_z_m.map(|z_m| format!("; what is seen changes at a stroke where z is {z_m:.2} m"));
        Some(format!(
            "{} views, {} heights, {} MB; off by {} voxels, {} after the correction (standard deviation over {} exact \
             mounts){}",
            cost.views,
            cost.layers,
            number(cost.bytes as f64 * 1e-6, 0),
            number(error.uncorrected_mean, 0),
            number(error.sd, 0),
            error.n,
            step.unwrap_or_default()
        ))
    }

    fn cost_line(&self) -> String {
        let thinned = match self.plan {
            Plan { thinning: 1, .. } => String::new(),
            Plan { thinning, whole, .. } => {
                format!(" (with one beam in {thinning}, the best {whole} with every beam)")
            }
        };
        format!(
            "{} mounts by the model, {} exactly{thinned}, {} rays in {:.2} s",
            self.evaluations,
            self.exact_evaluations,
            count(self.rays),
            self.wall_s
        )
    }

    /// The history as lines of a CSV file.
    pub(crate) fn csv(&self) -> String {
        let lines = self.history.iter().map(|(at, best)| format!("{at},{best}\r\n"));
        format!("evaluations,best_objective\r\n{}", lines.collect::<String>())
    }
}
