//! Score: the terms of J, each with its own number.
//!
//! J = U + R_ov(rho) + R_ang(delta) - lambda N: cells seen, a window for the share seen twice, an angle between spin
//! axes, a price per sensor (of its type, where types differ); optionally, the registration strength of the hits. Method:
//! "Mixed Discrete-Continuous Constrained Optimization of Symmetric Multi-LiDAR Mount Configurations for Mapping Systems",
//! equations 8 to 15.
//!
//! ```
//! use outrigger::design::objective::Objective;
//! use outrigger::rig::MountDeg;
//!
//! let objective = Objective::published("paper-os1-64", |_| ())?;
//! // one master: 6 cm to the right, tilted outward by 25 degrees; its mirror image comes with it
//! let found = objective.evaluate(&[MountDeg::from([0.06, 0.0, 0.0, 25.0, 0.0])])?;
//! assert_eq!(found.sensors, 2);
//! assert_eq!(found.terms.coverage, found.unique_voxels as f64);
//! assert_eq!(found.terms.cost, -2.0 * 2000.0);
//! assert_eq!(found.objective, found.terms.objective());
//! assert!(found.violations.is_empty(), "two housings of 85 mm, 120 mm apart");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub(crate) mod baselines;
mod prices;
mod published;
mod settings;

pub use crate::simulate::published::ExperimentError;
pub(crate) use crate::simulate::published::PUBLISHED_SPREAD_DEG;
pub(crate) use prices::{Prices, prices_by_model};
pub use published::ObjectiveError;
pub(crate) use published::POSE_STEP_M;
pub(crate) use settings::{are_same_presets, other_score};

use sensors::catalogue;

use crate::design::registration::{DEGENERATE, RegistrationQuality};
use crate::rig::{Clearance, MountDeg, MountedSensor, Rig};
use crate::simulate::published::PublishedBox;
use crate::simulate::view::{Seen, View as _};
use crate::world::coverage::Counts;

/// Coefficients of J.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Price of one physical sensor (lambda), where types have no prices of their own ([`Objective::with_prices`]).
    pub sensor_cost: f64,
    /// Least overlap ratio of the window.
    pub overlap_min: f64,
    /// Maximum overlap ratio of the window.
    pub overlap_max: f64,
    /// Added inside the window.
    pub overlap_reward: f64,
    /// Penalty per unit of overlap ratio below the window.
    pub overlap_too_little: f64,
    /// Penalty per unit of overlap ratio above the window.
    pub overlap_too_much: f64,
    /// Least angle between two spin axes, degrees.
    pub angle_min_deg: f64,
    /// Added when every pair keeps it, and for a single sensor.
    pub angle_reward: f64,
    /// Penalty at angle zero; in proportion in between.
    pub angle_penalty: f64,
    /// Added per factor of ten between the least translation eigenvalue (5th percentile along the path) and
    /// [`DEGENERATE`]; 0 leaves J as published. Not below 0.
    pub registration: f64,
    /// Least such eigenvalue that is allowed; 0 allows every one.
    pub least_conditioning: f64,
}

/// Eigenvalues below this count as this in the term of J: no information has no logarithm.
const LEAST_EIGENVALUE: f64 = 1e-6;

impl Weights {
    /// The term of J for the share of the cells seen that several sensors see.
    pub fn overlap_term(&self, ratio: f64) -> f64 {
        if ratio < self.overlap_min {
            -self.overlap_too_little * (self.overlap_min - ratio)
        } else if ratio > self.overlap_max {
            -self.overlap_too_much * (ratio - self.overlap_max)
        } else {
            self.overlap_reward
        }
    }

    /// The term of J for the least angle between two spin axes; none for a single sensor.
    pub fn angular_term(&self, min_angle_deg: Option<f64>) -> f64 {
        match min_angle_deg {
            Some(angle_deg) if angle_deg < self.angle_min_deg => {
                -self.angle_penalty * (self.angle_min_deg - angle_deg) / self.angle_min_deg
            }
            _ => self.angle_reward,
        }
    }

    /// Whether J or what is allowed depends on registration strength.
    pub(crate) fn ask_for_registration(&self) -> bool {
        self.registration != 0.0 || self.least_conditioning > 0.0
    }

    /// By what share the conditioning falls short of what is needed; 0 when it does not.
    pub(crate) fn conditioning_shortfall(&self, quality: Option<&RegistrationQuality>) -> f64 {
        let needed = self.least_conditioning;
        if needed <= 0.0 {
            return 0.0;
        }
        (1.0 - quality.map_or(0.0, |quality| quality.translation_p5) / needed).max(0.0)
    }

    /// The term of J for registration strength: a logarithm, because the eigenvalue has no scale of its own.
    pub(crate) fn registration_term(&self, quality: &RegistrationQuality) -> f64 {
        self.registration * (quality.translation_p5.max(LEAST_EIGENVALUE) / DEGENERATE).log10()
    }

    /// The maximum of that term: three eigenvalues share a trace of 1.
    pub(crate) fn best_registration_term(&self) -> f64 {
        self.registration * (1.0 / 3.0 / DEGENERATE).log10()
    }
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
            registration: 0.0,
            least_conditioning: 0.0,
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
    /// Registration strength of the hits; 0 without a weight.
    pub registration: f64,
}

impl Terms {
    /// J.
    pub fn objective(&self) -> f64 {
        self.coverage + self.overlap + self.angular + self.cost + self.registration
    }
}

/// The terms of J from what was seen, the least angle between spin axes (none for a single sensor) and the price of the
/// sensors.
pub(crate) fn score(weights: &Weights, seen: &Seen, min_angle_deg: Option<f64>, price: f64) -> Terms {
    let overlap = weights.overlap_term(seen.overlap_ratio());
    let angular = weights.angular_term(min_angle_deg);
    Terms { coverage: seen.union, overlap, angular, cost: -price, registration: 0.0 }
}

/// A published experiment with its score and the rule of clearance: what optimizers maximise.
#[derive(Clone, Debug)]
pub struct Objective {
    simulator: PublishedBox,
    weights: Weights,
    /// A sensor of each type.
    housings: Vec<MountedSensor>,
    /// Price of a sensor of each type.
    prices: Vec<f64>,
    least_distance_m: f64,
}

/// One scored set of mounts. Field names are those of the JSON documents.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Evaluation {
    /// J.
    pub objective: f64,
    /// Voxels seen by at least one sensor.
    pub unique_voxels: u64,
    /// Voxels that any ray could hit.
    pub reachable_voxels: u64,
    /// Share of the voxels seen that at least two sensors see.
    pub overlap_ratio: f64,
    /// Least angle between spin axes, degrees; none for a single sensor.
    pub min_angle_deg: Option<f64>,
    /// Physical sensors.
    pub sensors: usize,
    /// Model of each.
    pub models: Vec<&'static str>,
    /// Voxels seen by each sensor.
    pub per_sensor_voxels: Vec<u64>,
    /// Voxels seen by each sensor and no other.
    pub unique_per_sensor: Vec<u64>,
    /// The terms of J.
    pub terms: Terms,
    /// Whether every pair of sensors keeps its distance, and the conditioning reaches its minimum.
    pub feasible: bool,
    /// The constraints that are violated.
    pub violations: Vec<Violation>,
    /// Registration strength of the hits; none without weight and constraint.
    pub registration: Option<RegistrationQuality>,
    /// Rays cast.
    pub rays: u64,
}

/// What keeps mounts from being used.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum Violation {
    /// Two sensors too close to each other.
    Clearance(Clearance),
    /// Scans below the required registration strength.
    Conditioning {
        /// Least translation eigenvalue per hit, 5th percentile along the path.
        conditioning: f64,
        /// Least allowed.
        needed_conditioning: f64,
    },
}

impl Evaluation {
    /// A note if coverage no longer separates mounts.
    pub(crate) fn saturation(&self) -> Option<String> {
        let left = self.reachable_voxels.saturating_sub(self.unique_voxels);
        (self.reachable_voxels > 0 && left * SATURATED_WITHIN <= self.reachable_voxels).then(|| {
            format!(
                "{} of {} voxels that can be reached are seen: coverage no longer tells mounts apart, finer voxels would",
                self.unique_voxels, self.reachable_voxels
            )
        })
    }
}

/// One voxel of so many may be missed where coverage counts as saturated.
const SATURATED_WITHIN: u64 = 1000;

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Clearance(pair) => write!(
                f,
                "{} and {} are {:.4} m apart, needed are {:.4} m",
                pair.first, pair.second, pair.distance_m, pair.needed_m
            ),
            Self::Conditioning { conditioning, needed_conditioning } => {
                write!(
                    f,
                    "conditioning of registration is {conditioning:.6}, needed is {needed_conditioning}"
                )
            }
        }
    }
}

impl Objective {
    /// Scores with these weights. Sensors must be apart by the sum of their housing radii, and by `least_distance_m`
    /// (the published d_min; 0 asks for the housings only).
    pub fn new(
        simulator: PublishedBox,
        weights: Weights,
        least_distance_m: f64,
    ) -> Result<Self, catalogue::ModelError> {
        let housing = |model| {
            let model = catalogue::nominal(model)?;
            Ok(MountedSensor { name: String::new(), model, mount: Default::default() })
        };
        let housings =
            simulator.experiment().models().into_iter().map(housing).collect::<Result<Vec<_>, _>>()?;
        let prices = vec![weights.sensor_cost; housings.len()];
        Ok(Self { simulator, weights, housings, prices, least_distance_m })
    }

    /// The same with a price for each sensor type of the experiment, in their order; types beyond the list keep theirs.
    pub fn with_prices(mut self, prices: Vec<f64>) -> Self {
        self.prices.iter_mut().zip(prices).for_each(|(price, given)| *price = given);
        self
    }

    /// The same with these weights; every type costs their price.
    pub(crate) fn with_weights(self, weights: Weights) -> Self {
        Self { prices: vec![weights.sensor_cost; self.prices.len()], weights, ..self }
    }

    /// Price of a sensor of each type of the experiment.
    pub(crate) fn prices(&self) -> &[f64] {
        &self.prices
    }

    /// Price of the sensors of a rig together.
    fn price(&self, rig: &Rig) -> f64 {
        let of = |(housing, price): (&MountedSensor, &f64)| {
            let is_of_type = |sensor: &&MountedSensor| sensor.model.name == housing.model.name;
            price * rig.sensors.iter().filter(is_of_type).count() as f64
        };
        self.housings.iter().zip(&self.prices).map(of).sum()
    }

    /// The simulator.
    pub fn simulator(&self) -> &PublishedBox {
        &self.simulator
    }

    /// The coefficients of J.
    pub(crate) fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The terms of J from what was seen, without the rest of an evaluation.
    pub(crate) fn terms(&self, rig: &Rig, seen: &Seen, quality: Option<&RegistrationQuality>) -> Terms {
        let mut terms = score(&self.weights, seen, angle_deg(rig), self.price(rig));
        terms.registration = quality.map_or(0.0, |quality| self.weights.registration_term(quality));
        terms
    }

    /// The terms of J of a rig, and its registration strength where that counts.
    ///
    /// # Errors
    /// The experiment cannot hold the rig.
    pub(crate) fn measure(&self, rig: &Rig) -> Result<(Terms, Option<RegistrationQuality>), ExperimentError> {
        self.simulator.check(&self.simulator.sensors(rig))?;
        let seen = self.simulator.see(std::slice::from_ref(rig)).swap_remove(0);
        let quality = self.registration(rig);
        Ok((self.terms(rig, &seen, quality.as_ref()), quality))
    }

    /// J of a rig.
    ///
    /// # Errors
    /// The experiment cannot hold the rig.
    pub(crate) fn score(&self, rig: &Rig) -> Result<f64, ExperimentError> {
        Ok(self.measure(rig)?.0.objective())
    }

    /// Registration strength of the hits, with a weight or constraint: it costs as much as a coverage.
    pub(crate) fn registration(&self, rig: &Rig) -> Option<RegistrationQuality> {
        self.weights.ask_for_registration().then(|| RegistrationQuality::of_scans(&self.scans(rig)))?
    }

    /// The minimum distance that was requested besides the housings, m.
    pub(crate) fn least_distance_m(&self) -> f64 {
        self.least_distance_m
    }

    /// Scores masters: roll rule and mirror images as the experiment says.
    pub fn evaluate(&self, masters: &[MountDeg]) -> Result<Evaluation, ExperimentError> {
        let sensors = self.sensors(masters);
        self.simulator.check(&sensors)?;
        self.evaluate_rig(&self.mounted(&sensors))
    }

    /// Scores a rig as it is.
    pub fn evaluate_rig(&self, rig: &Rig) -> Result<Evaluation, ExperimentError> {
        Ok(self.score_counts(rig, &self.simulator.count(&self.simulator.sensors(rig))?))
    }

    /// Scores a rig from counted coverage.
    pub(crate) fn score_counts(&self, rig: &Rig, counts: &Counts) -> Evaluation {
        let sensors = self.simulator.sensors(rig);
        let rays = self.simulator.experiment().rays(&sensors);
        let registration = self.registration(rig);
        let terms = self.terms(rig, &Seen::exact(counts, rays), registration.as_ref());
        let too_close =
            rig.clearances(self.least_distance_m).into_iter().filter(|pair| !pair.is_sufficient());
        let mut violations: Vec<_> = too_close.map(Violation::Clearance).collect();
        if self.weights.conditioning_shortfall(registration.as_ref()) > 0.0 {
            violations.push(Violation::Conditioning {
                conditioning: registration.as_ref().map_or(0.0, |quality| quality.translation_p5),
                needed_conditioning: self.weights.least_conditioning,
            });
        }
        Evaluation {
            objective: terms.objective(),
            unique_voxels: counts.union,
            reachable_voxels: self.simulator.reachable(),
            overlap_ratio: counts.overlap_ratio(),
            min_angle_deg: angle_deg(rig),
            sensors: sensors.len(),
            models: sensors.iter().map(|sensor| self.simulator.experiment().model_of(sensor)).collect(),
            per_sensor_voxels: counts.per_sensor.clone(),
            unique_per_sensor: counts.unique_per_sensor.clone(),
            terms,
            feasible: violations.is_empty(),
            violations,
            registration,
            rays,
        }
    }

    /// The rig of these masters: roll rule and mirror images as the experiment says.
    pub fn rig(&self, masters: &[MountDeg]) -> Rig {
        self.mounted(&self.sensors(masters))
    }

    /// Physical sensors with their housings, named by their numbers; that of the first type where there is no such type.
    pub fn mounted(&self, sensors: &[MountDeg]) -> Rig {
        let mounted = |(index, sensor): (usize, &MountDeg)| MountedSensor {
            name: format!("sensor {}", index + 1),
            mount: sensor.mount(),
            ..self.housings.get(sensor.sensor_type).unwrap_or(&self.housings[0]).clone()
        };
        Rig { sensors: sensors.iter().enumerate().map(mounted).collect() }
    }
}

/// Least angle between the spin axes of a rig, degrees; none for a single sensor.
pub(crate) fn angle_deg(rig: &Rig) -> Option<f64> {
    let axes: Vec<[f64; 3]> =
        rig.sensors.iter().map(|sensor| MountedSensor::spin_axis(sensor).to_array()).collect();
    min_angle_deg(&axes)
}

/// Least angle between any two axes, degrees; none for fewer than two.
fn min_angle_deg(axes: &[[f64; 3]]) -> Option<f64> {
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

#[cfg(test)]
mod tests;
