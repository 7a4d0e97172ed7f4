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

/// Beams of a rig beyond which not every revolution is cast, where no stride is given.
const MOST_RAYS: u64 = 500_000_000;

/// How many revolutions there are to one that is cast, where a rig like this has no more beams than are affordable, and the beams of all.
/// A voxel that counts by its returns needs all of them.
///
/// # Errors
/// Those of a view.
pub(crate) fn affordable_stride(
    sites: &[ViewSite],
    units: &[Unit],
    sampling: &Sampling,
    rig: &Rig,
) -> Result<(u32, u64), ViewError> {
    let rays =
        |site: &ViewSite| Ok(CastView::new(site.clone(), units, sampling, Precision::Single)?.rays(rig));
    let rays = sites.iter().map(rays).sum::<Result<u64, ViewError>>()?;
    let stride = if sampling.quality.min_hits > 1 { 1 } else { rays.div_ceil(MOST_RAYS).max(1) };
    Ok((stride as u32, rays))
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::base::geometry::Pose;
    use crate::rig::{Mount, MountedSensor};
    use crate::simulate::view::Shades;
    use crate::world::coverage::VoxelGrid;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    #[test]
    fn revolutions_are_left_out_where_all_are_too_many_beams() {
        let scene = Scene::Box(BoxScene::closed(DVec3::splat(-2.0), DVec3::splat(2.0)));
        let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.5);
        let standing = |seconds: u64| ViewSite {
            scene: scene.clone(),
            trajectory: Trajectory::new(vec![(0, Pose::IDENTITY), (seconds * 1_000_000_000, Pose::IDENTITY)])
                .unwrap(),
            grid: grid.clone(),
            shades: Shades::default(),
        };
        let unit = Unit::nominal("os0-128").unwrap();
        let sensor = MountedSensor { name: "a".into(), model: unit.model.clone(), mount: Mount::default() };
        let rig = Rig { sensors: vec![sensor.clone(), MountedSensor { name: "b".into(), ..sensor }] };
        let rays_per_s = 2 * 128 * 1024 * 10;
        let mut sampling = Sampling::default();
        let mut found = |sites: &[u64], min_hits| {
            sampling.quality.min_hits = min_hits;
            let sites: Vec<ViewSite> = sites.iter().map(|seconds| standing(*seconds)).collect();
            affordable_stride(&sites, std::slice::from_ref(&unit), &sampling, &rig).unwrap()
        };
        assert_eq!(found(&[100], 1), (1, 100 * rays_per_s));
        assert_eq!(found(&[190], 1), (1, 190 * rays_per_s));
        assert_eq!(found(&[191], 1), (2, 191 * rays_per_s));
        assert_eq!(found(&[1000, 465], 1), (8, 1465 * rays_per_s));
        assert_eq!(found(&[1000], 2).0, 1);
    }
}
