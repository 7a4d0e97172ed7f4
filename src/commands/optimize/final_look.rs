//! Whether the best mounts of a search are judged again as they would be built, and what is said of it.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde::Serialize;

use super::Args;
use super::args::Switch;
use crate::design::objective::Objective;
use crate::design::optimize::{FinalLook, Kind, MountProblem, Search};
use crate::design::robustness::Tolerance;
use crate::report::chart;

/// What came of it.
#[derive(Serialize)]
pub(super) struct Looked {
    /// Where the chosen mount was found, in units of the search.
    #[serde(skip)]
    pub values: Vec<f64>,
    #[serde(flatten)]
    look: FinalLook,
    /// J of the search's own favourite as searched.
    favourite_as_searched: f64,
    /// Seconds that it took.
    wall_s: f64,
}

/// Whether a final look is asked for. `is_refined`: whether the search's best are looked at ever more finely anyway.
pub(super) fn is_wanted(args: &Args, kind: Kind, is_refined: bool) -> anyhow::Result<bool> {
    match args.final_look {
        Some(Switch::On) if is_refined => {
            refuse!("--fidelity auto looks again in a way of its own: leave out --final-look")
        }
        Some(switch) => Ok(switch == Switch::On),
        None => Ok(kind == Kind::Staged && !is_refined && args.robust.is_none() && args.certify.is_none()),
    }
}

/// Judges the shortlist of a search again; nothing where no mount was feasible, or `stop` came.
pub(super) fn look(
    args: &Args,
    given: &Objective,
    problem: &MountProblem,
    search: &Search,
    stop: &AtomicBool,
) -> anyhow::Result<Option<Looked>> {
    let start = Instant::now();
    let feasible: Vec<_> = search.shortlist().iter().filter(|trial| trial.violation == 0.0).collect();
    let mounts: Vec<_> = feasible.iter().map(|trial| problem.masters(&trial.candidate.values)).collect();
    let (position_m, angle_deg) = args.mount_errors();
    let tolerance = Tolerance { position_m, angle_deg, free_phase: true };
    Ok(FinalLook::at(given, &mounts, tolerance, stop)?.map(|look| Looked {
        values: feasible[look.best].candidate.values.clone(),
        look,
        favourite_as_searched: feasible[0].score,
        wall_s: start.elapsed().as_secs_f64(),
    }))
}

impl Looked {
    pub fn verdicts(&self) -> [(&'static str, String); 2] {
        let FinalLook { model, tolerance, looked_at, chosen, favourite, rays, .. } = &self.look;
        let as_built = format!(
            "J {} on average with errors of {} m and {} degrees ({model}, phases free)",
            chart::number(chosen.mean, 0),
            tolerance.position_m,
            tolerance.angle_deg
        );
        let others = format!(
            "the search's own favourite, {} as searched, comes to {}; {looked_at} mounts looked at again, {} rays in {:.3} s",
            chart::number(self.favourite_as_searched, 0),
            chart::number(favourite.mean, 0),
            chart::number(*rays as f64, 0),
            self.wall_s
        );
        [("as built", as_built), ("", others)]
    }
}
