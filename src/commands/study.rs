//! `outrigger study`

mod args;

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;

pub use self::args::Args;
use self::args::{Action, SHARDS, make_plan, refuse_unused};
use super::stage::Stage;
use super::{Context, Outcome, output, signals};
use crate::report::Report;
use crate::study::shard::{Plan, Ran, Shard};
use crate::study::{Findings, findings_report, named, submit};

const INTERRUPTED: &str = "interrupted: whole shards stay, the same command goes on from there";
/// Time after Ctrl-C in which a shard may still be written. A task may take minutes; of a shard that is not whole nothing is
/// saved, so that nothing is gained by waiting for its tasks.
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
    let (action, name) = args.action()?;
    let study = named(name).map_err(super::wrong_usage)?;
    refuse_unused(action, context)?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("study-{name}")));
    let plan = match action {
        Action::Plan | Action::Submit | Action::All => make_plan(args, study, &folder)?,
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
    let start = if action == Action::Submit {
        Some(submit::write(&plan, args.engine, args.shards as usize, &folder)?)
    } else {
        None
    };
    let document = Document {
        study: study.name(),
        folder: folder.display().to_string(),
        tasks: plan.tasks.len(),
        start,
        shard: args.shard.filter(|_| action == Action::Run).map(|shard| shard.to_string()),
        findings: findings.as_ref(),
    };
    output::print_result(context.json, &document, &report(&document, study.about()), &[])?;
    if let Some(findings) = findings.filter(|findings| !findings.failed.is_empty()) {
        anyhow::bail!(
            "{} holds what could be studied; the rest failed, and running the study again tries it again: {}",
            folder.display(),
            findings.failed.join("; ")
        );
    }
    Ok(Outcome::Done)
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

fn report(document: &Document, about: &str) -> Report {
    let Some(findings) = document.findings else {
        let part = document.shard.as_ref().map_or(String::new(), |shard| format!("; shard {shard} is done"));
        let sentence = format!("{}: {} tasks in {}{part}", document.study, document.tasks, document.folder);
        let mut report = Report::new(document.study, &sentence);
        report.figures(document.start.as_ref().map(|start| ("start it with", start.clone())));
        return report;
    };
    let mut report = findings_report(document.study, about, findings);
    report.heading("");
    report.note(format!("{}/report.html", document.folder));
    report
}
