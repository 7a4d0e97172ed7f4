//! Steps from the best mount that was cast, judged by casts: where many voxels lie far away, the model ranks mounts that are nearly
//! as good by chance. A pattern search whose polls the model orders (Booker, Dennis, Frank, Serafini, Torczon, Trosset 1999,
//! doi:10.1007/BF01197708).

use std::sync::atomic::{AtomicBool, Ordering};

use super::exact::Exact;
use super::search::{APART, SceneSearch};
use crate::base::rng::Rng;

/// First and least step of single variables, as shares of each one's range.
const SINGLE: [f64; 2] = [0.3, 0.04];
/// The same of steps in all variables at once, which follow: standard deviations.
const JOINT: [f64; 2] = [0.04, 0.005];
/// What is left of a step after a round without gain.
const SHRINK: f64 = 0.6;
/// Mounts cast in a round until one is better.
const POLLS: usize = 2;
/// One in so many casts is of a mirrored mount; with one of these to climb from, one in so many is spent on each before the better
/// takes the rest.
const MIRRORED: usize = 5;
const SHARED: usize = 3;
/// A mirrored mount is not climbed from where its J is lower by more than this share of the voxels that the best sees.
const RIVAL: f64 = 0.003;

/// A mount from which steps go on.
struct Start {
    values: Vec<f64>,
    score: f64,
    step: f64,
    is_joint: bool,
}

impl Start {
    fn at(exact: &Exact) -> Self {
        Self { values: exact.values.clone(), score: exact.score(), step: SINGLE[0], is_joint: false }
    }

    fn is_done(&self) -> bool {
        self.is_joint && self.step < JOINT[1]
    }

    fn shrink(&mut self) {
        self.step *= SHRINK;
        if !self.is_joint && self.step < SINGLE[1] {
            (self.step, self.is_joint) = (JOINT[0], true);
        }
    }
}

impl SceneSearch<'_> {
    /// Steps from the best judged mount and from the best of its mirror images, until the plan's casts are used up: a scene nearly
    /// as good on both sides has several tops, and a search may have seen one of them only.
    pub(super) fn climb(&mut self, progress: &dyn Fn(&Self, &str), stop: &AtomicBool) {
        let mut rng = Rng::new(self.plan.seed, 3);
        let first = self.exact.len();
        let last = first + self.plan.climbing;
        let Some(favourite) = self.best_since(0) else { return };
        let (mut best, rival_loss) = (Start::at(favourite), RIVAL * favourite.seen.union);
        let images = self.mirrored(&best.values);
        self.poll(&images, self.plan.climbing / MIRRORED, best.score, progress, stop);
        let image = self.best_since(first).map(Start::at);
        if let Some(mut image) = image.filter(|image| image.score > best.score - rival_loss) {
            let each = (last - self.exact.len()) / SHARED;
            for start in [&mut best, &mut image] {
                self.climb_from(start, self.exact.len() + each, &mut rng, progress, stop);
            }
            if image.score > best.score {
                best = image;
            }
        }
        self.climb_from(&mut best, last, &mut rng, progress, stop);
    }

    /// Ever shorter steps, until so many mounts are judged.
    fn climb_from(
        &mut self,
        start: &mut Start,
        last: usize,
        rng: &mut Rng,
        progress: &dyn Fn(&Self, &str),
        stop: &AtomicBool,
    ) {
        let is_stopped = || stop.load(Ordering::Relaxed);
        while self.exact.len() < last && self.looks_left() > 0 && !start.is_done() && !is_stopped() {
            let steps = match start.is_joint {
                true => self.joint_steps(start, rng),
                false => self.single_steps(start),
            };
            let judged = self.exact.len();
            self.poll(&steps, POLLS.min(last - judged), start.score, progress, stop);
            match self.best_since(judged) {
                Some(found) if found.score() > start.score => {
                    (start.values, start.score) = (found.values.clone(), found.score());
                }
                _ => start.shrink(),
            }
        }
    }

    /// Looks at points; casts the best of them by the corrected model one by one, which corrects it, until one is better than
    /// `score` or `count` are cast.
    fn poll(
        &mut self,
        points: &[Vec<f64>],
        count: usize,
        score: f64,
        progress: &dyn Fn(&Self, &str),
        stop: &AtomicBool,
    ) {
        if count == 0 || stop.load(Ordering::Relaxed) {
            return;
        }
        let first = self.tried.len();
        self.look(&points[..points.len().min(self.looks_left())], 1);
        let mut open: Vec<usize> = (first..self.tried.len()).collect();
        open.retain(|at| self.tried[*at].violation == 0.0);
        for _ in 0..count.min(open.len()) {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            progress(self, "casting every beam of mounts around the best one");
            let corrected = |at: &usize| self.corrected(&self.tried[*at]);
            // of equals the first
            open.sort_by(|a, b| corrected(b).total_cmp(&corrected(a)));
            self.judge_all(vec![open.remove(0)]);
            self.correct();
            if self.best_since(self.exact.len() - 1).is_some_and(|found| found.score() > score) {
                return;
            }
        }
    }

    fn looks_left(&self) -> usize {
        (self.plan.evaluations + self.plan.around).saturating_sub(self.tried.len())
    }

    /// One or two variables with the opposite sign.
    fn mirrored(&self, values: &[f64]) -> Vec<Vec<f64>> {
        let variables = self.space.variables().iter();
        let signed: Vec<usize> = variables
            .enumerate()
            .filter(|(_, own)| own.low < 0.0 && own.high > 0.0)
            .map(|(at, _)| at)
            .collect();
        let pairs = signed
            .iter()
            .enumerate()
            .flat_map(|(nth, one)| signed[nth..].iter().map(move |other| [*one, *other]));
        let image = |[one, other]: [usize; 2]| {
            let mut image = values.to_vec();
            image[one] = -values[one];
            image[other] = -values[other];
            self.space.clamp(&mut image);
            image
        };
        pairs.map(image).filter(|image| self.is_new(image, APART)).collect()
    }

    /// As many steps of all variables as there are of single ones.
    fn joint_steps(&self, start: &Start, rng: &mut Rng) -> Vec<Vec<f64>> {
        let steps = (0..2 * start.values.len()).map(|_| self.stepped(start.values.clone(), start.step, rng));
        steps.filter(|values| self.is_new(values, nearest(start.step))).collect()
    }

    /// One variable a step lower or higher, without those near a mount that was judged.
    fn single_steps(&self, start: &Start) -> Vec<Vec<f64>> {
        let unit = self.space.to_unit(&start.values);
        let stepped = (0..2 * unit.len()).map(|at| {
            let mut point = unit.clone();
            let signed = if at % 2 == 0 { -start.step } else { start.step };
            point[at / 2] = (point[at / 2] + signed).clamp(0.0, 1.0);
            self.space.values_at(&point)
        });
        stepped.filter(|values| self.is_new(values, nearest(start.step))).collect()
    }
}

/// Steps end at least so far from what was judged.
fn nearest(step: f64) -> f64 {
    APART.min(0.4 * step)
}
