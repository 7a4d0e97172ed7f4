//! What a search in a published experiment prints and writes.

use anyhow::Context as _;

use super::args::Args;
use crate::base::files;
use crate::commands::output;
use crate::design::optimize::{JudgedShortlist, MountProblem, Refinement, RunEnd, Search, Trial};
use crate::report::Report;
use crate::report::search::{Best, Document, Proved};
use crate::rig::{MountDeg, MountFile};

/// What is known of the best mount when the search has ended.
pub(super) struct Ended<'a> {
    pub(super) search: &'a Search,
    pub(super) best: &'a Trial,
    pub(super) run: RunEnd,
    pub(super) proved: Option<Proved>,
    pub(super) refined: Option<Refinement>,
    pub(super) judged: Option<JudgedShortlist>,
}

pub(super) fn document(
    args: &Args,
    problem: &MountProblem,
    masters: &[MountDeg],
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

pub(super) fn write(
    args: &Args,
    problem: &MountProblem,
    file: &MountFile,
    (document, report): (&Document, &Report),
) -> anyhow::Result<()> {
    if let Some(path) = &args.csv {
        let csv = document.csv(file);
        files::write_whole(path, csv.as_bytes()).with_context(|| path.display().to_string())?;
    }
    output::write_page(args.report.as_deref(), report)?;
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
