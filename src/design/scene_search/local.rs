//! Steps from the best mounts.

use std::sync::atomic::{AtomicBool, Ordering};

use super::quadratic::Quadratic;
use super::search::{SPARSE, SceneSearch};
use crate::base::rng::Rng;

/// Standard deviation of the first and the last step of a local search, as shares of each variable's range.
const STEP_SHARES: [f64; 2] = [0.15, 0.02];
/// Mounts from which a local search steps, and steps between two looks at which are best.
const PARENTS: usize = 8;
const CHILDREN: usize = 16;
/// Of those aimed at the top of a quadratic through good mounts one lies there, the others are so near, in steps.
const JITTER: f64 = 0.3;
/// The top is looked for within so many steps; the mounts of the quadratic lie within twice as many, at least within a tenth of
/// each variable's range.
const TRUSTED_STEPS: f64 = 2.0;
const LEAST_REACH: f64 = 0.1;

impl SceneSearch<'_> {
    /// The `round`th local search, from 1. Steps from the best mounts, ever shorter, until so many are looked at: an evolution
    /// strategy with the best as parents, with differences between parents for directions (Storn, Price 1997,
    /// doi:10.1023/A:1008202821328).
    pub(super) fn search_locally(
        &mut self,
        limit: usize,
        round: usize,
        progress: &dyn Fn(&Self, &str),
        stop: &AtomicBool,
    ) {
        let round = round.min(2);
        let mut rng = Rng::new(self.plan.seed, round as u64);
        let [first_share, last_share] = STEP_SHARES.map(|share| share / round as f64);
        let first = self.tried.len();
        while self.tried.len() < limit && !stop.load(Ordering::Relaxed) {
            let done = (self.tried.len() - first) as f64 / (limit - first) as f64;
            let share = first_share * (last_share / first_share).powf(done);
            let ranked = self.ranked();
            let groups = if round == 1 { self.by_pitch_signs(&ranked) } else { vec![ranked] };
            let aimed = self.plan.aimed;
            let top = |group: &Vec<usize>| if aimed > 0 { self.top(group, share) } else { None };
            let tops: Vec<Option<Vec<f64>>> = groups.iter().map(top).collect();
            let child = |at: usize| {
                let own = at % groups.len();
                match &tops[own] {
                    Some(top) if at < groups.len() => top.clone(),
                    Some(top) if at < aimed => self.stepped(top.clone(), JITTER * share, &mut rng),
                    _ => self.child(&groups[own][..PARENTS.min(groups[own].len())], share, &mut rng),
                }
            };
            let points: Vec<Vec<f64>> = (0..CHILDREN.min(limit - self.tried.len())).map(child).collect();
            self.look(&points, SPARSE[round]);
            progress(self, "looking at mounts around the best ones");
        }
    }

    /// Where a quadratic through the best of these is highest, some steps around the very best; none where they are too few.
    fn top(&self, ranked: &[usize], share: f64) -> Option<Vec<f64>> {
        let near = TRUSTED_STEPS * share;
        let allowed = ranked.iter().map(|at| &self.tried[*at]).filter(|tried| tried.violation == 0.0);
        let scored: Vec<(Vec<f64>, f64)> =
            allowed.map(|tried| (self.space.to_unit(&tried.values), self.corrected(tried))).collect();
        let quadratic = Quadratic::fit(&scored, (2.0 * near).max(LEAST_REACH))?;
        Some(self.space.values_at(&quadratic.highest(near)))
    }

    fn child(&self, parents: &[usize], share: f64, rng: &mut Rng) -> Vec<f64> {
        let mut parent = |power: i32| {
            let at = (rng.uniform().powi(power) * parents.len() as f64) as usize;
            &self.tried[parents[at.min(parents.len() - 1)]].values
        };
        let (start, one, other) = (parent(2), parent(1), parent(1));
        let along = if rng.uniform() < 0.5 { 0.5 } else { 0.0 };
        let mut child = start.clone();
        child
            .iter_mut()
            .zip(one.iter().zip(other))
            .for_each(|(value, (one, other))| *value += along * (one - other));
        self.stepped(child, share, rng)
    }

    /// A step of each variable, normally distributed.
    pub(super) fn stepped(&self, mut values: Vec<f64>, share: f64, rng: &mut Rng) -> Vec<f64> {
        for (value, variable) in values.iter_mut().zip(self.space.variables()) {
            *value += share * (variable.high - variable.low) * rng.normal();
        }
        self.space.clamp(&mut values);
        values
    }
}
