//! Bayesian optimization: a Gaussian process of the scores so far, and the point of maximum expected improvement.
//!
//! Jones, Schonlau, Welch 1998 (doi:10.1023/A:1008306431147); logarithm of the improvement: Ament et al. 2023
//! (arXiv:2310.20708); the guard against over-exploitation is the "plus" of Bull 2011
//! (<https://www.jmlr.org/papers/v12/bull11a.html>): a point with a deviation far below the noise is refused, the
//! length scales are shortened and the question is asked again. Equal designs are one point to the model: symmetries are
//! folded, inactive variables are parked.

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

use self::hunt::{Known, View, role_names};
use self::merits::merits;
use super::gaussian_process::{Data, Hyper};
use super::{Acquisition, Candidate, Optimizer, Settings, Space, Trial, Variable, generator};
use crate::base::rng::Rng;

mod hunt;
mod merits;

const SEED_POINTS: usize = 12;
/// Published stopping rule: the best of the last so many evaluations grew by less than this, relative.
const STALL_EVALUATIONS: usize = 50;
const STALL_TOLERANCE: f64 = 1e-5;
/// Data that say enough for the parameters not to jump to another optimum.
const REFIT_FROM_ONE_START: usize = 60;
const LOCAL_CENTRES: usize = 5;
/// Share of the evaluations that a count gets which can still win but has not the best point, and how many at most.
const OTHER_SHARE: f64 = 0.2;
const OTHER_MAX: usize = 40;
/// Points from which on a count has a model of its own.
const OTHER_MODELLED_FROM: usize = 4;
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
        let max = merits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut order: Vec<usize> = (0..known.len()).collect();
        order.sort_by(|&a, &b| known[a].order(known[b]));
        let centres =
            order.iter().take(LOCAL_CENTRES).map(|&index| known[index].candidate.values.clone()).collect();
        let mut known = Known { space: &space, view: &view, points, merits, max, centres };
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

fn is_inside(space: &Space, trial: &Trial) -> bool {
    let first = &space.variables()[0];
    (first.low..=first.high).contains(&trial.candidate.values[0])
}
