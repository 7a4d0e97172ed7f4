//! `optimize --scene`: the search in any scene.

use std::time::Instant;

use anyhow::{Context as _, bail};
use glam::DVec3;

use super::args::{Args, Corners};
use crate::base::files;
use crate::commands::experiment_args::ExperimentArgs;
use crate::commands::scene_args::{WalkText, read_trajectory};
use crate::commands::scene_file;
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, signals, wrong_usage};
use crate::design::optimize::{KeepApart, MountBounds};
use crate::design::scene_search::{Answer, Plan, RigSpace, SceneSearch, SceneWeights, SearchEnd};
use crate::report::scene_search::{
    Best, Document, ModelDocument, SamplingDocument, TrajectoryDocument, WeightsDocument,
};
use crate::rig::{Mount, MountFile, Rig, Unit};
use crate::simulate::prediction::grid_of;
use crate::simulate::published::Roll;
use crate::simulate::view::{CastView, CellView, Fineness, Precision, Sampling, View as _, ViewSite};
use crate::simulate::walk::{self, Walk};
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::LoadedScene;
use crate::world::trajectory::{Trajectory, suspicions};

/// What only a search in a published experiment knows.
const OF_AN_EXPERIMENT: [&str; 17] = [
    "method",
    "early_stop",
    "batch",
    "acquisition",
    "masters_max",
    "masters_min",
    "robust",
    "tolerance",
    "free_spin",
    "draws",
    "final_look",
    "fidelity",
    "regret",
    "max_rays",
    "certify",
    "export_published",
    "resume",
];
/// And what only a search in a scene.
const OF_A_SCENE: [&str; 13] = [
    "trajectory",
    "rate",
    "trajectory_out",
    "sensors",
    "ideal",
    "scan_stride",
    "weights",
    "present",
    "mesh_unit",
    "up",
    "map_voxel",
    "map_hits",
    "map_path",
];

const DEFAULT_VOXEL_M: f64 = 0.1;
const DEFAULT_EVALUATIONS: u64 = 1000;
/// Least range of an ideal sensor, m.
const IDEAL_MIN_RANGE_M: f64 = 0.3;
/// Fewer channels leave gaps that many views have to fill.
const FEW_CHANNELS: usize = 32;
/// A search corrects its model, and may look coarsely.
const SEARCH_STEP_SHARE: f64 = 0.85;

/// Whether a scene is asked for; refuses what has no use then, or otherwise.
pub fn is_asked(args: &Args, context: Context) -> anyhow::Result<bool> {
    let is_scene = args.scene.scene.is_some() || args.scene.room.is_some();
    if is_scene {
        let why = "is about a published experiment, and --scene or --room searches another place";
        context.ensure_not_typed(&ExperimentArgs::ONLY_PUBLISHED, why)?;
        context.ensure_not_typed(&OF_AN_EXPERIMENT, why)?;
    } else {
        context.ensure_not_typed(
            &OF_A_SCENE,
            "is about a search in a place of your own: add --scene or --room",
        )?;
    }
    Ok(is_scene)
}

/// Searches and reports.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if args.csv.is_some() || args.report.is_some() {
        context.ensure_not_typed(
            &["csv", "report"],
            "is not written of a search in a scene; --json has everything",
        )?;
    }
    output::check_places([&args.out, &args.scene.trajectory_out])?;
    let start = Instant::now();
    let rigs = rig_space(args)?;
    let present = args.scene.present.as_deref().map(|path| present(path, &rigs)).transpose()?;
    let (site, mut warnings, source) = site(args, context)?;
    warnings.iter().for_each(|warning| output::say_notice(warning));
    if let Some(path) = &args.scene.trajectory_out {
        files::write_whole(path, site.trajectory.moved(source.origin.world_m()).to_tum().as_bytes())
            .with_context(|| path.display().to_string())?;
    }
    let sampling = sampling(args);
    let stop = signals::stop_flag()?;
    let stage = Stage::begin("looking around from the trajectory");
    let evaluations = args.evals.unwrap_or(DEFAULT_EVALUATIONS) as usize;
    let seed = args.seed.unwrap_or(1);
    let mut units = rigs.units.clone();
    units.extend(present.iter().flat_map(|(units, _)| units.iter().cloned()));
    let channels = rigs.units.iter().map(|unit| unit.model.channels()).min().unwrap_or(0);
    let fineness = Fineness {
        views: if channels < FEW_CHANNELS { 100 } else { 50 },
        step_share: SEARCH_STEP_SHARE,
        ..Fineness::between(rigs.bounds.z_m)
    };
    let model = CellView::new(&site, &units, &sampling, &fineness)?;
    let cast = CastView::new(site, &units, &sampling, Precision::Single).map_err(wrong_usage)?;
    let weights = SceneWeights::new(args.scene.weights, model.observable());
    let middle: Vec<f64> =
        rigs.space()?.variables().iter().map(|variable| 0.5 * (variable.low + variable.high)).collect();
    let plan = Plan::new(evaluations, seed, cast.rays(&rigs.rig(&middle)));
    let mut search = SceneSearch::new(&rigs, model, &cast, weights, plan)?;
    stage.counts(evaluations as u64, 0);
    let progress = |done: usize, what: &str| {
        stage.at(done as u64);
        stage.say(what);
    };
    let end = search.run(&progress, &stop);
    stage.next("casting what the best mount is compared with");
    let answer = search.answer(&cast, &end.exact, present.as_ref().map(|(_, rig)| rig));
    drop(stage);
    let Some(answer) = answer else {
        bail!("stopped before the first exact evaluation: no mount was scored")
    };
    let winner = &end.exact[0];
    let violation_m = rigs.violation_m(&winner.rig);
    if violation_m > 0.0 {
        bail!(
            "none of {} mounts keeps the sensors apart; the nearest misses it by {violation_m:.4} m: give a larger --space, or \
             a smaller --clearance",
            end.evaluations
        );
    }
    warnings.extend(answer.doubts());
    warnings.extend(rigs.limits_of(&winner.values));
    let document = document(args, &cast, &search, &end, answer, (start, source, warnings));
    let written = write(args, &rigs, &document, &winner.values);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    written?;
    Ok(Outcome::Done)
}

fn rig_space(args: &Args) -> anyhow::Result<RigSpace> {
    if args.scene.sensors.is_empty() {
        refuse!(
            "which sensors? Give --sensors, models of the catalogue with commas between them (os1-64,os1-64)"
        );
    }
    let mut units: Vec<Unit> = Vec::new();
    let mut places = Vec::new();
    for name in &args.scene.sensors {
        let unit = Unit::nominal(name.trim()).map_err(wrong_usage)?;
        let place = units.iter().position(|known| *known == unit).unwrap_or_else(|| {
            units.push(unit);
            units.len() - 1
        });
        places.push(place);
    }
    let settings = args.experiment.of_scene();
    let mut bounds = MountBounds {
        pitch_deg: (args.pitch_limits.0, args.pitch_limits.1),
        roll_deg: (args.roll_limits.0, args.roll_limits.1),
        ..MountBounds::default()
    };
    if let Some(Corners([x0, x1, y0, y1, z0, z1])) = args.space {
        (bounds.x_m, bounds.y_m, bounds.z_m) = ((x0, x1), (y0, y1), (z0, z1));
    }
    Ok(RigSpace {
        masters: RigSpace::masters_of(&places, settings.is_mirrored),
        units,
        bounds,
        fixed_roll_deg: match settings.roll {
            Roll::Fixed(roll_deg) => Some(roll_deg),
            Roll::Free => None,
        },
        tilt_step_deg: args.tilt_step,
        keep_apart: args.clearance.map_or(KeepApart::Housings, |clearance| clearance.0),
    })
}

fn sampling(args: &Args) -> Sampling {
    Sampling {
        is_ideal: args.scene.ideal,
        columns: args.experiment.of_scene().columns,
        scan_stride: args.scene.scan_stride,
        min_range_m: args.scene.ideal.then_some(IDEAL_MIN_RANGE_M),
        ..Sampling::default()
    }
}

/// The units and the rig of a mount file.
fn present(path: &std::path::Path, rigs: &RigSpace) -> anyhow::Result<(Vec<Unit>, Rig)> {
    let file = MountFile::read(path)?;
    let units = file.units(&[])?;
    let rig = file.rig_of(&units);
    let of_search = rigs.rig_of(&vec![Mount::default(); rigs.masters.len()]);
    if rig.sensors.len() != of_search.sensors.len() {
        output::say_notice(&format!(
            "{}: {} sensors, and {} are searched: the two are judged side by side as they are",
            path.display(),
            rig.sensors.len(),
            of_search.sensors.len()
        ));
    }
    Ok((units, rig))
}

fn site(args: &Args, context: Context) -> anyhow::Result<(ViewSite, Vec<String>, WalkSource)> {
    let scene_args = &args.scene;
    let mut loaded = match (&scene_args.scene, &scene_args.room) {
        (Some(path), _) => scene_file::read(path, &scene_args.mesh, &scene_args.map, context)?,
        (None, Some(room)) => {
            scene_file::ensure_none_typed(context, "the scene is a room")?;
            LoadedScene::of_room(&room.scene())
        }
        (None, None) => refuse!("give --scene or --room"),
    };
    let (trajectory, source) = walk_of(args, context, &mut loaded)?;
    let voxel_m = args.experiment.of_scene().voxel_m.unwrap_or(DEFAULT_VOXEL_M);
    let grid = grid_of(&loaded.scene, voxel_m).map_err(wrong_usage)?;
    Ok((ViewSite { scene: loaded.scene, trajectory, grid }, loaded.warnings, source))
}

/// Where the trajectory comes from.
struct WalkSource {
    name: String,
    /// Of a walk that was planned here.
    corners_m: Vec<DVec3>,
    /// Where the local frame of scene and trajectory begins.
    origin: LocalOrigin,
}

fn walk_of(
    args: &Args,
    context: Context,
    loaded: &mut LoadedScene,
) -> anyhow::Result<(Trajectory, WalkSource)> {
    if !matches!(args.scene.trajectory, Some(WalkText::File(_))) {
        context.ensure_not_typed(&["rate"], "is about a trajectory in KITTI format, which is not given")?;
    }
    let (Walk { trajectory, corners_m, doubts }, name) = match &args.scene.trajectory {
        None => {
            let walk = walk::planned(&loaded.scene)?;
            let name = format!("planned through the free floor, {} legs", walk.corners_m.len() - 1);
            (walk, name)
        }
        Some(WalkText::Waypoints(waypoints)) => {
            let local: Vec<_> = waypoints.iter().map(|waypoint| waypoint.local(loaded.origin)).collect();
            (walk::along(&loaded.scene, &local)?, format!("{} waypoints", waypoints.len()))
        }
        Some(WalkText::File(path)) => {
            let name = path.display().to_string();
            let (trajectory, mut doubts) = read_trajectory(path, args.scene.rate)?;
            doubts.extend(suspicions(&trajectory, &name));
            let trajectory = loaded.origin.local_trajectory(trajectory);
            (Walk { trajectory, corners_m: Vec::new(), doubts }, name)
        }
    };
    loaded.warnings.extend(doubts);
    let scene = &loaded.scene;
    let placement = Placement::new(scene, &trajectory, 0.0, loaded.origin);
    if placement.is_wrong {
        bail!("{name}: {}", placement.doubts.join("; "));
    }
    loaded.warnings.extend(placement.doubts.iter().map(|doubt| format!("{name}: {doubt}")));
    let corners_m = corners_m.into_iter().map(|corner_m| loaded.origin.world(corner_m)).collect();
    Ok((trajectory, WalkSource { name, corners_m, origin: loaded.origin }))
}

fn document(
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
            settled_voxels: search.model.settled_voxels(),
        },
        plan: search.plan,
        weights: WeightsDocument::new(args.scene.weights, &search.weights),
        reachable_voxels: answer.observable_voxels,
        voxel_m: cast.site().grid.voxel_m,
        sampling: SamplingDocument {
            is_ideal: args.scene.ideal,
            scan_stride: args.scene.scan_stride,
            spins: spins.collect(),
        },
        trajectory: TrajectoryDocument {
            source: source.name,
            corners_m: source.corners_m.iter().map(|corner| corner.to_array()).collect(),
            length_m: trajectory.length_m(),
            duration_s: (end_ns - start_ns) as f64 * 1e-9,
        },
        history: end.history.clone(),
        warnings,
        answer,
    }
}

fn numbers(mount: Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}

fn write(args: &Args, rigs: &RigSpace, document: &Document, values: &[f64]) -> anyhow::Result<()> {
    document.warnings.iter().for_each(|warning| output::say_notice(warning));
    let Some(path) = &args.out else { return Ok(()) };
    let mut file = MountFile::new(document.best.judged.sensors.clone());
    file.masters = Some(rigs.mounts(values).into_iter().map(numbers).collect());
    file.objective = Some(document.best.judged.objective);
    file.write(path)?;
    Ok(())
}
