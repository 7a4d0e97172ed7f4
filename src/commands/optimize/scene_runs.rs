//! The searches of `optimize --scene`: one, or one for each number of sensors.

use std::sync::atomic::AtomicBool;

use anyhow::bail;

use super::args::Args;
use super::scene_flags::Counts;
use crate::commands::stage::Stage;
use crate::commands::{Context, output, wrong_usage};
use crate::design::robustness::Criterion;
use crate::design::scene_search::{
    Asked, BuildErrors, Exact, Findings, Judges, Plan, Question, RigSpace, SceneSearch, SceneWeights,
    SearchEnd, SearchState, no_fewer_than_seen, share_of,
};
use crate::report::scene_search::CountDocument;
use crate::simulate::view::CellSites;

/// What all searches of a command share.
pub(super) struct Run<'a, 's> {
    pub(super) args: &'s Args,
    pub(super) asked: &'s Asked<'s>,
    pub(super) judges: &'a Judges,
    pub(super) weights: SceneWeights,
    pub(super) evaluations: usize,
    pub(super) seed: u64,
    pub(super) errors: BuildErrors,
    pub(super) stage: &'s Stage,
    pub(super) stop: &'s AtomicBool,
}

/// The best mount of a number of sensors.
pub(super) struct OfCount {
    sensors: usize,
    best: Exact,
}

/// What the document says of each number of sensors; `observable` are the voxels that can be seen, by site.
pub(super) fn compared(found: &[OfCount], observable: &[u64]) -> Vec<CountDocument> {
    let observable = no_fewer_than_seen(observable.to_vec(), found.iter().map(|of| &of.best.seen));
    let document = |OfCount { sensors, best }: &OfCount| CountDocument {
        sensors: *sensors,
        unique_voxels: best.seen.union as u64,
        observable_share: share_of(&best.seen, &observable),
        objective: best.objective(),
    };
    found.iter().map(document).collect()
}

/// What the document and the state file say of the command.
pub(super) fn asked(args: &Args, scan_stride: u32) -> anyhow::Result<Asked<'_>> {
    Ok(Asked {
        sensors: &args.scene.sensors,
        weights: args.scene.weights,
        is_ideal: args.scene.ideal,
        columns: args.experiment.of_scene().columns,
        scan_stride,
        quality: args.scene.quality.quality(),
        criterion: args.robust.unwrap_or(Criterion::Expected),
        registration: args.experiment.registration()?,
    })
}

/// The errors of building that are reckoned with. Of several sites --robust is about the sites, unless errors are given.
pub(super) fn errors(args: &Args, context: Context) -> anyhow::Result<BuildErrors> {
    let is_given = args.tolerance.is_some() || args.free_spin || context.is_typed("draws");
    let criterion = args.robust.filter(|_| is_given || args.scene.site.len() < 2);
    BuildErrors::new(args.tolerance(), args.draws as usize, criterion).map_err(wrong_usage)
}

impl<'a> Run<'a, '_> {
    /// Searches with each number of sensors that is asked for; the rigs of the best number by J, and what was found there.
    pub(super) fn by_count(
        &self,
        rigs: RigSpace,
        model: &mut CellSites,
    ) -> anyhow::Result<(RigSpace, Option<Findings>, Vec<OfCount>)> {
        let Some(Counts(first, last)) = self.args.scene.count else { return Ok((rigs, None, Vec::new())) };
        let mut best: Option<(f64, RigSpace, Findings)> = None;
        let mut found = Vec::new();
        for sensors in first..=last {
            let rigs = rigs.with_sensors(sensors, self.args.experiment.of_scene().is_mirrored);
            let (search, mut end) = self.search(&rigs, model, None)?;
            let findings = search.findings().clone();
            end.exact.retain(|exact| exact.violation == 0.0);
            let Some(winner) = end.exact.into_iter().next() else {
                output::say_notice(&format!(
                    "no mount of {sensors} sensors keeps what is asked: give a larger --space, or a smaller --min-conditioning"
                ));
                continue;
            };
            if best.as_ref().is_none_or(|(score, ..)| winner.score() > *score) {
                best = Some((winner.score(), rigs.clone(), findings));
            }
            found.push(OfCount { sensors, best: winner });
        }
        match best {
            Some((_, rigs, findings)) => Ok((rigs, Some(findings), found)),
            None => bail!(
                "none of {first} to {last} sensors fits: give a larger --space, or a smaller --clearance"
            ),
        }
    }

    /// One search; `known` is what it found before.
    pub(super) fn search<'b>(
        &self,
        rigs: &'b RigSpace,
        model: &'b mut CellSites,
        known: Option<Findings>,
    ) -> anyhow::Result<(SceneSearch<'b>, SearchEnd)>
    where
        'a: 'b,
    {
        let rays = self.judges.cast.rays(&rigs.any());
        let plan = Plan::new(self.evaluations, self.seed, rays, self.judges.thinning, self.errors);
        let mut state = None;
        let known = match (known, &self.args.resume) {
            (Some(known), _) => known,
            (None, Some(path)) => {
                let question = Question::of(self.asked, &plan, rigs, self.judges.cast.views());
                let (opened, known) = SearchState::open(path, question)?;
                state = Some(opened);
                known
            }
            (None, None) => Findings::default(),
        };
        let mut search = SceneSearch::new(rigs, model, self.judges, self.weights.clone(), plan, known)?;
        self.stage.counts((plan.evaluations + plan.around) as u64, 0);
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
            Some(error) => Err(error.into()),
            None => Ok((search, end)),
        }
    }
}
