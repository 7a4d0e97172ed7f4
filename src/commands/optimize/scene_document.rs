//! What `optimize --scene` prints and writes.

use std::time::Instant;

use anyhow::Context as _;

use super::args::Args;
use super::site::WalkSource;
use crate::base::files;
use crate::commands::output;
use crate::design::scene_search::{Answer, RigSpace, SceneSearch, SearchEnd};
use crate::report::scene_search::{
    Best, Document, ModelDocument, Pictured, SamplingDocument, SiteDocument, TrajectoryDocument,
    WeightsDocument, page,
};
use crate::rig::{Mount, MountFile, Rig};
use crate::simulate::view::{CastSites, CastView};

pub(super) fn document(
    args: &Args,
    cast: &CastSites,
    search: &SceneSearch<'_>,
    end: &SearchEnd,
    answer: Answer,
    (start, sources, warnings): (Instant, &[WalkSource], Vec<String>),
) -> Document {
    let winner = &end.exact[0];
    let masters = search.rigs.mounts(&winner.values).into_iter().map(numbers).collect();
    let sd = end.model_error.map(|error| error.sd);
    let error_bound = sd.zip(end.best_left).map(|(sd, left)| (left + 2.0 * sd - winner.objective()).max(0.0));
    let spins = search.rigs.units.iter().map(|unit| {
        let fans = cast.fans_of(&unit.model);
        let scans = fans.iter().map(|(_, scans)| scans.count).sum();
        (unit.model.name.clone(), fans[0].0.columns, scans)
    });
    let observable = &answer.observable_voxels;
    let site = |((view, source), reachable): ((&CastView, &WalkSource), &u64)| SiteDocument {
        scene: source.scene.clone(),
        trajectory: TrajectoryDocument::of(&view.site().trajectory, &source.name, &source.corners_m),
        reachable_voxels: *reachable,
    };
    let mut sites: Vec<_> = cast.views().iter().zip(sources).zip(observable).map(site).collect();
    let trajectory = TrajectoryDocument::all_of(&mut sites);
    Document {
        method: "two-level",
        seed: search.plan.seed,
        evaluations: end.evaluations,
        exact_evaluations: end.exact.len(),
        rays: end.rays + answer.rays + search.model.cost().rays,
        wall_s: start.elapsed().as_secs_f64(),
        stopped_by: end.stopped_by,
        best: Best { judged: answer.best.clone(), masters, error_bound },
        model: ModelDocument {
            cost: search.model.cost(),
            model_error: end.model_error,
            certain_voxels: search.model.certain_voxels(),
        },
        plan: search.plan,
        weights: WeightsDocument::new(args.scene.weights, &search.weights),
        reachable_voxels: observable.iter().sum::<u64>() / observable.len() as u64,
        voxel_m: cast.views()[0].site().grid.voxel_m,
        sampling: SamplingDocument {
            is_ideal: args.scene.ideal,
            scan_stride: args.scene.scan_stride,
            spins: spins.collect(),
            quality: args.scene.quality.quality().asked(),
        },
        trajectory,
        robust: (sites.len() > 1).then_some(search.weights.criterion),
        sites,
        history: end.history.clone(),
        by_count: Vec::new(),
        warnings,
        answer,
    }
}

fn numbers(mount: Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}

pub(super) fn write(args: &Args, rigs: &RigSpace, document: &Document, values: &[f64]) -> anyhow::Result<()> {
    if let Some(path) = &args.csv {
        files::write_whole(path, document.csv().as_bytes()).with_context(|| path.display().to_string())?;
    }
    let Some(path) = &args.out else { return Ok(()) };
    let mut file = MountFile::new(document.best.judged.sensors.clone());
    file.masters = Some(rigs.mounts(values).into_iter().map(numbers).collect());
    file.calibrations = rigs.calibrations(&rigs.rig(values));
    file.objective = Some(document.best.judged.objective);
    file.write(path)?;
    Ok(())
}

/// The page of `--report`.
pub(super) fn write_page(
    args: &Args,
    cast: &CastSites,
    document: &Document,
    best: &Rig,
    sources: &[WalkSource],
) -> anyhow::Result<()> {
    let Some(path) = &args.report else { return Ok(()) };
    let pictured = |(view, source): (&'_ CastView, &WalkSource)| Pictured {
        name: source.scene.clone(),
        site: view.site().clone(),
        coverage: view.cover(best),
        observable: view.cells_seen_by_any(),
        origin: source.origin,
    };
    let sites: Vec<Pictured> = cast.views().iter().zip(sources).map(pictured).collect();
    page(document, best, &sites, &output::again()).write(path).with_context(|| path.display().to_string())
}
