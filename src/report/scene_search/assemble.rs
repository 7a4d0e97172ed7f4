//! The document of a search in scenes, put together from what the search left.

use glam::DVec3;

use super::{
    Best, Document, ModelDocument, SamplingDocument, SiteDocument, TrajectoryDocument, WeightsDocument,
};
use crate::design::scene_search::{Answer, Asked, SceneSearch, SearchEnd};
use crate::rig::Mount;
use crate::simulate::view::{CastSites, CastView};
use crate::world::local_origin::LocalOrigin;

/// Where a scene and its trajectory come from.
pub(crate) struct SiteSource {
    /// The file of the scene, or "room".
    pub scene: String,
    /// Of the trajectory.
    pub name: String,
    /// Of a walk that was planned here.
    pub corners_m: Vec<DVec3>,
    /// Where the local frame of scene and trajectory begins.
    pub origin: LocalOrigin,
}

impl Document {
    /// Without numbers of sensors to compare, warnings and time.
    pub(crate) fn new(
        asked: &Asked<'_>,
        cast: &CastSites,
        search: &SceneSearch<'_>,
        end: &SearchEnd,
        answer: Answer,
        sources: &[SiteSource],
    ) -> Self {
        let winner = &end.exact[0];
        let sd = end.model_error.map(|error| error.sd);
        let error_bound = sd.zip(end.best_left).map(|(sd, left)| (left + 2.0 * sd).max(0.0));
        let spins = search.rigs.units.iter().map(|unit| {
            let fans = cast.fans_of(&unit.model);
            let scans = fans.iter().map(|(_, scans)| scans.count).sum();
            (unit.model.name.clone(), fans[0].0.columns, scans)
        });
        let observable = &answer.observable_voxels;
        let places = cast.views().iter().zip(sources).zip(observable);
        let mut sites: Vec<SiteDocument> = places.map(|(place, known)| site(place, *known)).collect();
        let trajectory = TrajectoryDocument::all_of(&mut sites);
        Self {
            method: "two-level",
            seed: search.plan.seed,
            evaluations: end.evaluations,
            exact_evaluations: end.judged,
            rays: end.rays + answer.rays + search.model.cost().rays,
            wall_s: 0.0,
            stopped_by: end.stopped_by,
            best: Best {
                judged: answer.best.clone(),
                masters: masters(search.rigs.mounts(&winner.values)),
                error_bound,
            },
            model: ModelDocument {
                cost: search.model.cost(),
                model_error: end.model_error,
                certain_voxels: search.model.certain_voxels(),
            },
            plan: search.plan,
            weights: WeightsDocument::new(asked.weights, &search.weights),
            reachable_voxels: observable.iter().sum::<u64>() / observable.len() as u64,
            voxel_m: cast.views()[0].site().grid.voxel_m,
            sampling: SamplingDocument {
                is_ideal: asked.is_ideal,
                scan_stride: asked.scan_stride,
                spins: spins.collect(),
                quality: asked.quality.asked(),
            },
            trajectory,
            robust: (!sites.is_empty()).then_some(asked.criterion),
            sites,
            history: end.history.clone(),
            by_count: Vec::new(),
            warnings: Vec::new(),
            answer,
        }
    }
}

/// x_m, y_m, z_m, pitch_deg, roll_deg of each.
pub(crate) fn masters(mounts: Vec<Mount>) -> Vec<[f64; 5]> {
    let numbers = |mount: Mount| {
        [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
    };
    mounts.into_iter().map(numbers).collect()
}

fn site((view, source): (&CastView, &SiteSource), reachable_voxels: u64) -> SiteDocument {
    let trajectory = &view.site().trajectory;
    let [start_ns, end_ns] = trajectory.time_span_ns();
    SiteDocument {
        scene: source.scene.clone(),
        trajectory: TrajectoryDocument {
            source: source.name.clone(),
            corners_m: source.corners_m.iter().map(|corner| corner.to_array()).collect(),
            length_m: trajectory.length_m(),
            duration_s: (end_ns - start_ns) as f64 * 1e-9,
        },
        reachable_voxels,
    }
}

impl TrajectoryDocument {
    /// That of the only site, which is taken out of the list, or all of them together.
    fn all_of(sites: &mut Vec<SiteDocument>) -> Self {
        if sites.len() == 1 {
            return sites.remove(0).trajectory;
        }
        let trajectories = || sites.iter().map(|site| &site.trajectory);
        Self {
            source: format!("{} sites", sites.len()),
            corners_m: Vec::new(),
            length_m: trajectories().map(|trajectory| trajectory.length_m).sum(),
            duration_s: trajectories().map(|trajectory| trajectory.duration_s).sum(),
        }
    }
}
