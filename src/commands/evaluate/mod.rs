//! `outrigger evaluate`

mod beside;
mod experiment;
mod fidelity;
mod found;
mod masters;
mod page;
mod prices;

pub use experiment::ExperimentArgs;
pub use found::found_with;
pub use masters::Masters;

use std::path::{Path as FilePath, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, anyhow};
use serde::Serialize;

use self::beside::{Alone, Rescored};
use self::fidelity::Fidelity;
use super::baselines::Baselines;
use super::{Context, Outcome, output};
use crate::design::objective::{Evaluation, Objective};
use crate::design::registration::{POSE_STEP_M, RegistrationQuality, along_published, least_along};
use crate::report::{BlindSpot, blind_spots};
use crate::rig::{MountFile, SensorEntry, Touching};
use crate::simulate::published::{Experiment, Path, Phase, Placement, Roll};

/// Blind spots listed, the largest first.
const MOST_BLIND_SPOTS: usize = 10;

/// Arguments of `evaluate`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("mounts").required(true),
    after_help = "A mount file is one JSON object: format \"outrigger-mount/1\", frame \"mount: x right, y forward, z up\", \
                  sensors: [{name, model, x_m, y_m, z_m, pitch_deg, roll_deg} ...] and, if known, preset, objective, found_with, \
                  masters: [[x_m, y_m, z_m, pitch_deg, roll_deg] ...], master_models: [model ...]. Its sensors are \
                  scored as they are, mirrored ones being listed, each as the model that it is; its preset (several \
                  with commas between them) holds where --preset is not given, and so does found_with: {path, voxel_m, \
                  azimuths, sub_poses, phase, lambda, registration_weight, least_conditioning, least_distance_m}, with \
                  which optimize found it. calibrations: {name: file} names the \
                  calibration of a unit, for predict and validate. What the published program exports is read, too.\n\n\
                  Beside the mounts stand one level sensor and the best single one (pitch in steps of 1 degree), where \
                  the middle of the mounts is."
)]
pub struct Args {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// Sensors from a mount file.
    #[arg(long, group = "mounts", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Masters, mirrored by the program: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees; on a mixed rig each ends
    /// with its model ("x,y,z,pitch_deg,roll_deg,vlp-16;...").
    #[arg(long, group = "mounts", allow_hyphen_values = true, value_name = "LIST")]
    masters: Option<Masters>,
    /// Leave out the single sensors beside which the mounts are judged.
    #[arg(long)]
    no_baselines: bool,
    /// Score again so many times with every ray off its direction by the published divergence.
    #[arg(long, value_name = "RUNS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1000))]
    rescore: u32,
    /// Divergence of the re-score: standard deviation of each component of a ray's direction.
    #[arg(long, value_name = "DEG", default_value_t = crate::simulate::published::PUBLISHED_SPREAD_DEG, value_parser = crate::commands::ranges::within(0.0, 90.0))]
    divergence: f64,
    /// Seed of the re-score.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// given: only the sampling as given. auto: also as many rays as it takes to know J within the tolerance, with the
    /// error that is left and what the model leaves out [default: auto with --voxel and nothing said about columns, poses
    /// or phase; given for a published experiment].
    #[arg(long)]
    fidelity: Option<FidelityArg>,
    /// Error of J that auto may leave, percent of J.
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, value_parser = crate::commands::ranges::within(1e-9, 100.0))]
    tolerance: f64,
    /// Write a page with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// How finely is looked.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FidelityArg {
    /// As the other arguments say.
    Given,
    /// As finely as the question needs.
    Auto,
}

impl FidelityArg {
    /// Where nothing is said: a published experiment is looked at as it was published.
    pub fn for_scene(is_new: bool) -> Self {
        if is_new { Self::Auto } else { Self::Given }
    }
}

/// The document that `evaluate` prints.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    evaluation: &'a Evaluation,
    /// Null where they were left out.
    baselines: Option<Baselines<Alone>>,
    /// Null unless asked for.
    rescored: Option<Rescored>,
    /// Null unless asked for.
    fidelity: Option<Fidelity>,
    /// `[place on the walk m, translation, rotation m^2]`: least eigenvalues per hit.
    registration_path: Vec<[f64; 3]>,
    /// Neighbouring voxels that can be hit and are not, the largest groups first.
    blind_spots: Vec<BlindSpot>,
    /// Pairs of housings that touch as they are tilted, far apart as their origins may be.
    touching: Vec<Touching>,
    coverage_sha256: String,
    /// Of a mixed rig all presets, with commas between them.
    preset: String,
    /// Price of a sensor of each of them.
    prices: Vec<f64>,
    path: Path,
    voxel_m: f64,
    azimuths: usize,
    sub_poses: usize,
    phase: Phase,
    /// Rays that the published slab test loses, by sensor.
    lost_rays: Vec<u64>,
    /// Every physical sensor: x_m, y_m, z_m, pitch_deg, roll_deg.
    mounts: Vec<[f64; 5]>,
    wall_s: f64,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    check(args, context)?;
    let Asked { objective, sensors, stated, apart } = match (&args.mount, &args.masters) {
        (Some(path), _) => from_file(args, path)?,
        (None, Some(masters)) => from_masters(args, masters)?,
        (None, None) => refuse!("give --mount or --masters"),
    };
    output::check_places([&args.report])?;
    let asked = fidelity_asked(args);
    let simulator = objective.simulator();
    let start = Instant::now();
    let seen = simulator.see(&sensors)?;
    let mut evaluation = objective.score_counts(&sensors, &seen.coverage.counts());
    let wall_s = start.elapsed().as_secs_f64();
    let scans = along_published(simulator, &sensors);
    evaluation.registration = RegistrationQuality::of_scans(&scans);
    let experiment = simulator.experiment();
    let first_m = -0.5 * experiment.preset.path_length_m;
    let along = |(scan, [translation, rotation_m2]): (usize, [f64; 2])| {
        [first_m + (scan * POSE_STEP_M) as f64, translation, rotation_m2]
    };
    let grid = simulator.grid();
    let union = seen.coverage.union();
    let unseen = simulator.reachable_cells().filter(|cell| union[cell / 64] >> (cell % 64) & 1 == 0);
    let document = Document {
        baselines: if args.no_baselines { None } else { Some(beside::baselines(&objective, &sensors)?) },
        rescored: beside::rescored(&objective, &sensors, args)?,
        fidelity: fidelity::fidelity(&objective, &sensors, asked, args.tolerance / 100.0)?,
        registration_path: least_along(&scans).into_iter().enumerate().map(along).collect(),
        blind_spots: blind_spots(&grid, unseen, MOST_BLIND_SPOTS),
        touching: objective.rig(&sensors).touching(),
        evaluation: &evaluation,
        coverage_sha256: seen.coverage.union_sha256(),
        preset: experiment.name(),
        prices: objective.prices().to_vec(),
        path: experiment.path,
        voxel_m: experiment.voxel_m,
        azimuths: experiment.azimuths,
        sub_poses: experiment.sub_poses,
        phase: experiment.phase,
        lost_rays: seen.lost_rays,
        mounts: sensors.iter().map(|sensor| (*sensor).into()).collect(),
        wall_s,
    };
    output::print_result(context.json, &document, || summary(&document), &[])?;
    if let Some(path) = &args.report {
        let page = page::page(&document, &seen.coverage);
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    if let Some(stated) = stated.filter(|stated| (stated - evaluation.objective).abs() > 0.005) {
        output::say_notice(&format!("the mount file says J {stated:.2}, {apart}"));
    }
    Ok(Outcome::Done)
}

/// Refuses what cannot be meant, or has nothing to be about.
fn check(args: &Args, context: Context) -> anyhow::Result<()> {
    if !(args.tolerance > 0.0 && args.tolerance <= 100.0) {
        refuse!("--tolerance {}, expected more than 0 and at most 100 percent", args.tolerance);
    }
    if args.rescore == 0 {
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
struct Asked {
    objective: Objective,
    sensors: Vec<Placement>,
    /// The score that the mount file states.
    stated: Option<f64>,
    /// Why that may be another one than is found here.
    apart: String,
}

fn from_masters(args: &Args, masters: &Masters) -> anyhow::Result<Asked> {
    let objective = args.experiment.objective(Roll::Fixed(0.0))?;
    let experiment = objective.simulator().experiment();
    let masters = &masters.of(experiment)?;
    if experiment.replaces_a_roll(masters) {
        output::say_notice(
            "the given roll is replaced by the experiment's fixed roll; --roll free takes it as given",
        );
    }
    let sensors = experiment.sensors(masters);
    Ok(Asked { objective, sensors, stated: None, apart: String::new() })
}

fn from_file(args: &Args, path: &FilePath) -> anyhow::Result<Asked> {
    let file = MountFile::read(path)?;
    let objective = args.experiment.objective_for(&file, path)?;
    let experiment = objective.simulator().experiment();
    let type_of = |sensor: &SensorEntry| {
        let mut models = experiment.types().map(|preset| preset.model);
        let sensor_type = models.position(|model| sensor.model.eq_ignore_ascii_case(model));
        sensor_type.ok_or_else(|| {
            let models: Vec<_> = experiment.types().map(|preset| preset.model).collect();
            anyhow!(
                "mount file {}: sensor {:?} is a {}, but preset {} simulates {}: give the preset of that sensor, or of a \
                 mixed rig those of all its sensors with commas between them",
                path.display(),
                sensor.name,
                sensor.model,
                experiment.name(),
                models.join(" and ")
            )
        })
    };
    if file.calibrations.is_some() {
        output::say_notice(
            "the published experiment has beams of its own: calibrations of the mount file are not used",
        );
    }
    let listed: Vec<_> = file
        .sensors
        .iter()
        .map(|s| {
            let placed = Placement::from([s.x_m, s.y_m, s.z_m, s.pitch_deg, s.roll_deg]);
            Ok(Placement { sensor_type: type_of(s)?, ..placed })
        })
        .collect::<anyhow::Result<_>>()?;
    let is_rolled_otherwise = experiment.replaces_a_roll(&listed);
    if is_rolled_otherwise {
        output::say_notice("the roll in the mount file is replaced, as --roll says");
    }
    let as_listed = Experiment { mirror: false, ..*experiment };
    let sensors = as_listed.sensors(&listed);
    let mut differences = found::differences(&file, &objective);
    differences.extend(is_rolled_otherwise.then(|| "the rolls in it (here replaced)".to_owned()));
    let apart = match (differences.is_empty(), &file.found_with) {
        (false, _) => format!("found with {}", differences.join(", ")),
        (true, Some(_)) => "and was found with the settings of here: its sensors were changed since".into(),
        (true, None) => {
            "and not with which --path, --voxel, --azimuths, --sub-poses, --phase, --lambda ... that was \
                         found: they were others than here, or its sensors were changed since"
                .into()
        }
    };
    Ok(Asked { objective, sensors, stated: file.objective, apart })
}

fn summary(document: &Document) -> String {
    let evaluation = document.evaluation;
    let terms = &evaluation.terms;
    let angle = evaluation.min_angle_deg.map_or("one sensor".into(), |angle| format!("{angle:.2} degrees"));
    let registration = match terms.registration {
        0.0 => String::new(),
        term => format!(" {term:+.2} registration"),
    };
    let mut text = format!(
        "{}, path {}\n\
         J              {:.2} = coverage {:.0} {:+.2} overlap {:+.2} angular {:+.0} cost{registration}\n\
         voxels seen    {} of {} that can be hit ({:.2} %)\n\
         overlap        {:.2} %\n\
         least angle    {angle}\n",
        document.preset,
        document.path.name(),
        evaluation.objective,
        terms.coverage,
        terms.overlap,
        terms.angular,
        terms.cost,
        evaluation.unique_voxels,
        evaluation.reachable_voxels,
        100.0 * evaluation.unique_voxels as f64 / evaluation.reachable_voxels as f64,
        100.0 * evaluation.overlap_ratio,
    );
    text += "sensor       x m      y m      z m    pitch     roll   voxels    alone  model\n";
    for (index, [x_m, y_m, z_m, pitch_deg, roll_deg]) in document.mounts.iter().enumerate() {
        text += &format!(
            "{:6} {x_m:9.4}{y_m:9.4}{z_m:9.4}{pitch_deg:9.3}{roll_deg:9.3}{:9}{:9}  {}\n",
            index + 1,
            evaluation.per_sensor_voxels[index],
            evaluation.unique_per_sensor[index],
            evaluation.models[index]
        );
    }
    for (name, single) in document.baselines.iter().flat_map(Baselines::named) {
        text += &format!(
            "{name:15}{} at pitch {:.0}: J {:.2}, {} voxels; the mounts see {:+}\n",
            single.model,
            single.pitch_deg,
            single.seen.objective,
            single.seen.unique_voxels,
            single.seen.gain_voxels
        );
    }
    if let Some(quality) = &evaluation.registration {
        text += &quality.line();
    }
    if let Some(rescored) = &document.rescored {
        text += &rescored.line();
    }
    for (title, words) in document.fidelity.iter().flat_map(Fidelity::verdicts) {
        text += &format!("{title:<15}{words}\n");
    }
    if evaluation.feasible {
        text += "allowed        yes: every pair of sensors keeps its distance\n";
    }
    text += &evaluation.saturation().map_or(String::new(), |words| format!("{words}\n"));
    for violation in &evaluation.violations {
        text += &format!("allowed        no: {violation}\n");
    }
    for pair in &document.touching {
        text += &format!("can be built   no: {pair}\n");
    }
    text + &format!("{} rays in {:.4} s\n", evaluation.rays, document.wall_s)
}
