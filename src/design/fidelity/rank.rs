//! Which of many candidates is best.

use rayon::prelude::*;

use super::{FIRST_RATIO, Judged, LEAST_BOUND, LEAST_RATIO, Ladder, MAX_RATIO, tail};
use crate::base::statistics::{mean_and_deviation, quantile, sorted};

/// How sure a ranking must be, and what it may cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Share of the best score that may be lost by the choice.
    pub tolerance: f64,
    /// Rays that may be cast for each candidate, on the mean over all of them.
    pub rays_per_candidate: f64,
}

/// Why a ranking ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stopped {
    /// One candidate is left.
    OneLeft,
    /// Those that are left differ by less than the tolerance.
    Tolerance,
    /// The next level would cost more than was allowed.
    Budget,
    /// There is no finer level.
    Finest,
}

/// One level of a ranking.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RankingStep {
    /// What the level is.
    pub name: String,
    /// Candidates looked at.
    pub looked_at: usize,
    /// Of these, still possible afterwards.
    pub left: usize,
    /// Ratio of what this level added to what the one before did.
    pub ratio: f64,
    /// The difference of two scores may be wrong by twice this.
    pub width: f64,
    /// Rays of all candidates up to here.
    pub rays: u64,
}

/// What a ranking found.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Ranking {
    /// Every candidate, in the order given.
    pub judged: Vec<Judged>,
    /// The best one.
    pub best: usize,
    /// Those that might be as good, the best first: those that were looked at to the end, then those for which there were
    /// no rays.
    pub undecided: Vec<usize>,
    /// Score that may be lost by the choice.
    pub regret_bound: f64,
    /// Why it ended.
    pub stopped: Stopped,
    /// What was done, level by level.
    pub steps: Vec<RankingStep>,
    /// Rays in all.
    pub rays: u64,
}

/// Share of candidates with errors within the stated one; the rest may be further off.
const BELIEVED: f64 = 0.95;
/// Fewer than this say nothing about those that stayed behind.
const LEAST_TO_LEARN_FROM: usize = 3;
/// An error seen between two levels, as a share of it, is what may be left after the finer one.
const LEFT_AFTER: f64 = 0.7;

/// Looks at all candidates coarsely and at fewer and fewer more finely. None without candidates.
///
/// # Errors
/// The first candidate's that cannot be looked at.
pub fn rank<L: Ladder>(
    ladder: &L,
    candidates: &[L::Candidate],
    rules: &Rules,
) -> Result<Option<Ranking>, L::Error> {
    if candidates.is_empty() {
        return Ok(None);
    }
    let mut search = State::new(ladder, candidates);
    search.look(0)?;
    let stopped = loop {
        search.look(search.seen)?;
        search.judge();
        if search.left.len() == 1 {
            break Stopped::OneLeft;
        }
        if 2.0 * search.width <= rules.tolerance * search.judged[search.left[0]].value.abs() {
            break Stopped::Tolerance;
        }
        if search.seen == ladder.levels() {
            break Stopped::Finest;
        }
        if !search.keep_affordable(rules) {
            break Stopped::Budget;
        }
    };
    Ok(Some(search.end(stopped)))
}

struct State<'a, L: Ladder> {
    ladder: &'a L,
    candidates: &'a [L::Candidate],
    /// What was left of each candidate that is looked at further.
    memo: Vec<L::Memo>,
    /// Scores of each candidate, by level.
    scores: Vec<Vec<f64>>,
    judged: Vec<Judged>,
    /// Candidates that are looked at further, best first once they were judged.
    left: Vec<usize>,
    /// Levels seen.
    seen: usize,
    width: f64,
    /// Errors that all share, and without what all share, of the level before.
    before: Option<[f64; 2]>,
    /// Candidates that were not looked at further for want of rays alone.
    given_up: Vec<usize>,
    /// Who was judged at each level, and at what value then.
    values: Vec<Vec<(usize, f64)>>,
    steps: Vec<RankingStep>,
    rays: u64,
}

impl<'a, L: Ladder> State<'a, L> {
    fn new(ladder: &'a L, candidates: &'a [L::Candidate]) -> Self {
        Self {
            ladder,
            candidates,
            memo: candidates.iter().map(|_| L::Memo::default()).collect(),
            scores: vec![Vec::new(); candidates.len()],
            judged: vec![Judged { value: f64::NAN, bound: f64::INFINITY, level: 0 }; candidates.len()],
            left: (0..candidates.len()).collect(),
            seen: 0,
            width: f64::INFINITY,
            before: None,
            given_up: Vec::new(),
            values: Vec::new(),
            steps: Vec::new(),
            rays: 0,
        }
    }

    fn look(&mut self, level: usize) -> Result<(), L::Error> {
        let (ladder, candidates) = (self.ladder, self.candidates);
        let removed: Vec<(usize, L::Memo)> =
            self.left.iter().map(|index| (*index, std::mem::take(&mut self.memo[*index]))).collect();
        // what is stored of others is of no more use
        self.memo.iter_mut().for_each(|memo| *memo = L::Memo::default());
        let looked = removed.into_par_iter().map(|(index, mut memo)| {
            ladder.score(level, &candidates[index], &mut memo).map(|score| (index, score, memo))
        });
        for (index, score, memo) in looked.collect::<Result<Vec<_>, L::Error>>()? {
            self.scores[index].push(score);
            self.memo[index] = memo;
            self.rays += ladder.rays(level, &candidates[index]);
        }
        self.seen = level + 1;
        Ok(())
    }

    /// What the last level added to each candidate that is left.
    fn added(&self, back: usize) -> Option<Vec<f64>> {
        let level = self.seen.checked_sub(2 + back)?;
        Some(
            self.left
                .iter()
                .map(|index| self.scores[*index][level + 1] - self.scores[*index][level])
                .collect(),
        )
    }

    fn judge(&mut self) {
        let added = self.added(0).unwrap_or_default();
        let [ratio, own_ratio] = match self.added(1) {
            Some(before) => ratios(&before, &added),
            None => [FIRST_RATIO; 2],
        };
        let level = self.seen - 1;
        let levels_left = self.ladder.levels() - self.seen;
        let tail_of_one = tail(own_ratio, levels_left);
        let tail = tail(ratio, levels_left);
        // what all are missing grows with the ratio of all; how one differs from the others is in part the luck of a level
        let (mean, _) = mean_and_deviation(&added);
        let values: Vec<f64> = self
            .left
            .iter()
            .zip(&added)
            .map(|(index, added)| self.scores[*index][level] + mean * tail + (added - mean) * tail_of_one)
            .collect();
        let bounds: Vec<f64> = match self.errors(&values) {
            Some([shared, own]) => {
                let [shared_before, own_before] = self.before.unwrap_or_default();
                self.before = Some([shared, own]);
                self.width = LEFT_AFTER * own.max(0.5 * ratio * own_before);
                let shared = LEFT_AFTER * shared.max(ratio * shared_before);
                added.iter().map(|added| shared.max(0.5 * added.abs() * tail)).collect()
            }
            None => {
                // nothing is known yet but the sum itself
                let sums: Vec<f64> = added.iter().map(|added| added * tail).collect();
                self.width = own_part(&sums);
                let mean = sums.iter().map(|sum| sum.abs()).sum::<f64>() / sums.len() as f64;
                sums.iter().map(|sum| sum.abs() + mean).collect()
            }
        };
        for ((index, value), bound) in self.left.iter().zip(&values).zip(bounds) {
            self.judged[*index] = Judged { value: *value, bound: bound + LEAST_BOUND * value.abs(), level };
        }
        self.values.push(self.left.iter().copied().zip(values).collect());
        let looked_at = self.left.len();
        let judged = &self.judged;
        self.left.sort_by(|a, b| judged[*b].value.total_cmp(&judged[*a].value).then(a.cmp(b)));
        let best = self.judged[self.left[0]].value;
        let width = self.width;
        self.left.retain(|index| self.judged[*index].value + width >= best - width);
        self.steps.push(RankingStep {
            name: self.ladder.name(level),
            looked_at,
            left: self.left.len(),
            ratio,
            width,
            rays: self.rays,
        });
    }

    /// By how much the values of the level before were wrong, for most candidates: as they are, and without what all
    /// share.
    fn errors(&self, values: &[f64]) -> Option<[f64; 2]> {
        if self.seen < 3 {
            return None;
        }
        let errors: Vec<f64> =
            self.left.iter().zip(values).map(|(index, value)| value - self.judged[*index].value).collect();
        let shared = quantile(&sorted(errors.iter().map(|error| error.abs())), BELIEVED);
        Some([shared, own_part(&errors)])
    }

    /// Leaves as many candidates as the next level may cost, the best ones. False: not even two.
    ///
    /// What is left of the budget is shared evenly among the next levels (successive halving: Karnin, Koren and Somekh 2013),
    /// as many of them as can each be paid for two candidates then.
    fn keep_affordable(&mut self, rules: &Rules) -> bool {
        let budget = rules.rays_per_candidate * self.candidates.len() as f64 - self.rays as f64;
        let share_of = |levels: usize| budget / levels as f64;
        let of_two = |level: usize| {
            let rays = |index: &usize| self.ladder.rays(level, &self.candidates[*index]) as f64;
            self.left.iter().take(2).map(rays).sum::<f64>()
        };
        let levels = 1..=self.ladder.levels() - self.seen;
        let paid = levels.filter(|levels| of_two(self.seen + levels - 1) <= share_of(*levels)).max();
        let share = share_of(paid.unwrap_or(1));
        let mut cost = 0.0;
        let affordable = self
            .left
            .iter()
            .take_while(|index| {
                cost += self.ladder.rays(self.seen, &self.candidates[**index]) as f64;
                cost <= share
            })
            .count();
        if affordable < 2 {
            return false;
        }
        self.given_up.extend(self.left.drain(affordable..));
        true
    }

    /// What those that went on have shown about those that stayed behind: values of a level turn out to be off by something
    /// that all share, and by at most so much. Returns how far each that stayed may still lie from the others.
    fn learn_for_those_left_behind(&mut self) -> Vec<f64> {
        let mut own = vec![self.width; self.candidates.len()];
        for (level, then) in self.values.iter().enumerate() {
            // the first values were judged after the second level
            let stayed = |(index, _): &&(usize, f64)| self.judged[*index].level == level + 1;
            let behind: Vec<_> = then.iter().filter(stayed).copied().collect();
            let went_on: Vec<_> = then.iter().filter(|entry| !stayed(entry)).copied().collect();
            if went_on.len() < LEAST_TO_LEARN_FROM {
                continue;
            }
            let moved: Vec<f64> =
                went_on.iter().map(|(index, value)| self.judged[*index].value - value).collect();
            let middle = quantile(&sorted(moved.iter().copied()), 0.5);
            let most = quantile(&sorted(moved.iter().map(|moved| moved.abs())), BELIEVED);
            for (index, value) in behind {
                let judged = &mut self.judged[index];
                judged.value = value + middle;
                judged.bound = judged.bound.max(most);
                own[index] = self.width + own_part(&moved);
            }
        }
        own
    }

    fn end(mut self, stopped: Stopped) -> Ranking {
        let best = self.left[0];
        let own = self.learn_for_those_left_behind();
        // the difference of two values may be off by twice the width, and the second one starts behind
        let least = self.judged[best].value - self.width;
        let seconds = self.left.get(1).map(|second| self.judged[*second].value + self.width);
        let at_most = |index: &usize| (*index, self.judged[*index].value + own[*index]);
        let given_up: Vec<(usize, f64)> = self.given_up.iter().map(at_most).collect();
        let mosts = seconds.into_iter().chain(given_up.iter().map(|(_, most)| *most));
        let regret_bound = mosts.map(|most| most - least).fold(0.0, f64::max);
        let mut undecided = self.left;
        undecided.extend(given_up.iter().filter(|(_, most)| *most >= least).map(|(index, _)| *index));
        Ranking {
            judged: self.judged,
            best,
            undecided,
            regret_bound,
            stopped,
            steps: self.steps,
            rays: self.rays,
        }
    }
}

/// Ratio of what a level added to what the one before did: that of all together, and that by which a candidate that had
/// more added than the others may be expected to have it again (the slope of a regression: none where it was luck).
fn ratios(before: &[f64], now: &[f64]) -> [f64; 2] {
    let [before_mean, now_mean] = [before, now].map(|added| mean_and_deviation(added).0);
    let ratio =
        if before_mean > 0.0 { (now_mean / before_mean).clamp(LEAST_RATIO, MAX_RATIO) } else { LEAST_RATIO };
    let (mut both, mut square) = (0.0, 0.0);
    for (before, now) in before.iter().zip(now) {
        both += (before - before_mean) * (now - now_mean);
        square += (before - before_mean).powi(2);
    }
    // two points lie on a line, whatever they are
    let own = if before.len() > 2 && square > 0.0 { (both / square).clamp(0.0, ratio) } else { 0.0 };
    [ratio, own]
}

/// How far most values lie from the middle one.
fn own_part(values: &[f64]) -> f64 {
    let middle = quantile(&sorted(values.iter().copied()), 0.5);
    quantile(&sorted(values.iter().map(|value| (value - middle).abs())), BELIEVED)
}

#[cfg(test)]
mod tests {
    use super::super::tests::Invented;
    use super::*;

    const RULES: Rules = Rules { tolerance: 0.0005, rays_per_candidate: 10_000.0 };

    fn candidates() -> Vec<[f64; 2]> {
        (0..60).map(|n| [1000.0 + (n * 37 % 60) as f64 * 4.0, 200.0 + (n * 11 % 60) as f64 * 5.0]).collect()
    }

    #[test]
    fn the_best_is_found_for_less_than_all_at_the_finest() {
        let ladder = Invented { levels: 8, noise: 10.0 };
        let ranking = rank(&ladder, &candidates(), &RULES).unwrap().unwrap();
        assert!(candidates()[ranking.best][0] == 1236.0, "{:?}", ranking.steps);
        assert!(ranking.rays as f64 <= 60.0 * RULES.rays_per_candidate);
        let held = candidates()
            .iter()
            .zip(&ranking.judged)
            .filter(|(candidate, judged)| {
                (ladder.score(7, candidate, &mut ()).unwrap() - judged.value).abs() <= judged.bound
            })
            .count();
        assert!(held >= 57, "{held}: {:?}", ranking.steps);
        assert_eq!(ranking.undecided[0], ranking.best);
    }

    #[test]
    fn where_noise_hides_the_best_the_stated_loss_holds() {
        let ladder = Invented { levels: 8, noise: 30.0 };
        let ranking = rank(&ladder, &candidates(), &RULES).unwrap().unwrap();
        let finest = |candidate: &[f64; 2]| ladder.score(7, candidate, &mut ()).unwrap();
        let best = candidates().iter().map(finest).fold(f64::NEG_INFINITY, f64::max);
        let lost = best - finest(&candidates()[ranking.best]);
        assert!(lost > 0.0 && lost <= ranking.regret_bound, "{lost}: {ranking:?}");
    }

    #[test]
    fn a_coarse_look_alone_would_choose_wrongly() {
        let ladder = Invented { levels: 8, noise: 30.0 };
        let coarse = |candidate: &[f64; 2]| ladder.score(0, candidate, &mut ()).unwrap();
        let chosen = candidates().into_iter().max_by(|a, b| coarse(a).total_cmp(&coarse(b))).unwrap();
        assert!(chosen[0] < 1236.0, "{chosen:?}");
    }

    #[test]
    fn what_one_has_added_more_than_others_counts_by_how_it_lasts() {
        let near = |found: [f64; 2], wanted: [f64; 2]| {
            assert!(
                (found[0] - wanted[0]).abs() < 1e-12 && (found[1] - wanted[1]).abs() < 1e-12,
                "{found:?}"
            );
        };
        near(ratios(&[8.0, 10.0, 12.0], &[4.0, 5.0, 6.0]), [0.5, 0.5]);
        near(ratios(&[8.0, 10.0, 12.0], &[5.0, 4.0, 6.0]), [0.5, 0.25]);
        // luck, two alone, and what turns around
        near(ratios(&[8.0, 10.0, 12.0], &[5.0, 4.0, 5.0]), [14.0 / 30.0, 0.0]);
        near(ratios(&[8.0, 12.0], &[4.0, 6.0]), [0.5, 0.0]);
        near(ratios(&[8.0, 10.0, 12.0], &[6.0, 5.0, 4.0]), [0.5, 0.0]);
        near(ratios(&[0.0; 3], &[1.0; 3]), [LEAST_RATIO, 0.0]);
    }

    #[test]
    fn a_small_budget_and_few_levels_are_reported() {
        let ladder = Invented { levels: 8, noise: 30.0 };
        let poor = rank(&ladder, &candidates(), &Rules { rays_per_candidate: 3500.0, ..RULES });
        assert_eq!(poor.unwrap().unwrap().stopped, Stopped::Budget);
        let short = Invented { levels: 3, noise: 30.0 };
        let ranking = rank(&short, &candidates(), &RULES).unwrap().unwrap();
        assert_eq!(ranking.stopped, Stopped::Finest);
        assert!(ranking.regret_bound > 0.0 && ranking.undecided.len() > 1);
    }

    #[test]
    fn one_candidate_equal_candidates_none_and_errors() {
        let ladder = Invented { levels: 8, noise: 0.0 };
        assert!(rank(&ladder, &[], &RULES).unwrap().is_none());
        let one = rank(&ladder, &[[5.0, 1.0]], &RULES).unwrap().unwrap();
        assert_eq!((one.best, one.stopped), (0, Stopped::OneLeft));
        let equal = rank(&ladder, &[[5.0, 1.0]; 4], &RULES).unwrap().unwrap();
        assert_eq!((equal.best, equal.stopped, equal.undecided.len()), (0, Stopped::Tolerance, 4));
        assert_eq!(rank(&ladder, &[[5.0, 1.0], [f64::NAN, 0.0]], &RULES).unwrap_err(), "no number");
    }
}
