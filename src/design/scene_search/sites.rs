//! Where a search looks: the views of its sites and the coefficients of J over them.

use super::state_file::Asked;
use super::weights::SceneWeights;
use crate::rig::Unit;
use crate::simulate::view::{
    CastSites, CastView, CellSites, CellView, Fineness, Precision, Sampling, View as _, ViewError, ViewSite,
};

/// The model and the exact view of sites, and the coefficients of J over them.
pub(crate) fn views_of(
    sites: Vec<ViewSite>,
    units: &[Unit],
    (sampling, fineness): (&Sampling, &Fineness),
    asked: &Asked<'_>,
) -> Result<(CellSites, CastSites, SceneWeights), ViewError> {
    // together they hold no more than one alone may
    let fineness = Fineness { most_bytes: fineness.most_bytes / sites.len().max(1), ..*fineness };
    let model = |site: &ViewSite| CellView::new(site, units, sampling, &fineness);
    let models = sites.iter().map(model).collect::<Result<Vec<_>, _>>()?;
    let cast = |site: ViewSite| CastView::new(site, units, sampling, Precision::Single);
    let casts = sites.into_iter().map(cast).collect::<Result<Vec<_>, _>>()?;
    let observable = models.iter().map(CellView::observable).collect();
    let weights = SceneWeights::of_sites(asked.weights, observable, asked.criterion);
    let scales = weights.scales();
    Ok((CellSites::new(models, scales.clone()), CastSites::new(casts, scales), weights))
}
