//! Steps from the best mount that was cast, judged by casts: where many voxels lie far away, the model ranks mounts that are nearly
//! as good by chance. A pattern search whose polls the model orders (Booker, Dennis, Frank, Serafini, Torczon, Trosset 1999,
//! doi:10.1007/BF01197708).

use std::sync::atomic::{AtomicBool, Ordering};

use super::search::SceneSearch;

/// The first step and the least one, as shares of each variable's range, and what is left of it after a round without gain.
const STEPS: [f64; 2] = [0.3, 0.04];
const SHRINK: f64 = 0.6;
/// Mounts cast in a round.
const POLLS: usize = 2;

impl SceneSearch<'_> {
    /// Steps of one variable at a time from the best judged mount; the best of them by the corrected model are cast, which corrects
    /// it, until the plan's casts are used up.
    pub(super) fn climb(&mut self, progress: &dyn Fn(&Self, &str), stop: &AtomicBool) {
        let (mut left, mut step) = (self.plan.climbing, STEPS[0]);
        while left > 0 && step > STEPS[1] && !stop.load(Ordering::Relaxed) {
            let Some(best) = self.highest() else { return };
            let (steps, before) = (self.steps_from(&best.values, step), best.score());
            let first = self.tried.len();
            self.look(&steps, 1);
            let is_allowed = |at: &usize| self.tried[*at].violation == 0.0;
            let polled = self.ranked().into_iter().filter(|at| *at >= first).filter(is_allowed);
            let polled: Vec<usize> = polled.take(POLLS.min(left)).collect();
            if !polled.is_empty() {
                progress(self, "casting every beam of mounts around the best one");
                left -= polled.len();
                self.judge_all(polled);
                self.correct();
            }
            if self.highest().is_none_or(|best| best.score() <= before) {
                step *= SHRINK;
            }
        }
    }

    /// One variable a step lower or higher, without those near a mount that was judged.
    fn steps_from(&self, values: &[f64], step: f64) -> Vec<Vec<f64>> {
        let unit = self.space.to_unit(values);
        let stepped = (0..2 * unit.len()).map(|at| {
            let mut point = unit.clone();
            let signed = if at % 2 == 0 { -step } else { step };
            point[at / 2] = (point[at / 2] + signed).clamp(0.0, 1.0);
            self.space.values_at(&point)
        });
        stepped.filter(|values| self.is_new(values)).collect()
    }
}
