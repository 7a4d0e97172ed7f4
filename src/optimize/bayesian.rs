//! Bayesian optimization: a Gaussian process of the scores so far, and the point of greatest expected improvement.
//!
//! Jones, Schonlau, Welch 1998 (doi:10.1023/A:1008306431147); logarithm of the improvement: Ament et al. 2023
//! (arXiv:2310.20708); the guard against over-exploitation is the "plus" of Bull 2011
//! (<https://www.jmlr.org/papers/v12/bull11a.html>): a point whose deviation is small beside the noise is refused, the
//! length scales are shortened and the question is asked again. Equal designs are one point to the model: symmetries are
//! folded, inactive variables are parked.

use std::num::NonZeroUsize;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::forward_substitution::LANES;
use super::gaussian_process::{Data, GaussianProcess, Hyper, Prediction};
use super::{Acquisition, Candidate, Optimizer, Settings, Space, Trial, Variable, generator, normal};
use crate::rng::Rng;

const SEED_POINTS: usize = 12;
/// Least deviation of the next point beside the noise's.
const EXPLORATION_RATIO: f64 = 0.4;
const EXPLORATION_TRIES: usize = 5;
/// Published stopping rule: the best of the last so many evaluations grew by less than this, relative.
const STALL_EVALUATIONS: usize = 50;
const STALL_TOLERANCE: f64 = 1e-5;
/// Data that say enough for the parameters not to jump to another optimum.
const REFIT_FROM_ONE_START: usize = 60;
const GLOBAL_CANDIDATES: usize = 500;
const LOCAL_CENTRES: usize = 5;
const LOCAL_CANDIDATES: usize = 60;
/// Candidates that one thread takes at a time: as many as a solution of the model has lanes.
const JUDGED_AT_ONCE: usize = LANES;
/// Share of the evaluations that a count gets which can still win but has not the best point, and how many at most.
const OTHER_SHARE: f64 = 0.2;
const OTHER_MAX: usize = 40;
/// Points from which on a count has a model of its own.
const OTHER_MODELLED_FROM: usize = 4;
const REFINED: usize = 3;
const REFINE_ROUNDS: usize = 8;

/// Bayesian optimization with a Gaussian process.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Bayesian {
    space: Space,
    seed: u64,
    seed_points: usize,
    early_stop: bool,
    batch: NonZeroUsize,
    acquisition: Acquisition,
    step: u64,
    trials: Vec<Trial>,
    /// Best so far after each trial.
    bests: Vec<usize>,
    fitted: Option<Fitted>,
    /// The same for the proposals made for a count apart.
    fitted_apart: Option<Fitted>,
}

/// Parameters of the process, and how many trials they are from.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Fitted {
    hyper: Hyper,
    trials: usize,
}

impl Bayesian {
    /// Nothing evaluated yet.
    pub fn new(space: Space, settings: Settings) -> Self {
        Self {
            space: space.folded(),
            seed: settings.seed,
            seed_points: SEED_POINTS.min(settings.budget),
            early_stop: settings.early_stop,
            batch: settings.batch,
            acquisition: settings.acquisition,
            step: 0,
            trials: Vec::new(),
            bests: Vec::new(),
            fitted: None,
            fitted_apart: None,
        }
    }

    /// Starts from what is known already instead of from points of its own.
    pub(super) fn continued(space: Space, settings: Settings, trials: Vec<Trial>) -> Self {
        let mut method = Self::new(space, settings);
        method.seed_points = trials.len();
        method.tell(&trials);
        method
    }

    /// The length scale of each variable, as a share of its range, once the process is fitted.
    pub(super) fn lengths(&self) -> Option<Vec<f64>> {
        let hyper = &self.fitted.as_ref()?.hyper;
        let names = role_names(&self.space);
        let of = |variable: &Variable| {
            let place = names.iter().position(|name| *name == variable.role)?;
            hyper.ln_lengths.get(place).map(|ln| ln.exp())
        };
        self.space.variables().iter().map(of).collect()
    }

    fn is_stalled(&self) -> bool {
        let now = self.trials.len();
        if now <= STALL_EVALUATIONS || self.seed_points >= now {
            return false;
        }
        let score = |index: usize| &self.trials[self.bests[index]];
        let (then, now) = (score(now - 1 - STALL_EVALUATIONS), score(now - 1));
        now.violation == then.violation
            && (now.score - then.score).abs() < STALL_TOLERANCE * now.score.abs().max(1e-12)
    }

    /// Where the next proposal lies: among what can beat the best point, or in the part of it at one count, and whether
    /// it is that part.
    fn next_space(&self, best: &Trial) -> (Space, bool) {
        if best.violation > 0.0 {
            return (self.space.clone(), false);
        }
        let space = self.space.that_can_exceed(best.score);
        match self.neglected(&space, best) {
            Some(count) => (space.at_count(count), true),
            None => (space, false),
        }
    }

    /// The count that the next proposal is for although the best point has another. Where many sensors see nearly all
    /// there is, whatever their tilts, their scores lie so close together that the model, scaled by them, never gets to
    /// fewer sensors, of which only the well tilted ones are better.
    fn neglected(&self, space: &Space, best: &Trial) -> Option<f64> {
        let count_of = |trial: &Trial| trial.candidate.values[0];
        let due = OTHER_MAX.min((OTHER_SHARE * self.trials.len() as f64) as usize);
        let had = |count: f64| self.trials.iter().filter(|trial| count_of(trial) == count).count();
        space
            .ceilings()
            .filter(|(count, ceiling)| *count != count_of(best) && *ceiling > best.score && had(*count) < due)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(count, _)| count)
    }

    /// The next points. Those after the first reckon with the ones before as if they had come out at the median: a
    /// constant liar (Ginsbourger, Le Riche, Carraro 2010, doi:10.1007/978-3-642-10701-6_6).
    fn propose(&mut self) -> Vec<Candidate> {
        let mut rng = generator(self.seed, self.step);
        self.step += 1;
        let best = &self.trials[self.bests[self.trials.len() - 1]];
        let (space, is_apart) = self.next_space(best);
        let view = View::new(&space);
        let known: Vec<&Trial> = self.trials.iter().filter(|trial| is_inside(&space, trial)).collect();
        if is_apart && known.len() < OTHER_MODELLED_FROM {
            return (0..self.batch.get()).map(|_| Candidate { values: space.sample(&mut rng) }).collect();
        }
        let points: Vec<Vec<f64>> = known.iter().map(|trial| view.unit(&trial.candidate.values)).collect();
        let merits = merits(&known);
        let greatest = merits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut order: Vec<usize> = (0..known.len()).collect();
        order.sort_by(|&a, &b| known[a].order(known[b]));
        let centres =
            order.iter().take(LOCAL_CENTRES).map(|&index| known[index].candidate.values.clone()).collect();
        let mut known = Known { space: &space, view: &view, points, merits, greatest, centres };
        let fitted = if is_apart { &mut self.fitted_apart } else { &mut self.fitted };
        let hyper = Fitted::renewed(fitted, &known.data(), view.role_count, &mut rng);
        let mut merits = known.merits.clone();
        merits.sort_by(f64::total_cmp);
        let lie = merits[merits.len() / 2];
        let mut proposed = Vec::with_capacity(self.batch.get());
        while proposed.len() < self.batch.get() {
            let values = known.most_promising(hyper.clone(), self.acquisition, &mut rng);
            let values = values.unwrap_or_else(|| space.sample(&mut rng));
            known.points.push(view.unit(&values));
            known.merits.push(lie);
            proposed.push(Candidate { values });
        }
        proposed
    }
}

impl Fitted {
    /// Fits when the data have grown by a tenth since the last fit: from the parameters found then, or from several
    /// starts at first.
    fn renewed(last: &mut Option<Self>, data: &Data, roles: usize, rng: &mut Rng) -> Hyper {
        let trials = data.count();
        if let Some(fitted) = last
            && (fitted.trials..fitted.trials + 1 + fitted.trials / 12).contains(&trials)
        {
            return fitted.hyper.clone();
        }
        let mut random = || {
            let mut start = Hyper::typical(roles);
            for length in &mut start.ln_lengths {
                *length += 1.5 * (rng.uniform() - 0.5);
            }
            start.ln_noise = rng.between(-12.0, -1.0);
            start
        };
        let (starts, iterations) = match last {
            Some(fitted) if trials > REFIT_FROM_ONE_START => (vec![fitted.hyper.clone()], 8),
            Some(fitted) => (vec![fitted.hyper.clone(), random()], 20),
            None => (std::iter::once(Hyper::typical(roles)).chain((0..4).map(|_| random())).collect(), 40),
        };
        let hyper = data.fit(&starts, iterations);
        *last = Some(Self { hyper: hyper.clone(), trials });
        hyper
    }
}

impl Optimizer for Bayesian {
    fn ask(&mut self) -> Vec<Candidate> {
        if self.trials.is_empty() {
            let points = self.space.latin_hypercube(self.seed_points, &mut generator(self.seed, u64::MAX));
            return points.into_iter().map(|values| Candidate { values }).collect();
        }
        if self.early_stop && self.is_stalled() {
            return Vec::new();
        }
        self.propose()
    }

    fn tell(&mut self, trials: &[Trial]) {
        for trial in trials {
            let index = self.trials.len();
            let best = match self.bests.last() {
                Some(&best) if !trial.beats(&self.trials[best]) => best,
                _ => index,
            };
            self.bests.push(best);
            self.trials.push(trial.clone());
        }
    }
}

/// The model's view of a space: the variables that matter somewhere in it.
struct View<'a> {
    space: &'a Space,
    axes: Vec<usize>,
    /// Role of each axis, counted without gaps over the whole space.
    roles: Vec<usize>,
    role_count: usize,
}

impl<'a> View<'a> {
    fn new(space: &'a Space) -> Self {
        let variables = space.variables();
        let most: Vec<f64> = variables.iter().map(|variable| variable.high).collect();
        let axes = (0..space.len()).filter(|&axis| space.is_active(&most, axis)).collect::<Vec<_>>();
        let names = role_names(space);
        let place = |axis: &usize| names.iter().position(|name| *name == variables[*axis].role).unwrap_or(0);
        let roles = axes.iter().map(place).collect();
        Self { space, axes, roles, role_count: names.len() }
    }

    /// Where the design lies for the model: equal designs at one point.
    fn unit(&self, values: &[f64]) -> Vec<f64> {
        let unit = self.space.to_unit(&self.space.canonical(values));
        self.axes.iter().map(|&axis| unit[axis]).collect()
    }
}

/// The roles of a space, ascending, each once.
fn role_names(space: &Space) -> Vec<usize> {
    let mut names: Vec<usize> = space.variables().iter().map(|variable| variable.role).collect();
    names.sort_unstable();
    names.dedup();
    names
}

fn is_inside(space: &Space, trial: &Trial) -> bool {
    let first = &space.variables()[0];
    (first.low..=first.high).contains(&trial.candidate.values[0])
}

/// Scores made fit for a stationary model: standardised by the better half, the worse half drawn in logarithmically, so
/// that a cliff far below does not flatten the top; infeasible points lie below the worst feasible one, by their
/// violation.
fn merits(trials: &[&Trial]) -> Vec<f64> {
    let feasible: Vec<f64> = trials.iter().filter(|t| t.violation == 0.0).map(|t| t.score).collect();
    let greatest_violation = trials.iter().map(|t| t.violation).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut sorted = feasible.clone();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let median = at(0.5);
    let spread = (sorted.last().copied().unwrap_or(0.0) - median).max(1e-9 * median.abs()).max(1e-12);
    let draw_in = |score: f64| {
        let z = (score - median) / spread;
        if z >= 0.0 { z } else { -(1.0 - z).ln() }
    };
    let worst = sorted.first().map_or(0.0, |score| draw_in(*score));
    trials
        .iter()
        .map(|t| match t.violation {
            0.0 => draw_in(t.score),
            violation => worst - 0.2 - violation / greatest_violation,
        })
        .collect()
}

/// What a proposal is made from.
struct Known<'a> {
    space: &'a Space,
    view: &'a View<'a>,
    /// Of the unit cube.
    points: Vec<Vec<f64>>,
    merits: Vec<f64>,
    /// Greatest merit that was observed.
    greatest: f64,
    /// The best points, as values.
    centres: Vec<Vec<f64>>,
}

impl Known<'_> {
    fn data(&self) -> Data {
        Data::new(self.view.roles.clone(), self.view.role_count, self.points.clone(), self.merits.clone())
    }

    /// The point of greatest acquisition that the guard lets pass; none where no process can be made.
    fn most_promising(&self, mut hyper: Hyper, acquisition: Acquisition, rng: &mut Rng) -> Option<Vec<f64>> {
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

/// The search for the point of greatest acquisition.
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
                worth(self.acquisition, belief, self.process.noise_deviation(), self.known.greatest)
            };
            Prey { values, acquisition, belief }
        };
        candidates.into_iter().zip(&units).zip(beliefs).map(one).collect()
    }
}

/// What `acquisition` makes of a belief. With the noise it is about the next observation, and what counts in the end is
/// an observed score; without, about what lies under the noise.
fn worth(acquisition: Acquisition, belief: Prediction, noise_deviation: f64, greatest: f64) -> f64 {
    let excess = |deviation: f64| (belief.mean - greatest) / deviation;
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

    fn trial(score: f64, violation: f64) -> Trial {
        Trial { candidate: Candidate { values: vec![] }, score, violation }
    }

    #[test]
    fn merits_keep_the_order_of_trials() {
        let mut trials: Vec<Trial> = (0..20).map(|i| trial(f64::from(i * i), 0.0)).collect();
        trials.extend((1..5).map(|i| self::trial(1e6, f64::from(i))));
        let all: Vec<&Trial> = trials.iter().collect();
        let merits = merits(&all);
        for a in 0..all.len() {
            for b in 0..all.len() {
                assert_eq!(all[a].beats(all[b]), merits[a] > merits[b], "{:?} {:?}", all[a], all[b]);
            }
        }
    }

    #[test]
    fn equal_scores_give_equal_finite_merits() {
        let trials = vec![trial(5.0, 0.0); 4];
        assert!(merits(&trials.iter().collect::<Vec<_>>()).iter().all(|m| *m == 0.0));
    }

    #[test]
    fn the_guard_refuses_points_that_noise_hides() {
        let variable =
            Variable { name: "x".into(), low: 0.0, high: 1.0, integer: false, active_from: None, role: 0 };
        let space = Space::new(vec![variable]).unwrap();
        let view = View::new(&space);
        let points: Vec<Vec<f64>> = (0..21).map(|i| vec![0.05 * f64::from(i)]).collect();
        let merits: Vec<f64> = points.iter().map(|x| 1.0 - 8.0 * (x[0] - 0.52).powi(2)).collect();
        let known =
            Known { space: &space, view: &view, points, merits, greatest: 1.0, centres: vec![vec![0.5]] };
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
