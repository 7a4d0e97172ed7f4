//! The published experiment at any fineness.

use super::Ladder;
use crate::design::objective::{ExperimentError, Objective};
use crate::rig::{Phase, Rig};

/// Factors on azimuths and on poses per metre, level by level.
const LEVELS: [(usize, usize); 7] = [(1, 1), (1, 2), (1, 4), (1, 8), (2, 8), (4, 8), (8, 8)];

/// The published experiment with its pattern freed, from its own number of rays to 64 times as many. Rays are first
/// spread over more poses, because a locked pattern misses the same cells at every one of them.
#[derive(Clone, Debug)]
pub struct BoxLadder {
    objectives: Vec<Objective>,
}

impl BoxLadder {
    /// The levels of an objective's experiment; its own azimuths and poses are the coarsest.
    ///
    /// # Errors
    /// A level that cannot be made: too many azimuths or poses.
    pub(crate) fn new(objective: &Objective) -> Result<Self, ExperimentError> {
        let level = |(azimuths, sub_poses): (usize, usize)| {
            objective.changed(|experiment| {
                experiment.azimuths *= azimuths;
                experiment.sub_poses *= sub_poses;
                experiment.phase = Phase::Free;
            })
        };
        Ok(Self { objectives: LEVELS.into_iter().map(level).collect::<Result<_, _>>()? })
    }

    /// The objective at a level.
    pub(crate) fn objective(&self, level: usize) -> &Objective {
        &self.objectives[level]
    }
}

impl Ladder for BoxLadder {
    type Candidate = Rig;
    /// The kernel counts too fast for it to pay to keep what was seen.
    type Memo = ();
    type Error = ExperimentError;

    fn levels(&self) -> usize {
        self.objectives.len()
    }

    fn rays(&self, level: usize, rig: &Rig) -> u64 {
        self.objectives[level].simulator().rays(rig)
    }

    fn name(&self, level: usize) -> String {
        let experiment = self.objectives[level].simulator().experiment();
        format!("{} azimuths, {} poses per metre", experiment.azimuths, experiment.sub_poses)
    }

    fn score(&self, level: usize, rig: &Rig, (): &mut ()) -> Result<f64, ExperimentError> {
        self.objectives[level].score(rig)
    }
}
