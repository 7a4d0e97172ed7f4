//! `outrigger optimize`

mod state;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::{Duration, Instant};

use anyhow::bail;
use serde::Serialize;

use super::evaluate::ExperimentArgs;
use super::{Context, Outcome, output, signals};
use crate::objective::Evaluation;
use crate::optimize::{
    KeepApart, Kind, MountProblem, PUBLISHED_MASTERS_MAX, Search, Settings, StoppedBy, Trial,
};
use crate::rig::{MountFile, SensorEntry};
use crate::simulate::published::{Path, Placement, Roll};

/// Seconds between two writings of the state file.
const SAVE_EVERY: Duration = Duration::from_secs(10);

/// Arguments of `optimize`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Methods stop when their evaluations are used up; without --evals they run as published and stop by the\n\
                  published rules. Ctrl-C keeps the best mount so far; with --resume the search goes on from there."
)]
pub struct Args {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// Search method [default: staged].
    #[arg(long, value_enum)]
    method: Option<Kind>,
    /// Evaluations of the objective [default: the method's own].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    evals: Option<u64>,
    /// Seed of all random numbers [default: 1].
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Stop by the method's published rule even if evaluations are left.
    #[arg(long)]
    early_stop: bool,
    /// Most masters; each is mirrored unless --no-mirror.
    #[arg(long, value_name = "N", default_value_t = PUBLISHED_MASTERS_MAX, value_parser = clap::value_parser!(u32).range(1..=16))]
    masters_max: u32,
    /// Distance between sensor origins that the search must keep: housing, none (as published) or metres.
    #[arg(long, value_name = "RULE", default_value = "none")]
    clearance: ClearanceArg,
    /// Write the best mount to this file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// State of the search: read if it exists, written while searching.
    #[arg(long, value_name = "STATE")]
    resume: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug)]
struct ClearanceArg(KeepApart);

impl FromStr for ClearanceArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self(KeepApart::None)),
            "housing" => Ok(Self(KeepApart::Housings)),
            number => match number.parse::<f64>() {
                Ok(least_m) if least_m.is_finite() && least_m >= 0.0 => {
                    Ok(Self(KeepApart::Distance(least_m)))
                }
                _ => Err("give housing, none, or a distance in metres".into()),
            },
        }
    }
}

/// The document that `optimize` prints.
#[derive(Serialize)]
struct Document {
    method: Kind,
    seed: u64,
    evaluations: usize,
    rays: u64,
    wall_s: f64,
    stopped_by: StoppedBy,
    best: Best,
    /// Evaluation that found the best, from 1.
    best_at: usize,
    preset: &'static str,
    path: Path,
    clearance: KeepApart,
    masters_max: u32,
    /// `[evaluation, best objective so far]`; null while nothing feasible was found.
    history: Vec<(usize, Option<f64>)>,
}

#[derive(Serialize)]
struct Best {
    #[serde(flatten)]
    evaluation: Evaluation,
    /// `[x_m, y_m, z_m, pitch_deg, roll_deg]` of each sensor before mirroring.
    masters: Vec<[f64; 5]>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let objective = args.experiment.objective(None, Roll::Fixed(0.0))?;
    let problem = MountProblem::new(objective, args.masters_max, args.clearance.0);
    let question = state::question(&problem, args.masters_max, args.clearance.0)?;
    let mut search =
        match args.resume.as_deref().map(|path| state::read(path, &question)).transpose()?.flatten() {
            Some(search) => continued(args, search)?,
            None => begun(args, &problem)?,
        };
    let budget = args.evals.map_or(search.settings().budget, |evals| evals as usize);
    let stop = signals::stop_flag()?;
    let bar = progress_bar(budget);
    bar.set_position(search.evaluations() as u64);
    let start = Instant::now();
    let mut saved = Instant::now();
    let mut save_error = None;
    let stopped_by = search.run(
        budget,
        |values| problem.measure(values),
        |search| {
            bar.set_position(search.evaluations() as u64);
            if let Some(best) = search.best() {
                bar.set_message(format!("J {:.1}", best.score));
            }
            if let Some(path) = &args.resume
                && save_error.is_none()
                && saved.elapsed() > SAVE_EVERY
            {
                save_error = state::write(path, &question, search).err();
                saved = Instant::now();
            }
        },
        &stop,
    )?;
    let wall_s = start.elapsed().as_secs_f64();
    bar.finish_and_clear();
    if let Some(path) = &args.resume {
        save_error.map_or_else(|| state::write(path, &question, &search), Err)?;
    }
    let Some(best) = search.best() else { bail!("stopped before the first evaluation: no mount was scored") };
    report(args, context, &problem, &search, best, stopped_by, wall_s)
}

fn begun(args: &Args, problem: &MountProblem) -> anyhow::Result<Search> {
    let kind = args.method.unwrap_or(Kind::Staged);
    let settings = Settings {
        seed: args.seed.unwrap_or(1),
        budget: args.evals.map_or(kind.published_budget(), |evals| evals as usize),
        early_stop: args.early_stop || args.evals.is_none(),
    };
    Ok(Search::new(problem.space()?, kind, settings))
}

fn continued(args: &Args, search: Search) -> anyhow::Result<Search> {
    let Settings { seed, .. } = search.settings();
    if args.method.is_some_and(|kind| kind != search.kind()) || args.seed.is_some_and(|given| given != seed) {
        bail!(
            "the state file holds a search by {} with seed {seed}: leave out --method and --seed, or start a new file",
            search.kind().name()
        );
    }
    Ok(search)
}

fn progress_bar(budget: usize) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(budget as u64);
    let style =
        indicatif::ProgressStyle::with_template("{bar:30} {pos}/{len} evaluations, {msg}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| indicatif::ProgressStyle::default_bar()));
    bar
}

fn report(
    args: &Args,
    context: Context,
    problem: &MountProblem,
    search: &Search,
    best: &Trial,
    stopped_by: StoppedBy,
    wall_s: f64,
) -> anyhow::Result<Outcome> {
    if best.violation > 0.0 {
        bail!(
            "none of {} mounts keeps what was asked for; the nearest misses it by {:.4} (m of clearance, share of \
             conditioning): give more evaluations, or a smaller --clearance or --min-conditioning",
            search.evaluations(),
            best.violation
        );
    }
    let masters = problem.masters(&best.candidate.values);
    let evaluation = problem.objective().evaluate(&masters)?;
    let experiment = problem.objective().simulator().experiment();
    let document = Document {
        method: search.kind(),
        seed: search.settings().seed,
        evaluations: search.evaluations(),
        rays: search.rays(),
        wall_s,
        stopped_by,
        best: Best { evaluation, masters: masters.iter().map(|master| (*master).into()).collect() },
        best_at: search.best_at(),
        preset: experiment.preset.name,
        path: experiment.path,
        clearance: args.clearance.0,
        masters_max: args.masters_max,
        history: search.history().collect(),
    };
    if let Some(path) = &args.out {
        mount_file(problem, &masters, document.best.evaluation.objective).write(path)?;
    }
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary(&document))?;
    }
    if !document.best.evaluation.feasible {
        output::say_notice(
            "the housings of the best mount would collide, so it cannot be built; --clearance housing searches among \
             those that can",
        );
    }
    Ok(Outcome::Done)
}

fn mount_file(problem: &MountProblem, masters: &[Placement], objective: f64) -> MountFile {
    let experiment = problem.objective().simulator().experiment();
    let entry = |(index, sensor): (usize, Placement)| SensorEntry {
        name: sensor_name(index, experiment.mirror, masters.len()),
        model: experiment.preset.model.into(),
        x_m: sensor.x_m,
        y_m: sensor.y_m,
        z_m: sensor.z_m,
        pitch_deg: sensor.pitch_deg,
        roll_deg: sensor.roll_deg,
    };
    let mut file = MountFile::new(experiment.sensors(masters).into_iter().enumerate().map(entry).collect());
    file.masters = Some(masters.iter().map(|master| (*master).into()).collect());
    file.preset = Some(experiment.preset.name.into());
    file.objective = Some(objective);
    file
}

/// `master` and `mirrored`, numbered where there are several.
fn sensor_name(index: usize, is_mirrored: bool, masters: usize) -> String {
    let (master, side) = match is_mirrored {
        true => (index / 2, if index.is_multiple_of(2) { "master" } else { "mirrored" }),
        false => (index, "sensor"),
    };
    if masters == 1 { side.into() } else { format!("{side}-{}", master + 1) }
}

fn summary(document: &Document) -> String {
    let Document { best: Best { evaluation, masters }, .. } = document;
    let mut text = format!(
        "{}, path {:?}, {} with seed {}\n\
         J              {:.2}, found at evaluation {} of {} ({})\n\
         voxels seen    {} of {} that can be hit\n\
         overlap        {:.2} %\n",
        document.preset,
        document.path,
        document.method.name(),
        document.seed,
        evaluation.objective,
        document.best_at,
        document.evaluations,
        match document.stopped_by {
            StoppedBy::Budget => "all used",
            StoppedBy::Converged => "then converged",
            StoppedBy::Interrupted => "then interrupted",
        },
        evaluation.unique_voxels,
        evaluation.reachable_voxels,
        100.0 * evaluation.overlap_ratio,
    );
    text += "master       x m      y m      z m    pitch     roll\n";
    for (index, [x_m, y_m, z_m, pitch_deg, roll_deg]) in masters.iter().enumerate() {
        text += &format!("{:6} {x_m:9.4}{y_m:9.4}{z_m:9.4}{pitch_deg:9.3}{roll_deg:9.3}\n", index + 1);
    }
    for violation in &evaluation.violations {
        text += &format!("allowed        no: {violation}\n");
    }
    text + &format!("{} rays in {:.3} s\n", document.rays, document.wall_s)
}
