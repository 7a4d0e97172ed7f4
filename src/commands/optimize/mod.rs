//! `outrigger optimize`

mod args;
mod scene;
mod scene_document;
mod scene_flags;
mod scene_rigs;
mod scene_runs;
mod scene_state;
mod site;
mod spec;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context as _, bail};
use serde_json::Value;

pub use args::Args;

use super::stage::Stage;
use super::{Context, Outcome, output, signals, wrong_usage};
use crate::base::files;
use crate::design::objective::Objective;
use crate::design::optimize::state_file::{self, StateError};
use crate::design::optimize::{
    JudgedShortlist, MountProblem, Refinement, Refiner, RunEnd, Search, SearchRun, Trial, certify,
};
use crate::report::search::{Best, Document, Proved, page};
use crate::rig::MountFile;
use crate::simulate::published::{Placement, Roll};

/// What is known of the best mount when the search has ended.
struct Ended<'a> {
    search: &'a Search,
    best: &'a Trial,
    run: RunEnd,
    proved: Option<Proved>,
    refined: Option<Refinement>,
    judged: Option<JudgedShortlist>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if scene::is_asked(args, context)? {
        return scene::run(args, context);
    }
    output::check_places([&args.out, &args.export_published, &args.csv, &args.report, &args.resume])?;
    let given = args.experiment.objective(Roll::Fixed(0.0))?;
    spec::refuse_mixed(args, given.simulator().experiment())?;
    let refiner = spec::refiner(args, &given)?;
    let objective = refiner.as_ref().map_or(&given, Refiner::objective).clone();
    let problem = spec::problem(args, context, objective)?;
    let question = state_file::question(&problem, args.keep_apart())?;
    let mut search = match args.resume.as_deref().map(|path| resumed(path, &question)).transpose()?.flatten()
    {
        Some(search) => spec::continued(args, context, search)?,
        None => spec::begun(args, &problem)?,
    };
    let is_judged = spec::is_final_look_wanted(args, search.kind(), refiner.is_some())?;
    spec::refuse_unused(args, context, search.kind(), [is_judged, refiner.is_some()])?;
    let budget = args.evals.map_or(search.settings().budget, |evals| evals as usize);
    let stop = signals::stop_flag()?;
    let bar = Stage::begin("searching");
    bar.counts(budget as u64, search.evaluations() as u64);
    let run = SearchRun {
        problem: &problem,
        refiner: refiner.as_ref(),
        budget,
        max_rays: args.max_rays,
        state: args.resume.as_deref().map(|path| (path, &question)),
        stop: &stop,
    };
    let run = run.run(&mut search, |search| {
        bar.at(search.evaluations() as u64);
        if let Some(best) = search.best() {
            bar.say(format!("evaluation {} of {budget}, J {:.1}", search.evaluations(), best.score));
        }
    })?;
    drop(bar);
    let Some(best) = search.best() else { bail!("stopped before the first evaluation: no mount was scored") };
    let proved = proved(args, &problem, best, &stop)?;
    let (refined, judged) = judged(args, &given, &problem, &search, (refiner, is_judged), &stop)?;
    report(args, context, &problem, Ended { search: &search, best, run, proved, refined, judged })
}

fn resumed(path: &Path, question: &Value) -> anyhow::Result<Option<Search>> {
    state_file::read(path, question).map_err(|error| match error {
        StateError::OtherSearch { .. } => wrong_usage(error),
        error => error.into(),
    })
}

fn proved(
    args: &Args,
    problem: &MountProblem,
    best: &Trial,
    stop: &AtomicBool,
) -> anyhow::Result<Option<Proved>> {
    let Some(regions) = args.certify else { return Ok(None) };
    let start = Instant::now();
    let stage = Stage::begin("bounding what any mount could score");
    let certificate = certify(problem, best.score, regions, stop)?;
    drop(stage);
    if stop.load(Ordering::Relaxed) {
        output::say_notice("interrupted: what is proved is what was bounded until then, if anything");
    }
    Ok(certificate.map(|certificate| Proved { certificate, wall_s: start.elapsed().as_secs_f64() }))
}

/// The best mounts of the search once more, under finer models or as they would be built.
fn judged(
    args: &Args,
    given: &Objective,
    problem: &MountProblem,
    search: &Search,
    (refiner, is_judged): (Option<Refiner>, bool),
    stop: &AtomicBool,
) -> anyhow::Result<(Option<Refinement>, Option<JudgedShortlist>)> {
    if !is_judged && refiner.is_none() {
        return Ok((None, None));
    }
    if stop.load(Ordering::Relaxed) {
        // who stops a search wants its best now: this may take longer than the search
        output::say_notice(
            "interrupted: the best mount is given as searched, without another look at the best ones",
        );
        return Ok((None, None));
    }
    let stage = Stage::begin("looking again at the best mounts");
    let refined = refiner.map(|refiner| refiner.refine(problem, args.regret / 100.0)).transpose()?.flatten();
    let judged = is_judged
        .then(|| JudgedShortlist::of_search(given, problem, search, args.mount_errors(), stop))
        .transpose()?
        .flatten();
    drop(stage);
    if is_judged && judged.is_none() && stop.load(Ordering::Relaxed) {
        output::say_notice(
            "interrupted: the best mount is given as searched, the look at the best ones not ended",
        );
    }
    Ok((refined, judged))
}

fn report(
    args: &Args,
    context: Context,
    problem: &MountProblem,
    ended: Ended<'_>,
) -> anyhow::Result<Outcome> {
    let Ended { search, best, .. } = ended;
    if best.violation > 0.0 {
        bail!(
            "none of {} mounts keeps what was asked for; the nearest misses it by {:.4} (m of clearance, share of \
             conditioning): give more evaluations, or a smaller --clearance or --min-conditioning",
            search.evaluations(),
            best.violation
        );
    }
    let refined = ended.refined.as_ref().map(|refined| &refined.values);
    let chosen = refined.or_else(|| ended.judged.as_ref().map(|judged| &judged.values));
    let masters = problem.masters(chosen.unwrap_or(&best.candidate.values));
    let document = document(args, problem, &masters, ended)?;
    let file = problem.mount_file(&masters, document.best.evaluation.objective);
    let written = write(args, problem, &file, &masters, &document);
    // a disk that is full by now takes the files, not what was found
    output::print_result(context.json, &document, || document.summary(), &[])?;
    written?;
    if !document.best.evaluation.feasible {
        output::say_notice(
            "the housings of the best mount would collide, so it cannot be built; --clearance housing searches among \
             those that can",
        );
    }
    Ok(Outcome::Done)
}

fn document(
    args: &Args,
    problem: &MountProblem,
    masters: &[Placement],
    ended: Ended<'_>,
) -> anyhow::Result<Document> {
    let Ended { search, run, proved, refined, judged, .. } = ended;
    let experiment = problem.objective().simulator().experiment();
    let bound = match &proved {
        // more masters are bounded by their price alone
        Some(proved) if args.masters_max > 1 => Some(proved.certificate.bound.max(problem.ceiling(2))),
        Some(proved) => Some(proved.certificate.bound),
        None => search.space().ceiling(),
    };
    Ok(Document {
        method: search.kind(),
        seed: search.settings().seed,
        evaluations: search.evaluations(),
        rays: search.rays(),
        wall_s: run.wall_s,
        objective_s: run.objective_s,
        search_s: (run.wall_s - run.objective_s).max(0.0),
        stopped_by: run.stopped_by,
        robust: problem.spread(masters)?,
        bound,
        fidelity: refined,
        final_look: judged,
        certificate: proved,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        best: Best {
            evaluation: problem.objective().evaluate(masters)?,
            masters: masters.iter().map(|master| (*master).into()).collect(),
            master_models: masters.iter().map(|master| experiment.model_of(master)).collect(),
        },
        best_at: search.best_at(),
        preset: experiment.name(),
        prices: problem.objective().prices().to_vec(),
        path: experiment.path,
        clearance: args.keep_apart(),
        masters_max: args.masters_max,
        history: search.history().collect(),
    })
}

fn write(
    args: &Args,
    problem: &MountProblem,
    file: &MountFile,
    masters: &[Placement],
    document: &Document,
) -> anyhow::Result<()> {
    if let Some(path) = &args.csv {
        let csv = document.csv(file);
        files::write_whole(path, csv.as_bytes()).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.report {
        let simulator = problem.objective().simulator();
        let seen = simulator.see(&simulator.experiment().sensors(masters))?;
        let rig = file.rig()?;
        let page = page(document, file, &seen.coverage, (&simulator.experiment().preset, &rig));
        page.write(path).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.out {
        file.write(path)?;
    }
    if let Some(path) = &args.export_published {
        let export = problem.published_export(file, &document.best.evaluation, document.method);
        let model = problem.objective().simulator().experiment().preset.model;
        let export = export.with_context(|| format!("the published export knows no sensor {model}"))?;
        files::write_json(path, &export).with_context(|| path.display().to_string())?;
    }
    Ok(())
}
