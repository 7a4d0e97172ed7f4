//! `optimize --scene`: the search in any scene.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::args::{Args, Corners};
use super::scene_flags::Counts;
use super::scene_state::{Question, State};
use super::site::{WalkSource, site};
use crate::base::files;
use crate::commands::experiment_args::ExperimentArgs;
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, signals, wrong_usage};
use crate::design::optimize::{KeepApart, MountBounds};
use crate::design::scene_search::{Answer, Findings, Plan, RigSpace, SceneSearch, SceneWeights, SearchEnd};
use crate::report::scene_search::{
    Best, CountDocument, Document, ModelDocument, Pictured, SamplingDocument, TrajectoryDocument,
    WeightsDocument, page,
};
use crate::rig::{Mount, MountFile, Rig, Unit};
use crate::simulate::published::Roll;
use crate::simulate::view::{CastView, CellView, Fineness, Precision, Sampling, View as _};
use anyhow::{Context as _, bail};

/// What only a search in a published experiment knows.
const OF_AN_EXPERIMENT: [&str; 16] = [
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
];
/// And what only a search in a scene.
const OF_A_SCENE: [&str; 15] = [
    "trajectory",
    "rate",
    "trajectory_out",
    "sensors",
    "count",
    "operator",
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

const DEFAULT_EVALUATIONS: u64 = 1000;
/// Least range of an ideal sensor, m.
const IDEAL_MIN_RANGE_M: f64 = 0.3;
/// Fewer channels leave gaps that many views have to fill.
const FEW_CHANNELS: usize = 32;
/// A search corrects its model, and may look coarsely: rays, and layers of height, m.
const SEARCH_STEP_SHARE: f64 = 0.85;
const SEARCH_LAYER_GAP_M: f64 = 0.15;

/// Whether a scene is asked for; refuses what has no use then, or otherwise.
pub(crate) fn is_asked(args: &Args, context: Context) -> anyhow::Result<bool> {
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
    let files = [&args.out, &args.scene.trajectory_out, &args.csv, &args.report, &args.resume];
    output::check_places(files)?;
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
    }
    .with_gaps(SEARCH_LAYER_GAP_M);
    let mut model = CellView::new(&site, &units, &sampling, &fineness)?;
    let cast = CastView::new(site, &units, &sampling, Precision::Single).map_err(wrong_usage)?;
    let weights = SceneWeights::new(args.scene.weights, model.observable());
    let run = Run { args, cast: &cast, weights, evaluations, seed, stage: &stage, stop: &stop };
    let (rigs, known, by_count) = run.by_count(rigs, &mut model)?;
    let (search, mut end) = run.search(&rigs, &mut model, known)?;
    stage.next("casting what the best mount is compared with");
    let answer = search.answer(&cast, &mut end.exact, present.as_ref().map(|(_, rig)| rig));
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
    let origin = source.origin;
    let mut document = document(args, &cast, &search, &end, answer, (start, source, warnings));
    document.by_count = by_count;
    let written = write(args, &rigs, &document, &winner.values).and_then(|()| {
        let Some(path) = &args.report else { return Ok(()) };
        let coverage = cast.cover(&winner.rig);
        let observable = cast.cells_seen_by_any();
        let made_by = output::again();
        let pictured = Pictured {
            coverage: &coverage,
            bounds_m: cast.site().scene.bounds_m(),
            observable: &observable,
            origin,
            made_by: &made_by,
        };
        page(&document, &pictured).write(path).with_context(|| path.display().to_string())
    });
    output::print_result(context.json, &document, || document.summary(), &[])?;
    written?;
    Ok(Outcome::Done)
}

/// What all searches of a command share.
struct Run<'a, 's> {
    args: &'s Args,
    cast: &'a CastView,
    weights: SceneWeights,
    evaluations: usize,
    seed: u64,
    stage: &'s Stage,
    stop: &'s AtomicBool,
}

impl<'a> Run<'a, '_> {
    /// Searches with each number of sensors that is asked for; the rigs of the best number by J, and what was found there.
    fn by_count(
        &self,
        rigs: RigSpace,
        model: &mut CellView,
    ) -> anyhow::Result<(RigSpace, Option<Findings>, Vec<CountDocument>)> {
        let Some(Counts(first, last)) = self.args.scene.count else { return Ok((rigs, None, Vec::new())) };
        let mut best: Option<(f64, RigSpace, Findings)> = None;
        let mut found = Vec::new();
        for sensors in first..=last {
            let rigs = rigs.with_sensors(sensors, self.args.experiment.of_scene().is_mirrored);
            let (search, mut end) = self.search(&rigs, model, None)?;
            let findings = search.findings().clone();
            end.exact.retain(|exact| rigs.violation_m(&exact.rig) == 0.0);
            let Some(winner) = end.exact.first() else {
                output::say_notice(&format!(
                    "no mount of {sensors} sensors keeps them apart: give a larger --space"
                ));
                continue;
            };
            found.push(CountDocument {
                sensors,
                unique_voxels: winner.seen.union as u64,
                observable_share: 0.0,
                objective: winner.objective(),
            });
            if best.as_ref().is_none_or(|(objective, ..)| winner.objective() > *objective) {
                best = Some((winner.objective(), rigs.clone(), findings));
            }
        }
        let observable = self.weights.observable.max(self.cast.seen_by_any()).max(1);
        found
            .iter_mut()
            .for_each(|found| found.observable_share = found.unique_voxels as f64 / observable as f64);
        match best {
            Some((_, rigs, findings)) => Ok((rigs, Some(findings), found)),
            None => bail!(
                "none of {first} to {last} sensors fits: give a larger --space, or a smaller --clearance"
            ),
        }
    }

    /// One search; `known` is what it found before.
    fn search<'b>(
        &self,
        rigs: &'b RigSpace,
        model: &'b mut CellView,
        known: Option<Findings>,
    ) -> anyhow::Result<(SceneSearch<'b>, SearchEnd)>
    where
        'a: 'b,
    {
        let space = rigs.space()?;
        let middle: Vec<f64> =
            space.variables().iter().map(|variable| 0.5 * (variable.low + variable.high)).collect();
        let plan = Plan::new(self.evaluations, self.seed, self.cast.rays(&rigs.rig(&middle)));
        let mut state = None;
        let known = match (known, &self.args.resume) {
            (Some(known), _) => known,
            (None, Some(path)) => {
                let question = Question::of(self.args, &plan, rigs, self.cast);
                let (opened, known) = State::open(path, question)?;
                state = Some(opened);
                known
            }
            (None, None) => Findings::default(),
        };
        let mut search = SceneSearch::new(rigs, model, self.cast, self.weights, plan, known)?;
        self.stage.counts(self.evaluations as u64, 0);
        let failed = std::cell::RefCell::new(None);
        let progress = |search: &SceneSearch<'_>, what: &str| {
            self.stage.at(search.evaluations() as u64);
            self.stage.say(what);
            if let Some(Err(error)) = state.as_ref().map(|state| state.keep(search.findings())) {
                failed.borrow_mut().get_or_insert(error);
                self.stop.store(true, std::sync::atomic::Ordering::Relaxed);
            }
        };
        let end = search.run(&progress, self.stop);
        match failed.into_inner() {
            Some(error) => Err(error),
            None => Ok((search, end)),
        }
    }
}

fn rig_space(args: &Args) -> anyhow::Result<RigSpace> {
    if args.scene.sensors.is_empty() {
        refuse!(
            "which sensors? Give --sensors, models of the catalogue with commas between them (os1-64,os1-64)"
        );
    }
    if args.scene.count.is_some() && args.scene.sensors.len() > 1 {
        refuse!("--count is about one model, and --sensors names {}: give it once", args.scene.sensors.len());
    }
    let mut units: Vec<Unit> = Vec::new();
    let mut files: Vec<Option<PathBuf>> = Vec::new();
    let mut places = Vec::new();
    for typed in &args.scene.sensors {
        let (unit, file) = Unit::typed(typed.trim()).map_err(wrong_usage)?;
        let place = units.iter().position(|known| known.model == unit.model).unwrap_or_else(|| {
            unit.notice.iter().for_each(|notice| output::say_notice(notice));
            units.push(unit);
            files.push(file);
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
        files,
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
        by_count: Vec::new(),
        warnings,
        answer,
    }
}

fn numbers(mount: Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}

fn write(args: &Args, rigs: &RigSpace, document: &Document, values: &[f64]) -> anyhow::Result<()> {
    document.warnings.iter().for_each(|warning| output::say_notice(warning));
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
