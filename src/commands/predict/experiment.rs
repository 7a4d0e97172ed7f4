//! `predict --preset`: the score of mounts in a published experiment.

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;

use super::Args;
use crate::commands::experiment_args::FidelityArg;
use crate::commands::{Context, Outcome, output, wrong_usage};
use crate::design::fidelity::MountFidelity;
use crate::design::objective::baselines::{baselines, rescore};
use crate::design::objective::{Objective, other_score};
use crate::report::score::{Document, report};
use crate::rig::{Masters, MountFile};
use crate::rig::{MountDeg, Roll};

/// How a published experiment is scored.
#[derive(clap::Args, Debug)]
pub struct ScoringArgs {
    /// Score again so many times with every ray off its direction by the published divergence.
    #[arg(long, value_name = "RUNS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1000))]
    rescore: u32,
    /// Divergence of the re-score: standard deviation of each component of a ray's direction.
    #[arg(long, value_name = "DEG", default_value_t = crate::design::objective::PUBLISHED_SPREAD_DEG, value_parser = crate::commands::ranges::within(0.0, 90.0))]
    divergence: f64,
    /// Error of J that --fidelity auto may leave, percent of J.
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, value_parser = crate::commands::ranges::within(1e-9, 100.0))]
    tolerance: f64,
}

/// Scores and prints.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    check(args, context)?;
    let Request { objective, sensors, stated, reason } = match (&args.mount, &args.masters) {
        (Some(path), _) => from_file(args, path)?,
        (None, Some(masters)) => from_masters(args, masters)?,
        (None, None) => refuse!(
            "which sensors, and where? Give --mount or --masters, and for a scene of your own --scene or --room"
        ),
    };
    output::check_places([&args.report])?;
    let start = Instant::now();
    let seen = objective.simulator().cover(&sensors)?;
    let mut document =
        Document::new(&objective, &sensors, (&seen.coverage, seen.lost_rays), start.elapsed().as_secs_f64());
    let rig = objective.mounted(&sensors);
    if args.baselines {
        document.baselines = Some(baselines(&objective, &rig)?);
    }
    if args.scoring.rescore > 0 {
        document.rescored =
            Some(rescore(&objective, &rig, args.scoring.rescore, args.scoring.divergence, args.seed)?);
    }
    if fidelity_asked(args) == FidelityArg::Auto {
        document.fidelity = Some(MountFidelity::measure(&objective, &rig, args.scoring.tolerance / 100.0)?);
    }
    let report = report(&document, args.report.as_ref().map(|_| &seen.coverage));
    output::print_result(context.json, &document, &report, &[])?;
    output::write_page(args.report.as_deref(), &report)?;
    let found = document.evaluation.objective;
    if let Some(stated) = stated.filter(|stated| (stated - found).abs() > 0.005) {
        output::say_notice(&format!("the mount file says J {stated:.2}, {reason}"));
    }
    Ok(Outcome::Done)
}

/// Refuses what cannot be meant, or has nothing to be about.
fn check(args: &Args, context: Context) -> anyhow::Result<()> {
    if args.scoring.rescore == 0 {
        context.ensure_not_typed(&["divergence", "seed"], "is about --rescore, which is not asked for")?;
    }
    if args.mount.is_some() {
        context.ensure_not_typed(
            &["no_mirror"],
            "is about --masters: a mount file lists every sensor, mirrored ones too",
        )?;
    }
    if fidelity_asked(args) == FidelityArg::Given {
        context.ensure_not_typed(&["tolerance"], "is about --fidelity auto, which is not asked for")?;
    }
    Ok(())
}

fn fidelity_asked(args: &Args) -> FidelityArg {
    args.fidelity.unwrap_or(FidelityArg::for_scene(args.experiment.is_new_scene()))
}

/// What to score.
struct Request {
    objective: Objective,
    sensors: Vec<MountDeg>,
    /// The score that the mount file states.
    stated: Option<f64>,
    /// Why that may be another one than is found here.
    reason: String,
}

fn from_masters(args: &Args, masters: &Masters) -> anyhow::Result<Request> {
    let objective = args.experiment.objective(Roll::Fixed(0.0))?;
    let experiment = objective.simulator().experiment();
    let masters = &masters.of(&experiment.models()).map_err(wrong_usage)?;
    if experiment.replaces_a_roll(masters) {
        output::say_notice(
            "the given roll is replaced by the experiment's fixed roll; --roll free takes it as given",
        );
    }
    let sensors = objective.sensors(masters);
    Ok(Request { objective, sensors, stated: None, reason: String::new() })
}

fn from_file(args: &Args, path: &Path) -> anyhow::Result<Request> {
    let file = MountFile::read(path)?;
    let objective = args.experiment.objective_for(&file, path)?;
    let experiment = objective.simulator().experiment();
    if file.calibrations.is_some() {
        output::say_notice(
            "the published experiment has beams of its own: calibrations of the mount file are not used",
        );
    }
    if let Some(turned) = file.sensors.iter().find(|sensor| sensor.yaw_deg != 0.0) {
        output::say_notice(&format!(
            "the published experiment knows no yaw: the {} degrees of {} are not used; predict --scene uses them",
            turned.yaw_deg, turned.name
        ));
    }
    let listed = objective.listed(&file).with_context(|| format!("mount file {}", path.display()))?;
    let is_rolled_otherwise = experiment.replaces_a_roll(&listed);
    if is_rolled_otherwise {
        output::say_notice("the roll in the mount file is replaced, as --roll says");
    }
    let sensors = experiment.without_images().sensors(&listed);
    let reason = other_score(&file, &objective, is_rolled_otherwise);
    Ok(Request { objective, sensors, stated: file.objective, reason })
}
