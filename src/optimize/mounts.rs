//! Mounts as a search space: how many masters, and where and how tilted each is.

use serde::{Deserialize, Serialize};

use super::{Measured, Mirror, Space, SpaceError, Variable};
use crate::objective::Objective;
use crate::simulate::published::{ExperimentError, Phase, Placement, Roll};

/// Greatest number of masters of the published space.
pub const PUBLISHED_MASTERS_MAX: u32 = 5;

/// Published bounds: where a master may sit, m, and how far it may tilt, degrees.
const BOUNDS: [(&str, f64, f64); 5] = [
    ("x_m", -0.10, 0.15),
    ("y_m", -0.25, 0.25),
    ("z_m", -0.15, 0.15),
    ("pitch_deg", -90.0, 90.0),
    ("roll_deg", -90.0, 90.0),
];

/// What about the mounts is searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MountSearch {
    /// One master up to this many; each is mirrored.
    pub masters_max: u32,
    /// Roll of every master in degrees; searched when `None`.
    pub fixed_roll_deg: Option<f64>,
    /// Whether each master has a mirror image: the two may then change places.
    pub is_mirrored: bool,
    /// Whether scene and path look the same from both ends of the platform (y and roll change sign).
    pub fore_aft_symmetry: bool,
}

impl MountSearch {
    /// The space: the number of masters, then x, y, z, pitch and, if it is free, roll of each. A master beyond the
    /// number is inactive. Symmetries: a master and its mirror image may change places, and so may masters.
    pub fn space(&self) -> Result<Space, SpaceError> {
        let count = f64::from(self.masters_max);
        let mut variables = vec![Variable {
            name: "masters".into(),
            low: 1.0,
            high: count,
            integer: true,
            active_from: None,
            role: 0,
        }];
        let mut blocks = Vec::new();
        let mut mirrors = Vec::new();
        let per_master = self.per_master();
        for master in 1..=self.masters_max {
            let first = variables.len();
            for (role, (name, low, high)) in BOUNDS.iter().take(per_master).enumerate() {
                variables.push(Variable {
                    name: format!("master {master} {name}"),
                    low: *low,
                    high: *high,
                    integer: false,
                    active_from: (master > 1).then_some(master),
                    role: role + 1,
                });
            }
            if self.is_mirrored {
                mirrors.push(Mirror { key: first, negated: vec![first, first + 3] });
            }
            blocks.push((first..first + per_master).collect::<Vec<usize>>());
        }
        if self.fore_aft_symmetry && self.fixed_roll_deg.is_none_or(|roll| roll == 0.0) {
            let negated = blocks.iter().flat_map(|block| {
                let roll = self.fixed_roll_deg.is_none().then_some(block[0] + 4);
                [Some(block[0] + 1), roll].into_iter().flatten()
            });
            let negated = negated.collect();
            mirrors.push(Mirror { key: 2, negated });
        }
        Space::new(variables)?.with_symmetries(mirrors, blocks)
    }

    /// The masters of a point of that space.
    pub fn masters(&self, values: &[f64]) -> Vec<Placement> {
        let roll_deg = self.fixed_roll_deg.unwrap_or(0.0);
        values[1..]
            .chunks_exact(self.per_master())
            .take(values[0] as usize)
            .map(|v| Placement::from([v[0], v[1], v[2], v[3], v.get(4).copied().unwrap_or(roll_deg)]))
            .collect()
    }

    fn per_master(&self) -> usize {
        if self.fixed_roll_deg.is_some() { 4 } else { 5 }
    }
}

/// Which distance between sensor origins a search must keep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KeepApart {
    /// None: sensors may lie in each other, as in the published runs.
    None,
    /// The housings, and the objective's least distance.
    Housings,
    /// This distance, m.
    Distance(f64),
}

/// An objective over mounts as a search sees it.
#[derive(Clone, Debug)]
pub struct MountProblem {
    objective: Objective,
    search: MountSearch,
    keep_apart: KeepApart,
}

impl MountProblem {
    /// Searches masters 1 to `masters_max` for this objective; roll is free or fixed as its experiment says.
    pub fn new(objective: Objective, masters_max: u32, keep_apart: KeepApart) -> Self {
        let experiment = objective.simulator().experiment();
        let fixed_roll_deg = match experiment.roll {
            Roll::Fixed(roll_deg) => Some(roll_deg),
            Roll::Free => None,
        };
        let search = MountSearch {
            masters_max,
            fixed_roll_deg,
            is_mirrored: experiment.mirror,
            // a phase that moves on from pose to pose tells the two ends of the walk apart
            fore_aft_symmetry: experiment.phase == Phase::Locked,
        };
        Self { objective, search, keep_apart }
    }

    /// What is searched, with its symmetries and with what each number of masters could reach at most.
    pub fn space(&self) -> Result<Space, SpaceError> {
        let weights = self.objective.weights();
        let reachable = self.objective.simulator().reachable() as f64;
        let per_master = if self.search.is_mirrored { 2.0 } else { 1.0 };
        let rewards = weights.overlap_reward.max(0.0)
            + weights.angle_reward.max(0.0)
            + weights.best_registration_term();
        let ceiling = |masters| reachable + rewards - weights.sensor_cost * per_master * f64::from(masters);
        Ok(self.search.space()?.with_ceilings((1..=self.search.masters_max).map(ceiling).collect()))
    }

    /// The masters of a point.
    pub fn masters(&self, values: &[f64]) -> Vec<Placement> {
        self.search.masters(values)
    }

    /// The objective.
    pub fn objective(&self) -> &Objective {
        &self.objective
    }

    /// Scores a point. Violation: the distances that miss, summed, m, and the share by which the conditioning of
    /// registration falls short; sensors that may not be are still scored.
    pub fn measure(&self, values: &[f64]) -> Result<Measured, ExperimentError> {
        let masters = self.masters(values);
        let experiment = self.objective.simulator().experiment();
        let sensors = experiment.sensors(&masters);
        let counts = self.objective.simulator().count(&sensors)?;
        let quality = self.objective.registration(&sensors);
        Ok(Measured {
            score: self.objective.terms(&sensors, &counts, quality.as_ref()).objective(),
            violation: self.violation(&sensors) + self.objective.conditioning_shortfall(quality.as_ref()),
            rays: experiment.rays_per_sensor() * sensors.len() as u64,
        })
    }

    fn violation(&self, sensors: &[Placement]) -> f64 {
        let least_m = match self.keep_apart {
            KeepApart::None => return 0.0,
            KeepApart::Housings => self.objective.needed_distance_m(),
            KeepApart::Distance(least_m) => least_m,
        };
        let mut missing_m = 0.0;
        for (index, first) in sensors.iter().enumerate() {
            for second in &sensors[index + 1..] {
                let distance_m = first.mount().position_m().distance(second.mount().position_m());
                missing_m += (least_m - distance_m).max(0.0);
            }
        }
        missing_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_space_has_one_integer_and_25_continuous_variables() {
        let search =
            MountSearch { masters_max: 5, is_mirrored: true, fixed_roll_deg: None, fore_aft_symmetry: true };
        let space = search.space().unwrap();
        assert_eq!(space.len(), 26);
        assert_eq!(space.variables().iter().filter(|v| v.integer).count(), 1);
        let mut values = vec![0.0; 26];
        values[0] = 2.0;
        values[1..11].copy_from_slice(&[0.1, 0.2, -0.1, 30.0, 5.0, -0.05, 0.0, 0.0, -40.0, 0.0]);
        let masters: Vec<[f64; 5]> = search.masters(&values).into_iter().map(Into::into).collect();
        assert_eq!(masters, [[0.1, 0.2, -0.1, 30.0, 5.0], [-0.05, 0.0, 0.0, -40.0, 0.0]]);
    }

    #[test]
    fn equal_rigs_have_one_canonical_point() {
        let search =
            MountSearch { masters_max: 1, is_mirrored: true, fixed_roll_deg: None, fore_aft_symmetry: true };
        let space = search.space().unwrap();
        let one = space.canonical(&[1.0, 0.1, 0.2, 0.05, 30.0, 5.0]);
        assert_eq!(one, space.canonical(&[1.0, -0.1, 0.2, 0.05, -30.0, 5.0]));
        assert_eq!(one, space.canonical(&[1.0, -0.1, -0.2, 0.05, -30.0, -5.0]));
        assert_ne!(one, space.canonical(&[1.0, 0.1, 0.2, 0.05, -30.0, 5.0]));
    }

    #[test]
    fn a_tilt_fixed_off_zero_has_no_fore_aft_symmetry() {
        let search = MountSearch {
            masters_max: 1,
            is_mirrored: true,
            fixed_roll_deg: Some(5.0),
            fore_aft_symmetry: true,
        };
        let space = search.space().unwrap();
        assert_eq!(space.canonical(&[1.0, 0.1, -0.2, 0.0, 30.0])[2], -0.2);
        assert_eq!(search.masters(&[1.0, 0.1, -0.2, 0.0, 30.0]), [[0.1, -0.2, 0.0, 30.0, 5.0].into()]);
    }
}
