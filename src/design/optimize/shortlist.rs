//! The best trials of a search that are not each other's neighbours: what to look at again when scores are not to be
//! trusted to the last digit.

use serde::{Deserialize, Serialize};

use super::lines::TYPICAL_LENGTH;
use super::{Space, Trial};

/// Trials held.
const CAPACITY: usize = 32;
/// Least distance of two of them, each variable in lengths over which an objective typically changes.
const APART: f64 = 0.5;

/// So far the best trials that lie apart, best first.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Shortlist {
    trials: Vec<Trial>,
}

impl Shortlist {
    /// The trials, best first.
    pub(crate) fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// Takes a trial in where it is better than its neighbours, who then leave.
    pub(crate) fn note(&mut self, space: &Space, trial: &Trial) {
        if self.trials.len() == CAPACITY && self.trials.last().is_some_and(|worst| !trial.beats(worst)) {
            return;
        }
        let place = |trial: &Trial| space.to_unit(&space.canonical(&trial.candidate.values));
        let here = place(trial);
        let is_near = |other: &Trial| {
            let squares =
                here.iter().zip(place(other)).map(|(a, b)| ((a - b) / TYPICAL_LENGTH).powi(2)).sum::<f64>();
            squares <= APART * APART
        };
        let near: Vec<bool> = self.trials.iter().map(is_near).collect();
        if self.trials.iter().zip(&near).any(|(other, near)| *near && !trial.beats(other)) {
            return;
        }
        let mut near = near.into_iter();
        self.trials.retain(|_| !near.next().unwrap_or(false));
        let at = self.trials.partition_point(|other| !trial.beats(other));
        self.trials.insert(at, trial.clone());
        self.trials.truncate(CAPACITY);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Candidate, Variable};
    use super::*;

    fn trial(x: f64, score: f64) -> Trial {
        Trial { candidate: Candidate { values: vec![x] }, score, violation: 0.0 }
    }

    #[test]
    fn neighbours_stand_behind_the_best_of_them() {
        let x =
            Variable { name: "x".into(), low: 0.0, high: 1.0, integer: false, active_from: None, role: 0 };
        let space = Space::new(vec![x]).unwrap();
        let mut list = Shortlist::default();
        for (x, score) in [(0.50, 1.0), (0.52, 2.0), (0.90, 1.5), (0.54, 1.8), (0.10, 0.1), (0.97, 1.4)] {
            list.note(&space, &trial(x, score));
        }
        let scores: Vec<f64> = list.trials().iter().map(|trial| trial.score).collect();
        assert_eq!(scores, [2.0, 1.5, 1.4, 0.1]);
        for step in 0..1000 {
            list.note(&space, &trial(f64::from(step) / 1000.0, 3.0 + f64::from(step % 7)));
        }
        assert!(list.trials().len() <= CAPACITY && list.trials()[0].score == 9.0);
        assert!(list.trials().windows(2).all(|pair| pair[0].score >= pair[1].score));
    }
}
