//! `outrigger optimize`

mod args;
mod final_look;
mod published_document;
mod scene;
mod scene_document;
mod scene_flags;
mod scene_rigs;
mod scene_runs;
mod site;
mod spec;
mod unused;
mod values;

use std::path::Path;

use anyhow::bail;
use serde_json::Value;

pub use args::Args;

use super::stage::Stage;
use super::{Context, Outcome, output, signals, wrong_usage};
use crate::design::optimize::state_file::{self, StateError};
use crate::design::optimize::{MountProblem, Refiner, Search, SearchRun};
use crate::report::Report;
use crate::report::search::{self, Document, Pictures};
use crate::rig::{MountDeg, MountFile, Roll};
use final_look::{judged, proved};
use published_document::{Ended, document, write};

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if scene::is_asked(args, context)? {
        return scene::run(args, context);
    }
    output::check_places([&args.out, &args.export_published, &args.csv, &args.report, &args.resume])?;
    let given = args.experiment.objective(Roll::Fixed(0.0))?;
    unused::refuse_mixed(args, &given.simulator().experiment().models())?;
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
    unused::refuse_unused(args, context, search.kind(), [is_judged, refiner.is_some()])?;
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
    conclude(args, context, &problem, Ended { search: &search, best, run, proved, refined, judged })
}

fn resumed(path: &Path, question: &Value) -> anyhow::Result<Option<Search>> {
    state_file::read(path, question).map_err(|error| match error {
        StateError::OtherSearch { .. } => wrong_usage(error),
        error => error.into(),
    })
}

/// The report, with pictures where a page is asked for.
fn pictured(
    args: &Args,
    problem: &MountProblem,
    masters: &[MountDeg],
    (document, file): (&Document, &MountFile),
) -> anyhow::Result<Report> {
    if args.report.is_none() {
        return Ok(search::report(document, file, None));
    }
    let objective = problem.objective();
    let coverage = &objective.simulator().cover(&objective.sensors(masters))?.coverage;
    let rig = &file.rig()?;
    Ok(search::report(document, file, Some(&Pictures { objective, rig, coverage })))
}

fn conclude(
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
    let report = pictured(args, problem, &masters, (&document, &file))?;
    let written = write(args, problem, &file, (&document, &report));
    // a disk that is full by now takes the files, not what was found
    output::print_result(context.json, &document, &report, &[])?;
    written?;
    if !document.best.evaluation.feasible {
        output::say_notice(
            "the housings of the best mount would collide, so it cannot be built; --clearance housing searches among \
             those that can",
        );
    }
    Ok(Outcome::Done)
}
