//! Errors of building, and what they cost.

use serde::Serialize;

use crate::base::numbers::number;
use crate::design::robustness::{Criterion, RobustnessError, SEARCH_SEED, Spread, Tolerance, phase_of};
use crate::rig::Rig;

/// A loss within these errors that makes the best mount a cliff.
const CLIFF_SHARE: f64 = 0.01;

/// Errors of building, and whether a search reckons with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct BuildErrors {
    #[serde(flatten)]
    pub tolerance: Tolerance,
    pub draws: usize,
    /// Which J of the draws is searched; that as planned where none.
    pub criterion: Option<Criterion>,
}

impl BuildErrors {
    /// # Errors
    /// Those of the tolerance.
    pub(crate) fn new(
        tolerance: Tolerance,
        draws: usize,
        criterion: Option<Criterion>,
    ) -> Result<Self, RobustnessError> {
        tolerance.check(draws)?;
        Ok(Self { tolerance, draws, criterion })
    }

    /// A rig as it might be built, by draw.
    pub(super) fn built(&self, rig: &Rig) -> Vec<Rig> {
        (0..self.draws).map(|draw| self.tolerance.built(rig, SEARCH_SEED, draw)).collect()
    }

    /// At which start of the revolutions each draw is cast, in columns; none where all start as planned.
    pub(super) fn phases(&self) -> Option<impl Iterator<Item = f64>> {
        let draws = self.draws;
        self.tolerance.free_phase.then(|| (0..draws).map(move |draw| phase_of(draw, draws)))
    }
}

/// What errors of building cost: shares of the voxels that the winner sees, by the model. Every sensor is off by itself, evenly
/// within plus and minus.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct ToleranceLoss {
    pub position_m: f64,
    pub angle_deg: f64,
    pub draws: usize,
    pub mean_loss_share: f64,
    pub worst_loss_share: f64,
}

impl ToleranceLoss {
    /// Whether the mount stands at a cliff, in words.
    pub(super) fn doubt(&self, is_searched: bool) -> Option<String> {
        let advice = if is_searched { "" } else { "; --robust worst searches one that does not" };
        (self.worst_loss_share > CLIFF_SHARE).then(|| {
            format!(
                "the best mount stands at a cliff: {} m and {}° off may cost {:.1} % of the voxels{advice}",
                self.position_m,
                self.angle_deg,
                100.0 * self.worst_loss_share
            )
        })
    }
}

/// J of a mount as it might be built, where that is what was searched.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AsBuilt {
    pub(super) criterion: Criterion,
    #[serde(flatten)]
    pub(super) tolerance: Tolerance,
    #[serde(flatten)]
    pub(super) objective: Spread,
}

impl AsBuilt {
    pub(crate) fn words(&self) -> String {
        let Self { tolerance, objective, .. } = self;
        let spun = if tolerance.free_phase { ", revolutions that start anywhere" } else { "" };
        format!(
            "J {} ± {}, {} at worst, of {} draws: errors of {} m and {}°{spun}",
            number(objective.mean, 1),
            number(objective.deviation, 1),
            number(objective.worst, 1),
            objective.draws,
            tolerance.position_m,
            tolerance.angle_deg
        )
    }
}
