//! Mounts as a search space: how many masters, where and how tilted each is, and of which type where a rig may mix types.

use serde::{Deserialize, Serialize};

use super::{Measured, Mirror, Space, SpaceError, Variable};
use crate::design::objective::{ExperimentError, Objective};
use crate::design::robustness::{Criterion, Robustness, Spread};
use crate::rig::{Clearance, MountDeg, Phase, Rig, Roll};

/// Maximum number of masters of the published space.
pub const PUBLISHED_MASTERS_MAX: u32 = 5;

/// Where a master may sit and how far it may tilt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MountBounds {
    /// Right of the platform's origin, m.
    pub x_m: (f64, f64),
    /// Ahead of it, m.
    pub y_m: (f64, f64),
    /// Above it, m.
    pub z_m: (f64, f64),
    /// About the forward axis, degrees: what the servo reaches.
    pub pitch_deg: (f64, f64),
    /// About the lateral axis, degrees.
    pub roll_deg: (f64, f64),
}

impl Default for MountBounds {
    /// As published.
    fn default() -> Self {
        Self {
            x_m: (-0.10, 0.15),
            y_m: (-0.25, 0.25),
            z_m: (-0.15, 0.15),
            pitch_deg: (-90.0, 90.0),
            roll_deg: (-90.0, 90.0),
        }
    }
}

impl MountBounds {
    fn named(&self) -> [(&'static str, (f64, f64)); 5] {
        [
            ("x_m", self.x_m),
            ("y_m", self.y_m),
            ("z_m", self.z_m),
            ("pitch_deg", self.pitch_deg),
            ("roll_deg", self.roll_deg),
        ]
    }
}

/// What about the mounts is searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MountSearch {
    /// At least so many masters, from 1.
    pub masters_min: u32,
    /// At most so many.
    pub masters_max: u32,
    /// Sensor types to choose from for each master.
    pub types: usize,
    /// Where they may be.
    pub bounds: MountBounds,
    /// Pitch and roll are whole multiples of this, degrees: the step of a servo or of a drilled plate.
    pub tilt_step_deg: Option<f64>,
    /// Roll of every master in degrees; searched when `None`.
    pub fixed_roll_deg: Option<f64>,
    /// Whether each master has a mirror image.
    pub is_mirrored: bool,
    /// Whether a master and its image may change places without a change of the score.
    pub is_mirrored_exactly: bool,
    /// Whether scene and path look the same from both ends of the platform (y and roll change sign).
    pub fore_aft_symmetry: bool,
}

impl MountSearch {
    /// What is searched in an objective's experiment as published: 1 master up to so many, published bounds, no steps.
    pub fn of(objective: &Objective, masters_max: u32) -> Self {
        let experiment = objective.simulator().experiment();
        Self {
            masters_min: 1,
            masters_max,
            types: experiment.type_count(),
            bounds: MountBounds::default(),
            tilt_step_deg: None,
            fixed_roll_deg: match experiment.roll {
                Roll::Fixed(roll_deg) => Some(roll_deg),
                Roll::Free => None,
            },
            is_mirrored: experiment.mirror,
            is_mirrored_exactly: experiment.mirror,
            // a phase that moves on from pose to pose tells the two ends of the walk apart
            fore_aft_symmetry: experiment.phase == Phase::Locked,
        }
    }

    /// The space: the number of masters, then x, y, z, pitch, if it is free roll, and where there are several the type of
    /// each, an integer from 0. A master beyond the number is inactive. Symmetries: a master and its mirror image may change places, and so may masters.
    pub fn space(&self) -> Result<Space, SpaceError> {
        let mut variables = vec![Variable {
            name: "masters".into(),
            low: f64::from(self.masters_min),
            high: f64::from(self.masters_max),
            integer: true,
            active_from: None,
            role: 0,
        }];
        let mut blocks = Vec::new();
        let mut mirrors = Vec::new();
        let coordinates = self.coordinates();
        let MountBounds { x_m, y_m, pitch_deg, roll_deg, .. } = self.bounds;
        let is_even = |(low, high): (f64, f64)| low == -high;
        for master in 1..=self.masters_max {
            let first = variables.len();
            for (role, (name, (low, high))) in self.bounds.named().into_iter().take(coordinates).enumerate() {
                variables.push(Variable {
                    name: format!("master {master} {name}"),
                    low,
                    high,
                    integer: false,
                    active_from: (master > self.masters_min).then_some(master),
                    role: role + 1,
                });
            }
            if self.types > 1 {
                variables.push(Variable {
                    name: format!("master {master} type"),
                    low: 0.0,
                    high: (self.types - 1) as f64,
                    integer: true,
                    active_from: (master > self.masters_min).then_some(master),
                    role: coordinates + 1,
                });
            }
            if self.is_mirrored_exactly && is_even(pitch_deg) && x_m.0 <= 0.0 && x_m.1 >= -x_m.0 {
                mirrors.push(Mirror { key: first, negated: vec![first, first + 3] });
            }
            blocks.push((first..variables.len()).collect::<Vec<usize>>());
        }
        let rolls_even = self.fixed_roll_deg.map_or(is_even(roll_deg), |roll| roll == 0.0);
        if self.fore_aft_symmetry && is_even(y_m) && rolls_even {
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
    pub(crate) fn masters(&self, values: &[f64]) -> Vec<MountDeg> {
        let roll_deg = self.fixed_roll_deg.unwrap_or(0.0);
        let stepped = |angle_deg: f64, (low, high): (f64, f64)| match self.tilt_step_deg {
            // the last whole step inside the bounds
            Some(step_deg) => {
                let least = (low / step_deg).ceil();
                (angle_deg / step_deg).round().clamp(least, (high / step_deg).floor().max(least)) * step_deg
            }
            None => angle_deg,
        };
        let coordinates = self.coordinates();
        let master = |v: &[f64]| {
            let (v, sensor_type) = v.split_at(coordinates);
            let roll_deg = v.get(4).map_or(roll_deg, |free_deg| stepped(*free_deg, self.bounds.roll_deg));
            let placed = MountDeg::from([v[0], v[1], v[2], stepped(v[3], self.bounds.pitch_deg), roll_deg]);
            MountDeg { sensor_type: sensor_type.first().map_or(0, |index| *index as usize), ..placed }
        };
        let per_master = coordinates + usize::from(self.types > 1);
        values[1..].chunks_exact(per_master).take(values[0] as usize).map(master).collect()
    }

    /// Real variables of a master.
    fn coordinates(&self) -> usize {
        if self.fixed_roll_deg.is_some() { 4 } else { 5 }
    }
}

/// How far apart a search must keep sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KeepApart {
    /// None: sensors may lie in each other, as in the published runs.
    None,
    /// The housings, which may not touch as they are tilted, and the objective's least distance.
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
    robust: Option<(Robustness, Criterion)>,
}

impl MountProblem {
    /// Searches masters 1 to `masters_max` for this objective; roll is free or fixed as its experiment says.
    pub fn new(objective: Objective, masters_max: u32, keep_apart: KeepApart) -> Self {
        let search = MountSearch::of(&objective, masters_max);
        Self::with_search(objective, search, keep_apart)
    }

    /// The space with the given search settings.
    pub(crate) fn with_search(objective: Objective, search: MountSearch, keep_apart: KeepApart) -> Self {
        Self { objective, search, keep_apart, robust: None }
    }

    /// The same with the expected or the worst J of a built rig in place of J as planned. Errors of mounting differ from
    /// sensor to sensor: two ends of the walk are then no longer alike.
    pub(crate) fn robust(mut self, robustness: Robustness, criterion: Criterion) -> Self {
        self.search.fore_aft_symmetry = false;
        self.search.is_mirrored_exactly = false;
        self.robust = Some((robustness, criterion));
        self
    }

    /// What mount errors are reckoned with, if any.
    pub(crate) fn robustness(&self) -> Option<(&Robustness, Criterion)> {
        self.robust.as_ref().map(|(robustness, criterion)| (robustness, *criterion))
    }

    /// J over mount errors of these masters, where they are reckoned with.
    pub(crate) fn spread(&self, masters: &[MountDeg]) -> Result<Option<Spread>, ExperimentError> {
        let rig = self.objective.rig(masters);
        self.robust.as_ref().map(|(robustness, _)| robustness.spread(&rig)).transpose()
    }

    /// What is searched.
    pub(crate) fn search(&self) -> &MountSearch {
        &self.search
    }

    /// What is searched, with its symmetries and with what each number of masters could reach at most.
    pub fn space(&self) -> Result<Space, SpaceError> {
        let counts = self.search.masters_min..=self.search.masters_max;
        Ok(self.search.space()?.with_ceilings(counts.map(|masters| self.ceiling(masters)).collect()))
    }

    /// What no rig of so many masters can exceed: every voxel that can be hit, every reward, and no sensor but of the
    /// cheapest type.
    pub(crate) fn ceiling(&self, masters: u32) -> f64 {
        let weights = self.objective.weights();
        let reachable = self.objective.simulator().reachable() as f64;
        let per_master = if self.search.is_mirrored { 2.0 } else { 1.0 };
        let rewards = weights.overlap_reward.max(0.0)
            + weights.angle_reward.max(0.0)
            + weights.best_registration_term();
        let cheapest = self.objective.prices().iter().copied().fold(f64::INFINITY, f64::min);
        reachable + rewards - cheapest * per_master * f64::from(masters)
    }

    /// The masters of a point.
    pub fn masters(&self, values: &[f64]) -> Vec<MountDeg> {
        self.search.masters(values)
    }

    /// The objective.
    pub fn objective(&self) -> &Objective {
        &self.objective
    }

    /// Scores a point. Violation: the distances that miss, summed, m, and the share by which the conditioning of
    /// registration falls short; sensors that may not be are still scored.
    pub fn measure(&self, values: &[f64]) -> Result<Measured, ExperimentError> {
        let rig = self.objective.rig(&self.masters(values));
        let rays = self.objective.simulator().rays(&rig);
        let (score, quality, draws) = match &self.robust {
            Some((robustness, criterion)) => {
                (robustness.judge(&rig, *criterion)?, self.objective.registration(&rig), robustness.draws())
            }
            None => {
                let (terms, quality) = self.objective.measure(&rig)?;
                (terms.objective(), quality, 1)
            }
        };
        let shortfall = self.objective.weights().conditioning_shortfall(quality.as_ref());
        Ok(Measured { score, violation: self.too_close_m(&rig) + shortfall, rays: rays * draws as u64 })
    }

    fn too_close_m(&self, rig: &Rig) -> f64 {
        let missing_m = |needed_m: &dyn Fn(&Clearance) -> f64| {
            let pairs = rig.clearances(self.objective.least_distance_m());
            pairs.iter().fold(0.0, |sum_m, pair| sum_m + (needed_m(pair) - pair.distance_m).max(0.0))
        };
        match self.keep_apart {
            KeepApart::None => 0.0,
            KeepApart::Housings => missing_m(&|pair| pair.needed_m) + rig.housing_shortfall_m(),
            KeepApart::Distance(least_m) => missing_m(&|_| least_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn searched(masters_max: u32, fixed_roll_deg: Option<f64>) -> MountSearch {
        let objective = Objective::published("paper-os1-64", |_| ()).unwrap();
        MountSearch { fixed_roll_deg, ..MountSearch::of(&objective, masters_max) }
    }

    #[test]
    fn the_published_space_has_one_integer_and_25_continuous_variables() {
        let search = searched(5, None);
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
        let search = searched(1, None);
        let space = search.space().unwrap();
        let one = space.canonical(&[1.0, 0.1, 0.2, 0.05, 30.0, 5.0]);
        assert_eq!(one, space.canonical(&[1.0, -0.1, 0.2, 0.05, -30.0, 5.0]));
        assert_eq!(one, space.canonical(&[1.0, -0.1, -0.2, 0.05, -30.0, -5.0]));
        assert_ne!(one, space.canonical(&[1.0, 0.1, 0.2, 0.05, -30.0, 5.0]));
    }

    #[test]
    fn a_tilt_fixed_off_zero_has_no_fore_aft_symmetry() {
        let search = searched(1, Some(5.0));
        let space = search.space().unwrap();
        assert_eq!(space.canonical(&[1.0, 0.1, -0.2, 0.0, 30.0])[2], -0.2);
        assert_eq!(search.masters(&[1.0, 0.1, -0.2, 0.0, 30.0]), [[0.1, -0.2, 0.0, 30.0, 5.0].into()]);
    }

    #[test]
    fn tilts_come_in_steps_within_the_servo_s_limits() {
        let mut search = searched(1, Some(0.0));
        search.bounds.pitch_deg = (-31.0, 47.0);
        search.tilt_step_deg = Some(2.5);
        let space = search.space().unwrap();
        assert_eq!(space.folded().variables()[1].low, -0.1, "uneven limits leave no mirror to fold");
        let pitch = |at: f64| search.masters(&[1.0, 0.0, 0.0, 0.0, at])[0].pitch_deg;
        assert_eq!([pitch(-31.0), pitch(1.2), pitch(1.3), pitch(47.0)], [-30.0, 0.0, 2.5, 45.0]);
    }

    #[test]
    fn a_least_number_of_masters_is_always_active() {
        let mut search = searched(3, Some(0.0));
        search.masters_min = 2;
        let space = search.space().unwrap();
        assert_eq!(space.free(&[2.0; 13]), (0..9).collect::<Vec<_>>());
    }
}
