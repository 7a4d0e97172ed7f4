//! Flags of `study`, and the plan that they ask for.

use std::path::{Path, PathBuf};

use crate::commands::{Context, ensure_consistent, output, wrong_usage};
use crate::recording::read_trajectory;
use crate::study::shard::{Plan, Shard};
use crate::study::submit::Engine;
use crate::study::{STUDIES, Size, Study};

/// Without --shard a study is cut so that an interruption loses little.
pub(super) const SHARDS: usize = 32;

/// Arguments of `study`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "`study NAME` plans, runs and merges; what is done already is not done again. On several machines: `study plan \
                  NAME --out DIR`, then `study run NAME --out DIR --shard i/N` for every i (each writes one file), then `study \
                  merge NAME --out DIR`. `study submit NAME --engine slurm --shards N --out DIR` writes scripts that do this. Where meshes came to \
                  the folder behind --scene or left it, the results of the others stay."
)]
pub struct Args {
    /// plan, run, merge or submit and a study, or a study alone for all three: published, methods, sensor-count, pareto,
    /// joint, speed-accuracy, stability, scenes.
    #[arg(value_name = "ACTION|NAME", num_args = 1..=2, required = true)]
    pub(super) what: Vec<String>,
    /// Seeds of each search.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub(super) seeds: u64,
    /// Few evaluations: shows that it runs, not what it finds.
    #[arg(long)]
    pub(super) quick: bool,
    /// Mesh, for studies in a scene; a folder of meshes for `scenes`.
    #[arg(long, value_name = "FILE")]
    pub(super) scene: Option<PathBuf>,
    /// Walk through the scene (TUM), for speed-accuracy [default: a straight line through it].
    #[arg(long, value_name = "FILE")]
    pub(super) trajectory: Option<PathBuf>,
    /// Count instructions, too, for speed-accuracy: runs each model under valgrind, which takes long.
    #[arg(long)]
    pub(super) count_instructions: bool,
    /// Which part to run, as i/N.
    #[arg(long, value_name = "I/N")]
    pub(super) shard: Option<Shard>,
    /// What will run the shards, for submit.
    #[arg(long, default_value = "local")]
    pub(super) engine: Engine,
    /// Shards that submit makes; 10 to 30 seconds each are worth a place in a queue.
    #[arg(long, value_name = "N", default_value_t = SHARDS as u64, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub(super) shards: u64,
    /// Folder of plan, shards and results [default: study-NAME].
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
    Plan,
    Run,
    Merge,
    Submit,
    All,
}

impl Args {
    /// What to do, and with which study.
    pub(super) fn action(&self) -> anyhow::Result<(Action, &str)> {
        match self.what.as_slice() {
            [name] => Ok((Action::All, name)),
            [action, name] => match action.as_str() {
                "plan" => Ok((Action::Plan, name)),
                "run" => Ok((Action::Run, name)),
                "merge" => Ok((Action::Merge, name)),
                "submit" => Ok((Action::Submit, name)),
                other => refuse!("{other:?}: give plan, run, merge or submit, and then a study"),
            },
            _ => refuse!("give a study: {}", STUDIES.iter().map(|s| s.name()).collect::<Vec<_>>().join(", ")),
        }
    }
}

/// What was typed and is of no use to this action: what a study is asked for stands in its plan.
pub(super) fn refuse_unused(action: Action, context: Context) -> anyhow::Result<()> {
    if matches!(action, Action::Run | Action::Merge) {
        context.ensure_not_typed(
            &["seeds", "quick", "scene", "trajectory", "count_instructions"],
            "stands in the plan: give it to `study plan`",
        )?;
    }
    if action != Action::Run {
        context.ensure_not_typed(&["shard"], "is about `study run`")?;
    }
    if action != Action::Submit {
        context.ensure_not_typed(&["engine", "shards"], "is about `study submit`")?;
    }
    Ok(())
}

pub(super) fn make_plan(args: &Args, study: &dyn Study, folder: &Path) -> anyhow::Result<Plan> {
    let size = Size {
        seeds: args.seeds,
        quick: args.quick,
        scene: args.scene.clone(),
        trajectory: args.trajectory.clone(),
        count_instructions: args.count_instructions,
    };
    let name = study.name();
    let is_of_speed = size.trajectory.is_some() || size.count_instructions;
    ensure_consistent([
        (
            size.scene.is_some() && !study.takes_a_scene(),
            format!("--scene is for studies in a scene: {name} has scenes of its own"),
        ),
        (
            is_of_speed && name != "speed-accuracy",
            format!(
                "--trajectory and --count-instructions are for speed-accuracy: {name} does not know them"
            ),
        ),
    ])?;
    if let Some(path) = &size.trajectory {
        read_trajectory(path, None)?.1.iter().for_each(|note| output::say_notice(note));
    }
    let is_without_scene = size.scene.is_none();
    let plan = Plan::new(study, size).map_err(|error| match is_without_scene {
        // nothing was read: what is missing is missing from the command line
        true => wrong_usage(error),
        false => error.into(),
    })?;
    if let Some(done) = plan.write(folder)? {
        output::say_notice(&format!(
            "{} held other tasks: {done} of the {} of now are done already",
            folder.display(),
            plan.tasks.len()
        ));
    }
    Ok(plan)
}
