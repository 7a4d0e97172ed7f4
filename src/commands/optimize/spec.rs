//! From what was typed to what is searched.

use super::args::Args;
use super::values::{Corners, Range, Switch};
use crate::commands::defaults::long_name;
use crate::commands::experiment_args::FidelityArg;
use crate::commands::{Context, ensure_consistent, wrong_usage};
use crate::design::objective::Objective;
use crate::design::optimize::{Kind, MountProblem, MountSearch, Refiner, Search, Settings};
use crate::design::robustness::{Robustness, SEARCH_SEED};

/// The refiner that --fidelity auto asks for; none where the sampling is as given.
pub(crate) fn refiner(args: &Args, given: &Objective) -> anyhow::Result<Option<Refiner>> {
    let has_own_sampling = args.robust.is_some() || args.certify.is_some();
    let otherwise = FidelityArg::for_scene(args.experiment.is_new_scene() && !has_own_sampling);
    if args.fidelity.unwrap_or(otherwise) == FidelityArg::Given {
        return Ok(None);
    }
    let words = |what: &str| format!("{what}: leave out --fidelity auto");
    ensure_consistent([
        (args.robust.is_some(), words("--robust judges by draws of its own")),
        (args.certify.is_some(), words("--certify proves something about one sampling")),
    ])?;
    Ok(Some(Refiner::new(given)?))
}

/// Whether a final look is asked for. `is_refined`: whether the search's best are looked at ever more finely anyway.
pub(crate) fn is_final_look_wanted(args: &Args, kind: Kind, is_refined: bool) -> anyhow::Result<bool> {
    let is_twice = is_refined && args.final_look == Some(Switch::On);
    let words = "--fidelity auto has a final look of its own: leave out --final-look";
    ensure_consistent([(is_twice, words.into())])?;
    match args.final_look {
        Some(switch) => Ok(switch == Switch::On),
        None => Ok(kind == Kind::Staged && !is_refined && args.robust.is_none() && args.certify.is_none()),
    }
}

/// What is searched, as asked for.
pub(crate) fn problem(args: &Args, context: Context, objective: Objective) -> anyhow::Result<MountProblem> {
    let mut search = MountSearch::of(&objective, args.masters_max);
    let (least, most) = (args.masters_min, args.masters_max);
    ensure_consistent([
        (least > most, format!("--masters-min {least} is above --masters-max {most}")),
        (
            args.certify.is_some() && least > 1,
            format!("--certify bounds rigs of one master: leave out --masters-min {least}"),
        ),
    ])?;
    if search.fixed_roll_deg.is_some() {
        let why = "is about a free roll, and it is fixed here: add --roll free";
        context.ensure_not_typed(&["roll_limits"], why)?;
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
            let only_deg = first * step_deg + 0.0;
            let none = format!("{name}: no multiple of {step_deg} degrees lies between {low} and {high}");
            let only = format!(
                "--tilt-step {step_deg} leaves no angle but {only_deg} between {low} and {high} degrees: give a smaller one, \
                 or {name}={only_deg},{only_deg} where that is meant"
            );
            ensure_consistent([(first > last, none), (first == last && low < high, only)])?;
        }
        search.tilt_step_deg = Some(step_deg);
    }
    let Some(criterion) = args.robust else {
        return Ok(MountProblem::with_search(objective, search, args.keep_apart()));
    };
    let robustness = Robustness::new(&objective, args.tolerance(), args.draws as usize, SEARCH_SEED)
        .map_err(wrong_usage)?;
    Ok(MountProblem::with_search(objective, search, args.keep_apart()).robust(robustness, criterion))
}

pub(crate) fn begun(args: &Args, problem: &MountProblem) -> anyhow::Result<Search> {
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

pub(crate) fn continued(args: &Args, context: Context, search: Search) -> anyhow::Result<Search> {
    let Settings { seed, batch, acquisition, early_stop, .. } = search.settings();
    for (argument, is_other) in [
        ("batch", args.batch != batch),
        ("acquisition", args.acquisition != acquisition),
        ("early_stop", args.early_stop != early_stop),
    ] {
        let words = format!(
            "the state file holds a search with another --{}, which it keeps: leave it out, or start a new file",
            long_name(argument)
        );
        ensure_consistent([(is_other && context.is_typed(argument), words)])?;
    }
    let is_other =
        args.method.is_some_and(|kind| kind != search.kind()) || args.seed.is_some_and(|given| given != seed);
    let words = format!(
        "the state file holds a search by {} with seed {seed}: leave out --method and --seed, or start a new file",
        search.kind().name()
    );
    ensure_consistent([(is_other, words)])?;
    Ok(search)
}
