//! The point of maximum acquisition: searched all over the space, near the best points, and then around what was found.

use rayon::prelude::*;

use crate::base::rng::Rng;
use crate::design::optimize::forward_substitution::WIDTH;
use crate::design::optimize::gaussian_process::{Data, GaussianProcess, Hyper, Prediction};
use crate::design::optimize::{Acquisition, Space, normal};

/// Minimum deviation of the next point, as a ratio to the noise's.
const EXPLORATION_RATIO: f64 = 0.4;
const EXPLORATION_TRIES: usize = 5;
const GLOBAL_CANDIDATES: usize = 500;
const LOCAL_CANDIDATES: usize = 60;
/// Candidates that one thread takes at a time: as many as a solution of the model has elements.
const JUDGED_AT_ONCE: usize = WIDTH;
const REFINED: usize = 3;
const REFINE_ROUNDS: usize = 8;

/// The model's view of a space: the variables that matter somewhere in it.
pub(super) struct View<'a> {
    space: &'a Space,
    axes: Vec<usize>,
    /// Role of each axis, counted without gaps over the whole space.
    roles: Vec<usize>,
    pub role_count: usize,
}

impl<'a> View<'a> {
    pub(crate) fn new(space: &'a Space) -> Self {
        let variables = space.variables();
        let most: Vec<f64> = variables.iter().map(|variable| variable.high).collect();
        let axes = (0..space.len()).filter(|&axis| space.is_active(&most, axis)).collect::<Vec<_>>();
        let names = role_names(space);
        let place = |axis: &usize| names.iter().position(|name| *name == variables[*axis].role).unwrap_or(0);
        let roles = axes.iter().map(place).collect();
        Self { space, axes, roles, role_count: names.len() }
    }

    /// Where the design lies for the model: equal designs at one point.
    pub(crate) fn unit(&self, values: &[f64]) -> Vec<f64> {
        let unit = self.space.to_unit(&self.space.canonical(values));
        self.axes.iter().map(|&axis| unit[axis]).collect()
    }
}

/// The roles of a space, ascending, each once.
pub(super) fn role_names(space: &Space) -> Vec<usize> {
    let mut names: Vec<usize> = space.variables().iter().map(|variable| variable.role).collect();
    names.sort_unstable();
    names.dedup();
    names
}

/// What a proposal is made from.
pub(super) struct Known<'a> {
    pub space: &'a Space,
    pub view: &'a View<'a>,
    /// Of the unit cube.
    pub points: Vec<Vec<f64>>,
    pub merits: Vec<f64>,
    /// Maximum merit that was observed.
    pub max: f64,
    /// The best points, as values.
    pub centres: Vec<Vec<f64>>,
}

impl Known<'_> {
    pub(crate) fn data(&self) -> Data {
        Data::new(self.view.roles.clone(), self.view.role_count, self.points.clone(), self.merits.clone())
    }

    /// The point of maximum acquisition that the guard lets pass; none where no process can be made.
    pub(crate) fn most_promising(
        &self,
        mut hyper: Hyper,
        acquisition: Acquisition,
        rng: &mut Rng,
    ) -> Option<Vec<f64>> {
        let data = self.data();
        let mut found = None;
        for _ in 0..=EXPLORATION_TRIES {
            let Some(process) = GaussianProcess::new(data.clone(), &hyper) else { break };
            let (values, belief) = Hunt { known: self, process: &process, acquisition }.best(rng);
            found = Some(values);
            let least = EXPLORATION_RATIO * process.noise_deviation();
            if !acquisition.is_guarded() || belief.deviation >= least {
                break;
            }
            for length in &mut hyper.ln_lengths {
                *length -= std::f64::consts::LN_2;
            }
        }
        found
    }
}

/// The search for the point of maximum acquisition.
struct Hunt<'a> {
    known: &'a Known<'a>,
    process: &'a GaussianProcess,
    acquisition: Acquisition,
}

struct Prey {
    values: Vec<f64>,
    acquisition: f64,
    belief: Prediction,
}

impl Hunt<'_> {
    fn best(&self, rng: &mut Rng) -> (Vec<f64>, Prediction) {
        let mut candidates: Vec<Vec<f64>> =
            (0..GLOBAL_CANDIDATES).map(|_| self.known.space.sample(rng)).collect();
        for centre in &self.known.centres {
            for _ in 0..LOCAL_CANDIDATES {
                let scale = 10f64.powf(rng.between(-3.0, -0.7));
                candidates.push(self.nearby(centre, scale, rng));
            }
        }
        let mut prey = self.judge(candidates);
        prey.sort_by(|a, b| b.acquisition.total_cmp(&a.acquisition));
        prey.truncate(REFINED);
        for start in &mut prey {
            let mut scale = 0.05;
            for _ in 0..REFINE_ROUNDS {
                let around = (0..4 * self.known.view.axes.len().min(6))
                    .map(|_| self.nearby(&start.values, scale, rng));
                let found = self.judge(around.collect());
                match found.into_iter().max_by(|a, b| a.acquisition.total_cmp(&b.acquisition)) {
                    Some(found) if found.acquisition > start.acquisition => *start = found,
                    _ => scale *= 0.4,
                }
            }
        }
        prey.sort_by(|a, b| b.acquisition.total_cmp(&a.acquisition));
        let first = prey.swap_remove(0);
        (first.values, first.belief)
    }

    /// A point near another: free variables move by normal steps, integers seldom and by one.
    fn nearby(&self, centre: &[f64], scale: f64, rng: &mut Rng) -> Vec<f64> {
        let mut values = centre.to_vec();
        for index in self.known.space.free(centre) {
            let variable = &self.known.space.variables()[index];
            if variable.integer {
                if rng.uniform() < scale {
                    values[index] += if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
                }
            } else {
                values[index] += scale * (variable.high - variable.low) * rng.normal();
            }
        }
        self.known.space.clamp(&mut values);
        values
    }

    fn judge(&self, candidates: Vec<Vec<f64>>) -> Vec<Prey> {
        let units: Vec<Vec<f64>> = candidates.iter().map(|values| self.known.view.unit(values)).collect();
        let beliefs: Vec<Prediction> = units
            .par_chunks(JUDGED_AT_ONCE)
            .flat_map_iter(|group| self.process.predict_many(group))
            .collect();
        let one = |((values, unit), belief): ((Vec<f64>, &Vec<f64>), Prediction)| {
            let acquisition = if self.known.points.contains(unit) {
                f64::NEG_INFINITY
            } else {
                worth(self.acquisition, belief, self.process.noise_deviation(), self.known.max)
            };
            Prey { values, acquisition, belief }
        };
        candidates.into_iter().zip(&units).zip(beliefs).map(one).collect()
    }
}

/// What `acquisition` makes of a belief. With the noise it is about the next observation, and what counts in the end is
/// an observed score; without, about what lies under the noise.
fn worth(acquisition: Acquisition, belief: Prediction, noise_deviation: f64, max: f64) -> f64 {
    let excess = |deviation: f64| (belief.mean - max) / deviation;
    match acquisition {
        Acquisition::LogEiPlus | Acquisition::LogEi => {
            let deviation = belief.deviation.hypot(noise_deviation).max(1e-12);
            deviation.ln() + normal::ln_expected_excess(excess(deviation))
        }
        Acquisition::EiPlus | Acquisition::Ei => {
            let deviation = belief.deviation.max(1e-12);
            deviation * normal::expected_excess(excess(deviation))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::optimize::Variable;

    #[test]
    fn the_guard_refuses_points_that_noise_hides() {
        let variable =
            Variable { name: "x".into(), low: 0.0, high: 1.0, integer: false, active_from: None, role: 0 };
        let space = Space::new(vec![variable]).unwrap();
        let view = View::new(&space);
        let points: Vec<Vec<f64>> = (0..21).map(|i| vec![0.05 * f64::from(i)]).collect();
        let merits: Vec<f64> = points.iter().map(|x| 1.0 - 8.0 * (x[0] - 0.52).powi(2)).collect();
        let known = Known { space: &space, view: &view, points, merits, max: 1.0, centres: vec![vec![0.5]] };
        let hyper = Hyper { ln_lengths: vec![0.0], ln_noise: 0.0 };
        let process = GaussianProcess::new(known.data(), &hyper).unwrap();
        let least = EXPLORATION_RATIO * process.noise_deviation();
        let chosen =
            |acquisition| known.most_promising(hyper.clone(), acquisition, &mut Rng::new(1, 0)).unwrap();
        for (free, guarded) in
            [(Acquisition::LogEi, Acquisition::LogEiPlus), (Acquisition::Ei, Acquisition::EiPlus)]
        {
            let hidden = chosen(free);
            let deviation = process.predict_many(std::slice::from_ref(&hidden))[0].deviation;
            assert!(deviation < least, "{free:?}: {deviation} at {hidden:?}, noise {least}");
            assert_ne!(chosen(guarded), hidden, "{guarded:?}");
        }
    }
}
