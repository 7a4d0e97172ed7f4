//! Pattern search: poll around the best point, move to a better one, refine the mesh when there is none.

use serde::{Deserialize, Serialize};

use super::{Candidate, Optimizer, Settings, Space, Trial, generator};

/// Mesh at the start, as a share of each variable's range.
const FIRST_STEP: f64 = 0.1;
/// Mesh at which a poll has converged, as a share of the range: 0.0036 degrees of pitch, 5 micrometres of x.
const LAST_STEP: f64 = 2e-5;
/// A restart draws this many random points and polls around the best.
const RESTART_POINTS: usize = 24;

/// Generalised pattern search with a full poll of the 2n coordinate directions (Torczon 1997,
/// doi:10.1137/S1052623493250780), integers by whole steps; the mesh doubles on success and halves on failure.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Poll {
    centre: Trial,
    /// Share of each variable's range.
    step: f64,
}

impl Poll {
    /// Around a point already evaluated; `step` is a share of each variable's range.
    pub(crate) fn new(centre: Trial, step: f64) -> Self {
        Self { centre, step }
    }

    /// Both neighbours along every variable that is free at the centre; those beyond a bound land on it. Empty when the
    /// mesh is finer than is of use.
    pub(crate) fn ask(&self, space: &Space) -> Vec<Candidate> {
        if self.step < LAST_STEP {
            return Vec::new();
        }
        let mut batch: Vec<Candidate> = Vec::new();
        for index in space.free(&self.centre.candidate.values) {
            let variable = &space.variables()[index];
            let length = self.step * (variable.high - variable.low);
            let length = if variable.integer { length.round().max(1.0) } else { length };
            for sign in [1.0, -1.0] {
                let mut values = self.centre.candidate.values.clone();
                values[index] += sign * length;
                space.clamp(&mut values);
                if values != self.centre.candidate.values {
                    batch.push(Candidate { values });
                }
            }
        }
        batch
    }

    /// Moves to the best of the poll if it is better than the centre.
    pub(crate) fn tell(&mut self, trials: &[Trial]) {
        match trials.iter().min_by(|a, b| a.order(b)) {
            Some(best) if best.beats(&self.centre) => {
                self.centre = best.clone();
                self.step = (2.0 * self.step).min(FIRST_STEP);
            }
            _ => self.step *= 0.5,
        }
    }
}

/// Random search for a quarter of the budget, then pattern search from its best point; when a poll has converged, again
/// from the best of a few new random points.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pattern {
    space: Space,
    seed: u64,
    restarts: u64,
    first_points: usize,
    poll: Option<Poll>,
}

impl Pattern {
    /// Nothing evaluated yet.
    pub(crate) fn new(space: Space, settings: Settings) -> Self {
        let first_points = (settings.budget / 4).clamp(1, 200);
        Self { space, seed: settings.seed, restarts: 0, first_points, poll: None }
    }
}

impl Optimizer for Pattern {
    fn ask(&mut self) -> Vec<Candidate> {
        if let Some(poll) = &self.poll {
            let batch = poll.ask(&self.space);
            if !batch.is_empty() {
                return batch;
            }
            self.poll = None;
        }
        let count = if self.restarts == 0 { self.first_points } else { RESTART_POINTS };
        let mut rng = generator(self.seed, self.restarts);
        self.restarts += 1;
        let points = self.space.latin_hypercube(count, &mut rng);
        points.into_iter().map(|values| Candidate { values }).collect()
    }

    fn tell(&mut self, trials: &[Trial]) {
        match &mut self.poll {
            Some(poll) => poll.tell(trials),
            None => {
                let best = trials.iter().min_by(|a, b| a.order(b));
                self.poll = best.map(|best| Poll::new(best.clone(), FIRST_STEP));
            }
        }
    }
}
