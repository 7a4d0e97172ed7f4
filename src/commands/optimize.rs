//! `outrigger optimize`

mod args;
mod busy;
mod final_look;
mod outputs;
mod published;
mod refine;
mod state;
mod summary;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::bail;
use serde::Serialize;

pub use args::Args;
use args::{Corners, Range};

use super::defaults::long_name;
use super::stage::Stage;
use super::{Context, Outcome, output, signals, wrong_usage};
use crate::design::objective::{Evaluation, Objective};
use crate::design::optimize::{
    Certificate, KeepApart, Kind, MountProblem, MountSearch, Search, Settings, StoppedBy, Trial, certify,
};
use crate::design::robustness::{Robustness, Spread, Tolerance};
use crate::simulate::published::{Experiment, ExperimentError, Path, Roll};

/// Seconds between two writings of the state file.
const SAVE_EVERY: Duration = Duration::from_secs(10);

/// Of the draws of mount errors, the same in every search so that scores compare.
const ROBUST_SEED: u64 = 1;

/// The document that `optimize` prints.
#[derive(Serialize)]
struct Document {
    method: Kind,
    seed: u64,
    evaluations: usize,
    rays: u64,
    wall_s: f64,
    /// Part of `wall_s` during which the objective was at work on some thread.
    objective_s: f64,
    /// The rest: what the search itself took.
    search_s: f64,
    stopped_by: StoppedBy,
    /// J over mount errors, where the search was for it.
    robust: Option<Spread>,
    best: Best,
    /// No mount of this space can score above this: all reachable voxels with every reward for each number of sensors,
    /// or what was proved of one master.
    bound: Option<f64>,
    /// The mount under finer models; null unless asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    fidelity: Option<refine::Refined>,
    /// The best mounts as they would be built; null where they were not looked at again.
    final_look: Option<final_look::Looked>,
    /// What was proved of rigs of one master; null unless asked for.
    certificate: Option<Proved>,
    command: String,
    /// Evaluation that found the best, from 1.
    best_at: usize,
    /// Of a mixed rig all presets, with commas between them.
    preset: String,
    /// Price of a sensor of each of them.
    prices: Vec<f64>,
    path: Path,
    clearance: KeepApart,
    masters_max: u32,
    /// `[evaluation, best objective so far]`; null while nothing feasible was found.
    history: Vec<(usize, Option<f64>)>,
}

/// A proof and what it took.
#[derive(Clone, Copy, Serialize)]
struct Proved {
    #[serde(flatten)]
    certificate: Certificate,
    wall_s: f64,
}

/// A search that has ended.
struct Ended<'a> {
    search: &'a Search,
    best: &'a Trial,
    stopped_by: StoppedBy,
    wall_s: f64,
    /// Part of it during which the objective was at work.
    objective_s: f64,
    proved: Option<Proved>,
    refined: Option<refine::Refined>,
    final_look: Option<final_look::Looked>,
}

#[derive(Serialize)]
struct Best {
    #[serde(flatten)]
    evaluation: Evaluation,
    /// `[x_m, y_m, z_m, pitch_deg, roll_deg]` of each sensor before mirroring.
    masters: Vec<[f64; 5]>,
    /// Model of each.
    master_models: Vec<&'static str>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    output::check_places([&args.out, &args.export_published, &args.csv, &args.report, &args.resume])?;
    let given = args.experiment.objective(Roll::Fixed(0.0))?;
    refuse_mixed(args, given.simulator().experiment())?;
    let finer = refine::Finer::asked(args, &given)?;
    let problem = problem(args, context, finer.as_ref().map_or(&given, |finer| finer.objective()).clone())?;
    let question = state::question(&problem, args.clearance.0)?;
    let mut search =
        match args.resume.as_deref().map(|path| state::read(path, &question)).transpose()?.flatten() {
            Some(search) => continued(args, context, search)?,
            None => begun(args, &problem)?,
        };
    let looks_again = final_look::is_wanted(args, search.kind(), finer.is_some())?;
    if context.is_typed("tolerance") && args.robust.is_none() && !looks_again {
        refuse!("--tolerance is about --robust and --final-look, and neither is asked for");
    }
    if context.is_typed("regret") && finer.is_none() {
        refuse!("--regret is about --fidelity auto, which is not asked for");
    }
    refuse_unused(context, search.kind())?;
    let budget = args.evals.map_or(search.settings().budget, |evals| evals as usize);
    let stop = signals::stop_flag()?;
    let bar = Stage::begin("searching");
    bar.counts(budget as u64, search.evaluations() as u64);
    let start = Instant::now();
    let mut saved = Instant::now();
    let mut save_error = None;
    let busy = busy::Busy::default();
    let are_rays_spent = AtomicBool::new(false);
    let stopped_by = search.run(
        budget,
        |values| {
            let measured = busy.during(|| problem.measure(values))?;
            if let Some(finer) = &finer {
                finer.note(values, &measured);
            }
            Ok::<_, ExperimentError>(measured)
        },
        |search| {
            let are_spent = args.max_rays.is_some_and(|most| search.rays() >= most);
            if are_spent && !stop.load(Ordering::Relaxed) {
                are_rays_spent.store(true, Ordering::Relaxed);
                stop.store(true, Ordering::Relaxed);
            }
            bar.at(search.evaluations() as u64);
            if let Some(best) = search.best() {
                bar.say(format!("evaluation {} of {budget}, J {:.1}", search.evaluations(), best.score));
            }
            if let Some(path) = &args.resume
                && save_error.is_none()
                && saved.elapsed() > SAVE_EVERY
            {
                save_error = state::write(path, &question, search).err();
                saved = Instant::now();
            }
        },
        &stop,
    )?;
    let wall_s = start.elapsed().as_secs_f64();
    let are_rays_spent = are_rays_spent.into_inner();
    if are_rays_spent {
        // by itself, not by the user: the looks that follow are not to end
        stop.store(false, Ordering::Relaxed);
    }
    let stopped_by = match stopped_by {
        StoppedBy::Interrupted if are_rays_spent => StoppedBy::Rays,
        other => other,
    };
    drop(bar);
    if let Some(path) = &args.resume {
        save_error.map_or_else(|| state::write(path, &question, &search), Err)?;
    }
    let Some(best) = search.best() else { bail!("stopped before the first evaluation: no mount was scored") };
    let start = Instant::now();
    let stage = args.certify.map(|_| Stage::begin("bounding what any mount could score"));
    let certificate =
        args.certify.map(|regions| certify(&problem, best.score, regions, &stop)).transpose()?.flatten();
    drop(stage);
    if args.certify.is_some() && stop.load(Ordering::Relaxed) {
        output::say_notice("interrupted: what is proved is what was bounded until then, if anything");
    }
    let proved = certificate.map(|certificate| Proved { certificate, wall_s: start.elapsed().as_secs_f64() });
    let objective_s = busy.seconds();
    let (refined, final_look) = if stop.load(Ordering::Relaxed) {
        // who stops a search wants its best now: looking again may take longer than the search
        if looks_again || finer.is_some() {
            output::say_notice(
                "interrupted: the best mount is given as searched, without another look at the best ones",
            );
        }
        (None, None)
    } else {
        let looks = looks_again || finer.is_some();
        let stage = looks.then(|| Stage::begin("looking again at the best mounts"));
        let refined = finer.map(|finer| finer.refine(&problem, args.regret / 100.0)).transpose()?.flatten();
        let looked = looks_again
            .then(|| final_look::look(args, &given, &problem, &search, &stop))
            .transpose()?
            .flatten();
        drop(stage);
        if looks_again && looked.is_none() && stop.load(Ordering::Relaxed) {
            output::say_notice(
                "interrupted: the best mount is given as searched, the look at the best ones not ended",
            );
        }
        (refined, looked)
    };
    let ended = Ended { search: &search, best, stopped_by, wall_s, objective_s, proved, refined, final_look };
    report(args, context, &problem, ended)
}

/// What knows one sensor type only is refused where a rig may have several.
fn refuse_mixed(args: &Args, experiment: &Experiment) -> anyhow::Result<()> {
    if !experiment.is_mixed() {
        return Ok(());
    }
    let models: Vec<_> = experiment.types().map(|preset| preset.model).collect();
    let models = models.join(" and ");
    if args.certify.is_some() {
        refuse!("--certify bounds rigs of one sensor type, and {models} may be mixed: give one --preset");
    }
    if args.export_published.is_some() {
        refuse!(
            "--export-published: the published layout has one sensor type, and {models} may be mixed: give one --preset"
        );
    }
    Ok(())
}

/// What was typed for other methods than the one that searches.
fn refuse_unused(context: Context, kind: Kind) -> anyhow::Result<()> {
    type Uses = fn(Kind) -> bool;
    let flags = [
        ("batch", Kind::has_a_model as Uses),
        ("acquisition", Kind::has_a_model),
        ("early_stop", Kind::has_a_rule),
    ];
    for (argument, uses) in flags {
        if !uses(kind) {
            let users: Vec<_> =
                Kind::ALL.iter().filter(|kind| uses(**kind)).map(|kind| kind.name()).collect();
            let (users, searches) = (users.join(", "), kind.name());
            let why = format!("is about --method {users}: {searches} has no use for it");
            context.ensure_not_typed(&[argument], why)?;
        }
    }
    Ok(())
}

/// What is searched, as asked for.
fn problem(args: &Args, context: Context, objective: Objective) -> anyhow::Result<MountProblem> {
    let mut search = MountSearch::of(objective.simulator().experiment(), args.masters_max);
    if args.masters_min > args.masters_max {
        refuse!("--masters-min {} is above --masters-max {}", args.masters_min, args.masters_max);
    }
    if args.certify.is_some() && args.masters_min > 1 {
        refuse!("--certify bounds rigs of one master: leave out --masters-min {}", args.masters_min);
    }
    if context.is_typed("roll_limits") && search.fixed_roll_deg.is_some() {
        refuse!("--roll-limits is about a free roll, and it is fixed here: add --roll free");
    }
    search.masters_min = args.masters_min;
    search.bounds.pitch_deg = (args.pitch_limits.0, args.pitch_limits.1);
    search.bounds.roll_deg = (args.roll_limits.0, args.roll_limits.1);
    if let Some(Corners([x0, x1, y0, y1, z0, z1])) = args.space {
        (search.bounds.x_m, search.bounds.y_m, search.bounds.z_m) = ((x0, x1), (y0, y1), (z0, z1));
    }
    if let Some(step_deg) = args.tilt_step {
        let roll = ("--roll-limits", args.roll_limits);
        let roll = search.fixed_roll_deg.is_none().then_some(roll);
        for (name, Range(low, high)) in [("--pitch-limits", args.pitch_limits)].into_iter().chain(roll) {
            let (first, last) = ((low / step_deg).ceil(), (high / step_deg).floor());
            if first > last {
                refuse!("{name}: no multiple of {step_deg} degrees lies between {low} and {high}");
            }
            if first == last && low < high {
                let only_deg = first * step_deg + 0.0;
                refuse!(
                    "--tilt-step {step_deg} leaves no angle but {only_deg} between {low} and {high} degrees: give a smaller one, \
                     or {name}={only_deg},{only_deg} where that is meant"
                );
            }
        }
        search.tilt_step_deg = Some(step_deg);
    }
    let Some(criterion) = args.robust else {
        return Ok(MountProblem::with_search(objective, search, args.clearance.0));
    };
    let (position_m, angle_deg) = args.mount_errors();
    let tolerance = Tolerance { position_m, angle_deg, free_phase: args.free_spin };
    let robustness =
        Robustness::new(&objective, tolerance, args.draws as usize, ROBUST_SEED).map_err(wrong_usage)?;
    Ok(MountProblem::with_search(objective, search, args.clearance.0).robust(robustness, criterion))
}

fn begun(args: &Args, problem: &MountProblem) -> anyhow::Result<Search> {
    let kind = args.method.unwrap_or(Kind::Staged);
    let budget = args.evals.map_or(kind.published_budget(), |evals| evals as usize);
    let settings = Settings {
        early_stop: args.early_stop || args.evals.is_none(),
        batch: args.batch,
        acquisition: args.acquisition,
        ..Settings::new(args.seed.unwrap_or(1), budget)
    };
    Ok(Search::new(problem.space()?, kind, settings))
}

fn continued(args: &Args, context: Context, search: Search) -> anyhow::Result<Search> {
    let Settings { seed, batch, acquisition, early_stop, .. } = search.settings();
    for (argument, is_other) in [
        ("batch", args.batch != batch),
        ("acquisition", args.acquisition != acquisition),
        ("early_stop", args.early_stop != early_stop),
    ] {
        if is_other && context.is_typed(argument) {
            let flag = long_name(argument);
            refuse!(
                "the state file holds a search with another --{flag}, which it keeps: leave it out, or start a new file"
            );
        }
    }
    if args.method.is_some_and(|kind| kind != search.kind()) || args.seed.is_some_and(|given| given != seed) {
        refuse!(
            "the state file holds a search by {} with seed {seed}: leave out --method and --seed, or start a new file",
            search.kind().name()
        );
    }
    Ok(search)
}

fn report(
    args: &Args,
    context: Context,
    problem: &MountProblem,
    ended: Ended<'_>,
) -> anyhow::Result<Outcome> {
    let Ended { search, best, stopped_by, wall_s, objective_s, proved, refined, final_look } = ended;
    if best.violation > 0.0 {
        bail!(
            "none of {} mounts keeps what was asked for; the nearest misses it by {:.4} (m of clearance, share of \
             conditioning): give more evaluations, or a smaller --clearance or --min-conditioning",
            search.evaluations(),
            best.violation
        );
    }
    let looked = refined.as_ref().map(|refined| &refined.values);
    let looked = looked.or_else(|| final_look.as_ref().map(|look| &look.values));
    let chosen = looked.unwrap_or(&best.candidate.values);
    let masters = problem.masters(chosen);
    let evaluation = problem.objective().evaluate(&masters)?;
    let experiment = problem.objective().simulator().experiment();
    let bound = match &proved {
        // more masters are bounded by their price alone
        Some(proved) if args.masters_max > 1 => Some(proved.certificate.bound.max(problem.ceiling(2))),
        Some(proved) => Some(proved.certificate.bound),
        None => search.space().ceiling(),
    };
    let document = Document {
        method: search.kind(),
        seed: search.settings().seed,
        evaluations: search.evaluations(),
        rays: search.rays(),
        wall_s,
        objective_s,
        search_s: (wall_s - objective_s).max(0.0),
        stopped_by,
        robust: problem.spread(&masters)?,
        bound,
        fidelity: refined,
        final_look,
        certificate: proved,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        best: Best {
            evaluation,
            masters: masters.iter().map(|master| (*master).into()).collect(),
            master_models: masters.iter().map(|master| experiment.model_of(master)).collect(),
        },
        best_at: search.best_at(),
        preset: experiment.name(),
        prices: problem.objective().prices().to_vec(),
        path: experiment.path,
        clearance: args.clearance.0,
        masters_max: args.masters_max,
        history: search.history().collect(),
    };
    let file = outputs::mount_file(problem, &masters, document.best.evaluation.objective);
    let write = || -> anyhow::Result<()> {
        if let Some(path) = &args.csv {
            outputs::write_csv(path, &file, &document)?;
        }
        if let Some(path) = &args.report {
            outputs::write_report(path, problem, &file, &masters, &document)?;
        }
        if let Some(path) = &args.out {
            file.write(path)?;
        }
        if let Some(path) = &args.export_published {
            published::write(path, problem, &file, &document)?;
        }
        Ok(())
    };
    let written = write();
    // a disk that is full by now takes the files, not what was found
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary::text(&document))?;
    }
    written?;
    if !document.best.evaluation.feasible {
        output::say_notice(
            "the housings of the best mount would collide, so it cannot be built; --clearance housing searches among \
             those that can",
        );
    }
    Ok(Outcome::Done)
}
