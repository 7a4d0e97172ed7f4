//! The two levels: a spread and local searches on the model, exact evaluations that correct it, local searches again, exact
//! finalists and steps from the best. Where all beams of a rig are too many, a thinned view judges, and all beams the best of them.

use std::sync::atomic::{AtomicBool, Ordering};

use super::correction::{Correction, ModelError, Modelled, Observed};
use super::exact::{Exact, tilt_rad};
use super::plan::{Judges, Plan};
use super::state_file::Findings;
use super::{RigSpace, SceneWeights};
use crate::base::rng::Rng;
use crate::design::optimize::{Candidate, Space, SpaceError, StoppedBy, Trial};
use crate::rig::Rig;
use crate::simulate::view::{CellSites, Seen};

/// In the spread, in the first local search and in those after it every so many voxels are looked at.
pub(super) const SPARSE: [usize; 3] = [8, 4, 2];
/// Groups of mounts by the signs of their pitches that the first local search follows side by side: the model ranks the mounts of a
/// group, not always the groups.
const PITCH_SIGNS: usize = 2;
/// Share of the best trials among which the correction's mounts are chosen.
const GOOD_SHARE: f64 = 0.15;
/// Finalists are at least so far from each other and from what was judged, in the unit cube.
pub(super) const APART: f64 = 0.03;

/// A rig that the model looked at.
pub(super) struct Tried {
    pub(super) values: Vec<f64>,
    model: Modelled,
    /// By some of the voxels.
    is_rough: bool,
    pub(super) violation: f64,
}

/// A running search.
pub(crate) struct SceneSearch<'a> {
    pub rigs: &'a RigSpace,
    pub model: &'a mut CellSites,
    pub judges: &'a Judges,
    pub weights: SceneWeights,
    pub plan: Plan,
    pub(super) space: Space,
    pub(super) tried: Vec<Tried>,
    pub(super) exact: Vec<Exact>,
    correction: Correction,
    /// Model evaluations done and the best exact J then.
    history: Vec<(usize, f64)>,
    /// What was found before, in the order in which the search asks.
    known: Findings,
    found: Findings,
    /// What was cast, in the order of `found.exact`.
    rigs_cast: Vec<Rig>,
}

/// How a search ended.
pub(crate) struct SearchEnd {
    /// Judged with every beam, best first.
    pub exact: Vec<Exact>,
    /// By the model.
    pub evaluations: usize,
    /// Judged exactly, thinned beams included.
    pub judged: usize,
    /// Of these.
    pub rays: u64,
    pub stopped_by: StoppedBy,
    pub model_error: Option<ModelError>,
    pub history: Vec<(usize, f64)>,
    /// By how much the best rig that keeps its distance and was not judged is better than the best judged one, in J, by the
    /// corrected model.
    pub best_left: Option<f64>,
}

impl<'a> SceneSearch<'a> {
    /// Nothing looked at yet.
    ///
    /// # Errors
    /// Bounds out of order.
    pub(crate) fn new(
        rigs: &'a RigSpace,
        model: &'a mut CellSites,
        judges: &'a Judges,
        weights: SceneWeights,
        plan: Plan,
        known: Findings,
    ) -> Result<Self, SpaceError> {
        let space = rigs.space()?;
        model.unfocus();
        Ok(Self {
            rigs,
            model,
            judges,
            weights,
            plan,
            space,
            tried: Vec::new(),
            exact: Vec::new(),
            correction: Correction::default(),
            history: Vec::new(),
            known,
            found: Findings::default(),
            rigs_cast: Vec::new(),
        })
    }

    /// What was found until now.
    pub(crate) fn findings(&self) -> &Findings {
        &self.found
    }

    /// The rigs that were cast and what the beams that judge while searching saw.
    pub(super) fn cast(&self) -> impl Iterator<Item = (&Rig, &Seen)> {
        self.rigs_cast.iter().zip(&self.found.exact)
    }

    /// Searches until the plan is done or `stop` is set; the best exact one is there in both cases.
    pub(crate) fn run(&mut self, progress: &dyn Fn(&Self, &str), stop: &AtomicBool) -> SearchEnd {
        let is_stopped = || stop.load(Ordering::Relaxed);
        let Plan { evaluations, spread, local, early, correcting, amid, finalists, again, seed, .. } =
            self.plan;
        let mut rng = Rng::new(seed, 0);
        let points = self.space.latin_hypercube(spread, &mut rng);
        for points in points.chunks(16) {
            if is_stopped() && !self.tried.is_empty() {
                break;
            }
            self.look(points, SPARSE[0]);
            progress(self, "looking at mounts all over the space");
        }
        let best = self.roughly_best(again[0]);
        self.model.focus(&best.iter().map(|at| self.rigs.rig(&self.tried[*at].values)).collect::<Vec<_>>());
        self.look_again(&best);
        let early = early.min(correcting);
        let first = (spread + local).min(evaluations);
        // corrected by good mounts all over; by the plan also amid the second search, by its best mounts
        let second = if amid > 0 { (first + evaluations) / 2 } else { evaluations };
        let rounds = [(early, first), (correcting - early, second), (amid, evaluations)];
        for (round, (count, limit)) in (1..).zip(rounds) {
            if is_stopped() {
                break;
            }
            if count > 0 {
                progress(self, "casting every beam of the mounts that correct the model");
                if self.exact.is_empty() {
                    let mut best = first_of_each(&self.by_pitch_signs(&self.ranked()), count);
                    best.retain(|at| self.tried[*at].is_rough);
                    self.look_again(&best);
                }
                let is_last = round == rounds.len();
                self.judge_all(if is_last { self.best_left(count) } else { self.far_apart(count) });
                self.correct();
            }
            self.search_locally(limit, round, progress, stop);
            self.look_again(&self.roughly_best(again[round.min(2)]));
        }
        for count in [finalists.div_ceil(2), finalists / 2] {
            if is_stopped() && !self.exact.is_empty() {
                break;
            }
            progress(self, "casting every beam of the finalists");
            self.judge_all(self.best_left(count));
            self.correct();
        }
        self.climb(progress, stop);
        let stopped_by = if is_stopped() { StoppedBy::Interrupted } else { StoppedBy::Budget };
        let left = self.best_left(1).first().map(|at| self.corrected(&self.tried[*at]));
        let (judged, rays) = (self.exact.len(), self.exact.iter().map(|exact| exact.seen.rays).sum::<u64>());
        self.rank();
        let rays = rays + self.build_the_best(progress, stop);
        let best_left = left.zip(self.exact.first()).map(|(left, best)| left - best.score());
        let mut end = SearchEnd {
            exact: Vec::new(),
            evaluations: self.tried.len(),
            judged,
            rays,
            stopped_by,
            model_error: self.correction.error(),
            history: std::mem::take(&mut self.history),
            best_left,
        };
        if self.judges.thinned.is_some() {
            progress(self, "casting every beam of the best of them");
            end.rays += self.judge_wholly();
        }
        end.exact = std::mem::take(&mut self.exact);
        end
    }

    /// Those judged, best first: those that keep what is asked, of equals the least tilted.
    fn rank(&mut self) {
        self.exact.sort_by(|a, b| {
            let by_score = a.violation.total_cmp(&b.violation).then(b.score().total_cmp(&a.score()));
            by_score.then(tilt_rad(&a.rig).total_cmp(&tilt_rad(&b.rig)))
        });
    }

    /// Casts the draws of the best of those judged, until the best has them. How many rays that takes.
    fn build_the_best(&mut self, progress: &dyn Fn(&Self, &str), stop: &AtomicBool) -> u64 {
        let mut rays = 0;
        while self.plan.errors.criterion.is_some() && !stop.load(Ordering::Relaxed) {
            let Some(mut best) = self.exact.first().filter(|best| best.losses.is_none()).cloned() else {
                break;
            };
            progress(self, "casting the best mount as it might be built");
            rays += self.build(&mut best);
            self.exact[0] = best;
            self.rank();
        }
        rays
    }

    /// Keeps the best of those judged, with every beam. How many rays that takes.
    fn judge_wholly(&mut self) -> u64 {
        self.exact.truncate(self.plan.whole);
        for exact in &mut self.exact {
            let known = self.known.whole.iter().find(|(values, _)| *values == exact.values);
            let (seen, coverage) = match known {
                Some((_, seen)) => (seen.clone(), None),
                None => {
                    let (seen, coverage) = self.judges.cast.cover(&exact.rig);
                    (seen, Some(coverage))
                }
            };
            exact.seen_thinned = Some(std::mem::replace(&mut exact.seen, seen));
            exact.coverage = coverage;
            exact.terms = self.weights.terms(&exact.rig, &exact.seen, exact.registration.as_ref());
            self.found.whole.push((exact.values.clone(), exact.seen.clone()));
        }
        self.rank();
        self.exact.iter().map(|exact| exact.seen.rays).sum()
    }

    /// J by the corrected model of points.
    pub(crate) fn look_at(&self, points: &[Vec<f64>]) -> Vec<f64> {
        let rigs: Vec<Rig> = points.iter().map(|values| self.rigs.rig(values)).collect();
        let scores = self.scores(&rigs, 1).into_iter();
        let modelled = points.iter().zip(&rigs).zip(scores);
        modelled
            .map(|((values, rig), score)| self.correction.corrected(&self.modelled(values, rig, score)))
            .collect()
    }

    fn modelled(&self, values: &[f64], rig: &Rig, score: f64) -> Modelled {
        Modelled { masters: self.rigs.mounts(values), score, angular: self.weights.angular(rig) }
    }

    /// The space that is searched.
    pub(crate) fn space(&self) -> &Space {
        &self.space
    }

    pub(super) fn corrected(&self, tried: &Tried) -> f64 {
        self.correction.corrected(&tried.model)
    }

    fn trial(&self, tried: &Tried) -> Trial {
        Trial {
            candidate: Candidate { values: tried.values.clone() },
            score: self.corrected(tried),
            violation: tried.violation,
        }
    }

    /// Those of the best that were looked at by some of the voxels.
    fn roughly_best(&self, count: usize) -> Vec<usize> {
        let ranked = self.ranked().into_iter().take(count);
        ranked.filter(|at| self.tried[*at].is_rough).collect()
    }

    /// Looks at trials by all voxels.
    fn look_again(&mut self, chosen: &[usize]) {
        let rigs: Vec<Rig> = chosen.iter().map(|at| self.rigs.rig(&self.tried[*at].values)).collect();
        let first = self.found.again.len();
        let scores = match self.known.again.get(first..first + chosen.len()) {
            Some(known) => known.to_vec(),
            None => self.scores(&rigs, 1),
        };
        for (at, score) in chosen.iter().zip(&scores) {
            (self.tried[*at].model.score, self.tried[*at].is_rough) = (*score, false);
        }
        self.found.again.extend(scores);
    }

    /// Mounts that the model looked at.
    pub(crate) fn evaluations(&self) -> usize {
        self.tried.len()
    }

    /// The model looks at points.
    pub(super) fn look(&mut self, points: &[Vec<f64>], stride: usize) {
        let rigs: Vec<Rig> = points.iter().map(|values| self.rigs.rig(values)).collect();
        let first = self.tried.len();
        let scores: Vec<f64> = match self.known.scores.get(first..first + points.len()) {
            Some(known) => known.to_vec(),
            None => self.scores(&rigs, stride),
        };
        self.found.scores.extend(&scores);
        let violations = self.modelled_violations(&rigs);
        for (((values, rig), violation), score) in points.iter().zip(&rigs).zip(violations).zip(scores) {
            self.tried.push(Tried {
                values: values.clone(),
                model: self.modelled(values, rig, score),
                is_rough: stride > 1,
                violation,
            });
        }
    }

    /// The best trials that lie apart from each other, best first, among those allowed; nearer ones where there are too few.
    fn choose(&self, count: usize, apart: f64, is_allowed: impl Fn(usize) -> bool) -> Vec<usize> {
        let ranked = self.ranked();
        let mut chosen: Vec<usize> = Vec::new();
        let mut apart = apart;
        while chosen.len() < count && apart > 1e-3 {
            for at in &ranked {
                let is_far = |other: &usize| self.distance(*at, *other) >= apart;
                if chosen.len() < count && is_allowed(*at) && chosen.iter().all(is_far) {
                    chosen.push(*at);
                }
            }
            apart *= 0.5;
        }
        chosen
    }

    /// Trials from the best to the worst by the corrected model.
    pub(super) fn ranked(&self) -> Vec<usize> {
        let trials: Vec<Trial> = self.tried.iter().map(|tried| self.trial(tried)).collect();
        let mut ranked: Vec<usize> = (0..trials.len()).collect();
        ranked.sort_by(|a, b| trials[*a].order(&trials[*b]));
        ranked
    }

    /// In the unit cube.
    fn distance(&self, one: usize, other: usize) -> f64 {
        self.distance_of(&self.tried[one].values, &self.tried[other].values)
    }

    fn distance_of(&self, one: &[f64], other: &[f64]) -> f64 {
        let (one, other) = (self.space.to_unit(one), self.space.to_unit(other));
        one.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    }

    /// Good trials as far from each other and from what was judged as they come, the best first.
    fn far_apart(&self, count: usize) -> Vec<usize> {
        let ranked = self.ranked();
        let is_good = |at: &&usize| !self.tried[**at].is_rough && self.tried[**at].violation == 0.0;
        let good = ((ranked.len() as f64 * GOOD_SHARE) as usize).max(4 * count);
        let best: Vec<usize> = ranked.iter().filter(is_good).copied().collect();
        // before the first correction the model may prefer the wrong group
        let groups = if self.exact.is_empty() { self.by_pitch_signs(&best) } else { vec![best] };
        let good = first_of_each(&groups, good.div_ceil(groups.len().max(1)));
        let mut chosen: Vec<usize> = Vec::new();
        while chosen.len() < count.min(good.len()) {
            let nearest = |at: &usize| {
                let values = &self.tried[*at].values;
                let judged = self.exact.iter().map(|exact| self.distance_of(&exact.values, values));
                let chosen = chosen.iter().map(|other| self.distance(*at, *other));
                judged.chain(chosen).fold(f64::INFINITY, f64::min)
            };
            // of equals the better one
            let farthest = good
                .iter()
                .map(|at| (nearest(at), *at))
                .fold((-1.0, 0), |best, next| if next.0 > best.0 { next } else { best });
            chosen.push(farthest.1);
        }
        chosen
    }

    /// Ranked trials by which of the sensors are pitched up: the group of the best one first, the other groups but one left out.
    pub(super) fn by_pitch_signs(&self, ranked: &[usize]) -> Vec<Vec<usize>> {
        let is_up = |at: usize| self.tried[at].model.masters.iter().map(|mount| mount.pitch_rad > 0.0);
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for at in ranked {
            match groups.iter_mut().find(|own| is_up(own[0]).eq(is_up(*at))) {
                Some(own) => own.push(*at),
                None => groups.push(vec![*at]),
            }
        }
        groups.truncate(PITCH_SIGNS);
        groups
    }

    /// The best trials that were not judged and lie apart.
    fn best_left(&self, count: usize) -> Vec<usize> {
        self.choose(count, APART, |at| !self.tried[at].is_rough && self.is_new(&self.tried[at].values, APART))
    }

    /// Whether nothing nearer was judged, in the unit cube.
    pub(super) fn is_new(&self, values: &[f64], apart: f64) -> bool {
        self.exact.iter().all(|exact| self.distance_of(&exact.values, values) >= apart)
    }

    /// The best rig that keeps what is asked, of those judged after the first `judged`.
    pub(super) fn best_since(&self, judged: usize) -> Option<&Exact> {
        let allowed = self.exact[judged..].iter().filter(|exact| exact.violation == 0.0);
        allowed.max_by(|a, b| a.score().total_cmp(&b.score()))
    }

    pub(super) fn judge_all(&mut self, chosen: Vec<usize>) {
        let rigs: Vec<Rig> = chosen.iter().map(|at| self.rigs.rig(&self.tried[*at].values)).collect();
        let first = self.exact.len();
        let seen = match self.known.exact.get(first..first + rigs.len()) {
            Some(known) => known.to_vec(),
            None => self.judges.while_searching().see(&rigs),
        };
        self.found.exact.extend(seen.iter().cloned());
        self.rigs_cast.extend(rigs.iter().cloned());
        let looked_at = chosen.iter().map(|at| (self.tried[*at].values.clone(), self.tried[*at].model.score));
        let (points, scores): (Vec<_>, Vec<f64>) = looked_at.unzip();
        let exact = self.exact((points, &scores), rigs, seen);
        self.exact.extend(exact);
        if let Some(best) = self.best_since(0).map(Exact::score) {
            self.history.push((self.tried.len(), best));
        }
    }

    pub(super) fn correct(&mut self) {
        let observed = |exact: &Exact| {
            let tried = self.tried.iter().find(|tried| tried.values == exact.values)?;
            Some(Observed { model: tried.model.clone(), exact: exact.score() })
        };
        let observed: Vec<Observed> = self.exact.iter().filter_map(observed).collect();
        self.correction = Correction::fit(&observed);
    }
}

/// The first `count` of each list.
fn first_of_each(lists: &[Vec<usize>], count: usize) -> Vec<usize> {
    lists.iter().flat_map(|list| list.iter().take(count)).copied().collect()
}
