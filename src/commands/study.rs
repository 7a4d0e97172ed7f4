//! `outrigger study`

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use serde::Serialize;

use super::stage::Stage;
use super::{Context, Outcome, output, signals, wrong_usage};
use crate::base::files;
use crate::study::shard::{Plan, Ran, Shard};
use crate::study::submit::{self, Engine};
use crate::study::{Findings, STUDIES, Size, named};

/// Arguments of `study`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "`study NAME` plans, runs and merges; what is done already is not done again. On several machines: `study plan \
                  NAME --out DIR`, then `study run NAME --out DIR --shard i/N` for every i (each writes one file), then `study \
                  merge NAME --out DIR`. `study submit NAME --engine slurm --shards N --out DIR` writes scripts that do this. Where meshes came to \
                  the folder behind --scene or left it, what was done of the others is kept."
)]
pub struct Args {
    /// plan, run, merge or submit and a study, or a study alone for all three: published, methods, sensor-count, pareto,
    /// joint, speed-accuracy, stability, scenes.
    #[arg(value_name = "ACTION|NAME", num_args = 1..=2, required = true)]
    what: Vec<String>,
    /// Seeds of each search.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// Few evaluations: shows that it runs, not what it finds.
    #[arg(long)]
    quick: bool,
    /// Mesh, for studies in a scene; a folder of meshes for `scenes`.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Walk through the scene (TUM), for speed-accuracy [default: a straight line through it].
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Count instructions, too, for speed-accuracy: runs each model under valgrind, which takes long.
    #[arg(long)]
    count_instructions: bool,
    /// Which part to run, as i/N.
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// What will run the shards, for submit.
    #[arg(long, default_value = "local")]
    engine: Engine,
    /// Shards that submit makes; 10 to 30 seconds each are worth a place in a queue.
    #[arg(long, value_name = "N", default_value_t = SHARDS as u64, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    shards: u64,
    /// Folder of plan, shards and results [default: study-NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Action {
    Plan,
    Run,
    Merge,
    Submit,
    All,
}

/// Without --shard a study is cut so that an interruption loses little.
const SHARDS: usize = 32;
const INTERRUPTED: &str = "interrupted: whole shards are kept, the same command goes on from there";
/// Time after Ctrl-C in which a shard may still be written. A task may take minutes; of a shard that is not whole nothing is
/// kept, so that nothing is gained by waiting for its tasks.
const TO_END_WITHIN: Duration = Duration::from_secs(1);

/// The document that `study` prints.
#[derive(Serialize)]
struct Document<'a> {
    study: &'a str,
    folder: String,
    tasks: usize,
    /// The command that starts what submit wrote.
    #[serde(skip_serializing_if = "Option::is_none")]
    start: Option<String>,
    /// The part that was run.
    #[serde(skip_serializing_if = "Option::is_none")]
    shard: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    findings: Option<&'a Findings>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let (action, name) = match args.what.as_slice() {
        [name] => (Action::All, name),
        [action, name] => match action.as_str() {
            "plan" => (Action::Plan, name),
            "run" => (Action::Run, name),
            "merge" => (Action::Merge, name),
            "submit" => (Action::Submit, name),
            other => refuse!("{other:?}: give plan, run, merge or submit, and then a study"),
        },
        _ => {
            refuse!("give a study: {}", STUDIES.iter().map(|s| s.name()).collect::<Vec<_>>().join(", "))
        }
    };
    let study = named(name).map_err(wrong_usage)?;
    refuse_unused(action, context)?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("study-{name}")));
    let plan = match action {
        Action::Plan | Action::Submit | Action::All => {
            let size = Size {
                seeds: args.seeds,
                quick: args.quick,
                scene: args.scene.clone(),
                trajectory: args.trajectory.clone(),
                count_instructions: args.count_instructions,
            };
            if size.scene.is_some() && !study.takes_a_scene() {
                refuse!("--scene is for studies in a scene: {name} has scenes of its own");
            }
            if (size.trajectory.is_some() || size.count_instructions) && study.name() != "speed-accuracy" {
                refuse!(
                    "--trajectory and --count-instructions are for speed-accuracy: {name} does not know them"
                );
            }
            let is_without_scene = size.scene.is_none();
            let plan = Plan::new(study, size).map_err(|error| match is_without_scene {
                // nothing was read: what is missing is missing from the command line
                true => wrong_usage(error),
                false => error.into(),
            })?;
            if let Some(done) = plan.write(&folder)? {
                output::say_notice(&format!(
                    "{} held other tasks: {done} of the {} of now are done already",
                    folder.display(),
                    plan.tasks.len()
                ));
            }
            plan
        }
        Action::Run | Action::Merge => Plan::read(&folder)?,
    };
    if plan.study != study.name() {
        anyhow::bail!("{} holds a plan of the study {}, not of {name}", folder.display(), plan.study);
    }
    if matches!(action, Action::Run | Action::All) && !run_shards(args, &plan, &folder)? {
        anyhow::bail!(INTERRUPTED);
    }
    let findings = match action {
        Action::Merge | Action::All => Some(plan.merge(&folder)?),
        Action::Plan | Action::Run | Action::Submit => None,
    };
    let start = if action == Action::Submit { Some(write_scripts(args, &plan, &folder)?) } else { None };
    let document = Document {
        study: study.name(),
        folder: folder.display().to_string(),
        tasks: plan.tasks.len(),
        start,
        shard: args.shard.filter(|_| action == Action::Run).map(|shard| shard.to_string()),
        findings: findings.as_ref(),
    };
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary(&document))?;
    }
    if let Some(findings) = findings.filter(|findings| !findings.failed.is_empty()) {
        anyhow::bail!(
            "{} holds what could be studied; the rest failed, and running the study again tries it again: {}",
            folder.display(),
            findings.failed.join("; ")
        );
    }
    Ok(Outcome::Done)
}

/// What was typed and is of no use to this action: what a study is asked for stands in its plan.
fn refuse_unused(action: Action, context: Context) -> anyhow::Result<()> {
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

fn write_scripts(args: &Args, plan: &Plan, folder: &Path) -> anyhow::Result<String> {
    let program = std::env::current_exe().context("this program's own path")?;
    let folder = folder.canonicalize().with_context(|| folder.display().to_string())?;
    let scripts = submit::scripts(plan, args.engine, args.shards as usize, &program, &folder);
    for script in &scripts {
        let path = folder.join(script.name);
        files::write_whole(&path, script.text.as_bytes())
            .with_context(|| format!("{} cannot be written", path.display()))?;
    }
    Ok(format!("sh {}", folder.join(scripts[0].name).display()))
}

fn run_shards(args: &Args, plan: &Plan, folder: &Path) -> anyhow::Result<bool> {
    let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
    let shards = match args.shard {
        Some(shard) => vec![shard],
        None => {
            let count = SHARDS.min(plan.tasks.len()).max(1);
            (1..=count).map(|index| Shard { index, count }).collect()
        }
    };
    let bar = Stage::begin("the first shard");
    let all = shards.len();
    bar.counts(all as u64, 0);
    for (place, shard) in shards.into_iter().enumerate() {
        let say = |done| bar.say(format!("shard {} of {all}, {done} tasks of it", place + 1));
        match plan.run_shard(folder, shard, say, &stop)? {
            Ran::Whole => {}
            Ran::Again(what) => output::say_notice(&format!("{what}: shard {shard} was run again")),
            Ran::Stopped => return Ok(false),
        }
        bar.more(1);
    }
    Ok(true)
}

fn summary(document: &Document) -> String {
    let Some(findings) = document.findings else {
        let part = document.shard.as_ref().map_or(String::new(), |shard| format!("; shard {shard} is done"));
        let mut text = format!("{}: {} tasks in {}{part}\n", document.study, document.tasks, document.folder);
        if let Some(start) = &document.start {
            text += &format!("start it with {start}\n");
        }
        return text;
    };
    let mut text = format!("{}: {}\n", document.study, findings.summary);
    for claim in &findings.claims {
        text += &format!("{:15} {}: {}\n", claim.verdict.words(), claim.claim, claim.because);
    }
    for table in &findings.tables {
        text += &format!("\n{}\n", table.title);
        let widths: Vec<usize> = (0..table.columns.len())
            .map(|at| {
                let cells = std::iter::once(&table.columns).chain(&table.rows);
                cells.filter_map(|cells| cells.get(at)).map(|cell| cell.chars().count()).max().unwrap_or(0)
            })
            .collect();
        for cells in std::iter::once(&table.columns).chain(&table.rows) {
            let padded: Vec<String> =
                cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}")).collect();
            text += &format!("{}\n", padded.join("  ").trim_end());
        }
    }
    text + &format!("\n{}/report.html\n", document.folder)
}
