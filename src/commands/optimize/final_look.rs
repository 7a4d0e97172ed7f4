//! After the search: what is proved of its best mount, and its best mounts judged again.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::args::Args;
use crate::commands::output;
use crate::commands::stage::Stage;
use crate::design::objective::Objective;
use crate::design::optimize::{JudgedShortlist, MountProblem, Refinement, Refiner, Search, Trial, certify};
use crate::report::search::Proved;

pub(super) fn proved(
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
pub(super) fn judged(
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
        .then(|| JudgedShortlist::of_search(given, problem, search, args.tolerance(), stop))
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
