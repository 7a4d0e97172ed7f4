//! Where a search looks: the views of its sites and the coefficients of J over them.

use super::plan::{Judges, thinning};
use super::state_file::Asked;
use super::weights::SceneWeights;
use crate::design::registration::surroundings::Surroundings;
use crate::rig::{Rig, Unit};
use crate::simulate::view::{
    CastSites, CastView, CellSites, CellView, Fineness, Precision, Sampling, View as _, ViewError, ViewSite,
};

/// What looks at the sites.
pub(crate) struct Views {
    pub model: CellSites,
    pub judges: Judges,
    pub weights: SceneWeights,
}

impl Views {
    /// Of sites, for sensors of these units and rigs like `largest`, at most.
    pub(crate) fn new(
        sites: Vec<ViewSite>,
        units: &[Unit],
        (sampling, fineness): (&Sampling, &Fineness),
        largest: &Rig,
        asked: &Asked<'_>,
    ) -> Result<Self, ViewError> {
        // together they hold no more than one alone may
        let fineness = Fineness { most_bytes: fineness.most_bytes / sites.len().max(1), ..*fineness };
        let model = |site: &ViewSite| CellView::new(site, units, sampling, &fineness);
        let models = sites.iter().map(model).collect::<Result<Vec<_>, _>>()?;
        let observable: Vec<u64> = models.iter().map(CellView::observable).collect();
        let observable_of_all = observable.iter().sum();
        let weights = SceneWeights::of_sites(asked.weights, observable, asked.criterion)
            .with_registration(asked.registration);
        let scales = weights.scales();
        let cast = |sampling: &Sampling| {
            let cast = |site: &ViewSite| CastView::new(site.clone(), units, sampling, Precision::Single);
            let views = sites.iter().map(cast).collect::<Result<Vec<_>, _>>()?;
            Ok(CastSites::new(views, scales.clone()))
        };
        let whole = cast(sampling)?;
        // a voxel that counts by its returns has fewer of thinned beams
        let thinning =
            if sampling.quality.min_hits > 1 { 1 } else { thinning(&whole, largest, observable_of_all) };
        let thinned = (thinning > 1).then(|| cast(&sampling.thinned(thinning))).transpose()?;
        let counts = weights.weights.ask_for_registration();
        let surroundings = counts.then(|| Surroundings::new(&whole.views()[0]));
        let judges = Judges { cast: whole, thinned, thinning, surroundings };
        Ok(Self { model: CellSites::new(models, scales), judges, weights })
    }
}
