//! What `optimize --scene` prints and writes.

use std::time::Instant;

use anyhow::Context as _;

use super::args::Args;
use super::site::WalkSource;
use crate::base::files;
use crate::commands::output;
use crate::design::scene_search::{Answer, RigSpace, SceneSearch, SearchEnd};
use crate::report::scene_search::{
    Best, Document, ModelDocument, Pictured, SamplingDocument, TrajectoryDocument, WeightsDocument, page,
};
use crate::rig::{Mount, MountFile, Rig};
use crate::simulate::view::CastView;
use crate::world::local_origin::LocalOrigin;

pub(super) fn document(
    args: &Args,
    cast: &CastView,
    search: &SceneSearch<'_>,
    end: &SearchEnd,
    answer: Answer,
    (start, source, warnings): (Instant, WalkSource, Vec<String>),
) -> Document {
    let winner = &end.exact[0];
    let masters = search.rigs.mounts(&winner.values).into_iter().map(numbers).collect();
    let sd = end.model_error.map(|error| error.sd);
    let error_bound = sd.zip(end.best_left).map(|(sd, left)| (left + 2.0 * sd - winner.objective()).max(0.0));
    let trajectory = &cast.site().trajectory;
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let spins = search.rigs.units.iter().map(|unit| {
        let (fan, scans) = cast.fan_of(&unit.model);
        (unit.model.name.clone(), fan.columns, scans.count)
    });
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
        reachable_voxels: answer.observable_voxels,
        voxel_m: cast.site().grid.voxel_m,
        sampling: SamplingDocument {
            is_ideal: args.scene.ideal,
            scan_stride: args.scene.scan_stride,
            spins: spins.collect(),
            quality: args.scene.quality.quality().asked(),
        },
        trajectory: TrajectoryDocument {
            source: source.name,
            corners_m: source.corners_m.iter().map(|corner| corner.to_array()).collect(),
            length_m: trajectory.length_m(),
            duration_s: (end_ns - start_ns) as f64 * 1e-9,
        },
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
    cast: &CastView,
    document: &Document,
    best: &Rig,
    origin: LocalOrigin,
) -> anyhow::Result<()> {
    let Some(path) = &args.report else { return Ok(()) };
    let coverage = cast.cover(best);
    let observable = cast.cells_seen_by_any();
    let made_by = output::again();
    let pictured = Pictured {
        scene: &cast.site().scene,
        trajectory: &cast.site().trajectory,
        rig: best,
        coverage: &coverage,
        observable: &observable,
        origin,
        made_by: &made_by,
    };
    page(document, &pictured).write(path).with_context(|| path.display().to_string())
}
