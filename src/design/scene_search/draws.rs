//! A search over errors of building: J over draws of them, by the model and by casting.

use super::built::{AsBuilt, BuildErrors, ToleranceLoss};
use super::exact::Exact;
use super::search::SceneSearch;
use crate::design::robustness::Spread;
use crate::rig::Rig;

/// Rigs that are built in one go.
const TOGETHER: usize = 1024;

impl SceneSearch<'_> {
    /// What is searched, by the model, by every `stride`-th voxel: J as planned, or over the draws.
    pub(super) fn scores(&self, rigs: &[Rig], stride: usize) -> Vec<f64> {
        let BuildErrors { draws, criterion, .. } = self.plan.errors;
        let Some(criterion) = criterion else { return self.planned(rigs, stride) };
        let of_draws = |rigs: &[Rig]| {
            let built: Vec<Rig> = rigs.iter().flat_map(|rig| self.plan.errors.built(rig)).collect();
            let spread = |scores: &[f64]| Spread::of(scores).counts(criterion);
            self.planned(&built, stride).chunks(draws).map(spread).collect::<Vec<_>>()
        };
        rigs.chunks(TOGETHER.div_ceil(draws)).flat_map(of_draws).collect()
    }

    /// What errors of building take from J of each rig, by the model that gave it this score; 0 where J as planned is searched.
    pub(super) fn modelled_losses(&self, rigs: &[Rig], scores: &[f64]) -> Vec<f64> {
        match self.plan.errors.criterion {
            Some(_) => {
                self.planned(rigs, 1).iter().zip(scores).map(|(planned, score)| planned - score).collect()
            }
            None => vec![0.0; rigs.len()],
        }
    }

    /// Casts the draws of a judged rig, where they are what is searched and were not cast yet: J of each by the beams that judge while
    /// searching, against J as planned by the same beams. How many rays that takes.
    pub(super) fn build(&self, exact: &mut Exact) -> u64 {
        let errors = &self.plan.errors;
        let Some(criterion) = errors.criterion.filter(|_| exact.losses.is_none()) else { return 0 };
        let cast = self.judges.while_searching();
        let built = errors.built(&exact.rig);
        let mut seen = match errors.phases() {
            None => cast.see(&built),
            Some(phases) => {
                let see = |(phase, rig)| cast.at_phase(phase).see(std::slice::from_ref(rig)).swap_remove(0);
                phases.zip(&built).map(see).collect()
            }
        };
        seen.extend(cast.see(std::slice::from_ref(&exact.rig)));
        let rigs = built.iter().chain([&exact.rig]);
        let objective = |(rig, seen)| self.terms(rig, seen).0.objective();
        let mut objectives: Vec<f64> = rigs.zip(&seen).map(objective).collect();
        let planned = objectives.pop().unwrap_or_default();
        exact.loss = planned - Spread::of(&objectives).counts(criterion);
        exact.losses = Some(objectives.iter().map(|objective| planned - objective).collect());
        seen.iter().map(|seen| seen.rays).sum()
    }

    /// J over the draws of a rig, where they were cast.
    pub(super) fn as_built(&self, exact: &Exact) -> Option<AsBuilt> {
        let BuildErrors { tolerance, criterion, .. } = self.plan.errors;
        let scores: Vec<f64> = exact.losses.as_ref()?.iter().map(|loss| exact.objective() - loss).collect();
        Some(AsBuilt { criterion: criterion?, tolerance, objective: Spread::of(&scores) })
    }

    /// What errors of building cost, by the model.
    pub(super) fn tolerance_loss(&self, winner: &Exact) -> ToleranceLoss {
        let BuildErrors { tolerance, draws, .. } = self.plan.errors;
        let built = self.plan.errors.built(&winner.rig);
        let planned = self.model.see_roughly(std::slice::from_ref(&winner.rig), 1)[0].union.max(1.0);
        let seen = self.model.see_roughly(&built, 1);
        let losses: Vec<f64> = seen.iter().map(|off| 1.0 - off.union / planned).collect();
        ToleranceLoss {
            position_m: tolerance.position_m,
            angle_deg: tolerance.angle_deg,
            draws,
            mean_loss_share: losses.iter().sum::<f64>() / draws as f64,
            worst_loss_share: losses.iter().copied().fold(0.0, f64::max),
        }
    }
}
