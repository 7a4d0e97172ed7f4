//! J of rigs: by the model, and by casting.

use rayon::prelude::*;

use super::exact::Exact;
use super::search::SceneSearch;
use crate::design::objective::Terms;
use crate::design::registration::{RegistrationQuality, surroundings};
use crate::rig::Rig;
use crate::simulate::view::Seen;

impl SceneSearch<'_> {
    /// J of the rigs as they are, by the model, by every `stride`-th voxel.
    pub(super) fn planned(&self, rigs: &[Rig], stride: usize) -> Vec<f64> {
        let seen = self.model.see_roughly(rigs, stride);
        let qualities = self.modelled_registration(rigs, self.weights.weights.registration != 0.0);
        let objective = |((rig, seen), quality): ((&Rig, &Seen), &Option<RegistrationQuality>)| {
            self.weights.terms(rig, seen, quality.as_ref()).objective()
        };
        rigs.iter().zip(&seen).zip(&qualities).map(objective).collect()
    }

    /// Registration strength by the map of the surroundings, where it is needed.
    fn modelled_registration(&self, rigs: &[Rig], is_needed: bool) -> Vec<Option<RegistrationQuality>> {
        let surroundings = self.judges.surroundings.as_ref().filter(|_| is_needed);
        let Some(surroundings) = surroundings else { return vec![None; rigs.len()] };
        let view = &self.judges.cast.views()[0];
        rigs.par_iter().map(|rig| surroundings.quality(view, rig)).collect()
    }

    /// By how much rigs miss what is asked, by the same map.
    pub(super) fn modelled_violations(&self, rigs: &[Rig]) -> Vec<f64> {
        let qualities = self.modelled_registration(rigs, self.weights.weights.least_conditioning > 0.0);
        rigs.iter().zip(&qualities).map(|(rig, quality)| self.violation(rig, quality.as_ref())).collect()
    }

    /// Distances between sensors that miss, m, and the share by which the conditioning falls short.
    fn violation(&self, rig: &Rig, quality: Option<&RegistrationQuality>) -> f64 {
        self.rigs.violation_m(rig) + self.weights.weights.conditioning_shortfall(quality)
    }

    /// The terms of J of a rig that was cast; where registration counts some of its beams are cast once more.
    pub(super) fn terms(&self, rig: &Rig, seen: &Seen) -> (Terms, Option<RegistrationQuality>) {
        let is_asked = self.judges.surroundings.is_some();
        let quality = is_asked.then(|| surroundings::cast(&self.judges.cast.views()[0], rig)).flatten();
        (self.weights.terms(rig, seen, quality.as_ref()), quality)
    }

    /// Points, their scores by the model, and what their rigs see by casting.
    pub(super) fn exact(
        &self,
        (points, scores): (Vec<Vec<f64>>, &[f64]),
        rigs: Vec<Rig>,
        seen: Vec<Seen>,
    ) -> Vec<Exact> {
        let losses = self.modelled_losses(&rigs, scores);
        let exact = |(((values, rig), seen), loss)| {
            let (terms, registration) = self.terms(&rig, &seen);
            let violation = self.violation(&rig, registration.as_ref());
            Exact {
                values,
                rig,
                seen,
                seen_thinned: None,
                terms,
                registration,
                violation,
                loss,
                losses: None,
                coverage: None,
            }
        };
        points.into_iter().zip(rigs).zip(seen).zip(losses).map(exact).collect()
    }
}
