//! `outrigger evaluate`

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use anyhow::bail;
use serde::Serialize;

use super::{Context, Outcome, output};
use crate::objective::{Evaluation, Objective, Weights};
use crate::rig::MountFile;
use crate::simulate::published::{Experiment, Path, Phase, Placement, Preset, Roll, Simulator};

/// Arguments of `evaluate`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("mounts").required(true),
    after_help = "A mount file is one JSON object: format \"outrigger-mount/1\", frame \"mount: x right, y forward, z up\",\n\
                  sensors: [{name, model, x_m, y_m, z_m, pitch_deg, roll_deg} ...] and, if known, preset, objective,\n\
                  masters: [[x_m, y_m, z_m, pitch_deg, roll_deg] ...]. Its sensors are scored as they are, mirrored\n\
                  ones being listed; its preset holds where --preset is not given."
)]
pub struct Args {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// Sensors from a mount file.
    #[arg(long, group = "mounts", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Masters, mirrored by the program: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees.
    #[arg(long, group = "mounts", allow_hyphen_values = true, value_name = "LIST")]
    masters: Option<Masters>,
}

/// A published experiment and what may be changed about it.
#[derive(clap::Args, Debug, Clone)]
pub struct ExperimentArgs {
    /// The experiment: paper-os1-64 or paper-vlp-16.
    #[arg(long, env = "OUTRIGGER_PRESET")]
    pub preset: Option<String>,
    /// Direction of the walk in the mount frame: lateral as published, forward as the text has it.
    #[arg(long, default_value = "lateral")]
    path: PathArg,
    /// Edge of a voxel: 5 m divided by a whole number [default: the preset's 0.5].
    #[arg(long, value_name = "M")]
    voxel: Option<f64>,
    /// Columns per revolution [default: the preset's 180].
    #[arg(long, value_name = "N")]
    azimuths: Option<usize>,
    /// Roll of every master: fixed:DEG, or free to take it as given [default: fixed:0; free for a mount file].
    #[arg(long, value_name = "RULE")]
    roll: Option<RollArg>,
    /// Take the masters as they are, without mirror images.
    #[arg(long)]
    no_mirror: bool,
    /// Poses per metre of the walk.
    #[arg(long, value_name = "N", default_value_t = 1)]
    sub_poses: usize,
    /// Where each revolution starts: locked at azimuth 0, or free (moved on from pose to pose, and no ray lost).
    #[arg(long, default_value = "locked")]
    phase: PhaseArg,
    /// Price of one sensor in J.
    #[arg(long, value_name = "J", default_value_t = Weights::default().sensor_cost)]
    lambda: f64,
    /// Least distance between sensor origins; the housings are always asked for.
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    least_distance: f64,
    /// Adds to J this times log10(q / 0.003), q being the least translation eigenvalue per hit (5th percentile along
    /// the path): how well scans are tied down.
    #[arg(long, value_name = "J", default_value_t = 0.0)]
    registration_weight: f64,
    /// Least such q that is allowed (0.003 is loose, 1/3 the most there can be).
    #[arg(long, value_name = "Q", default_value_t = 0.0)]
    min_conditioning: f64,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum PathArg {
    Lateral,
    Forward,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum PhaseArg {
    Locked,
    Free,
}

#[derive(Clone, Copy, Debug)]
struct RollArg(Roll);

impl FromStr for RollArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "free" {
            return Ok(Self(Roll::Free));
        }
        let roll_deg = text.strip_prefix("fixed:").and_then(|number| number.parse::<f64>().ok());
        match roll_deg.filter(|value| value.is_finite()) {
            Some(roll_deg) => Ok(Self(Roll::Fixed(roll_deg))),
            None => Err("give free, or fixed: and an angle in degrees (fixed:0)".into()),
        }
    }
}

/// Masters as typed.
#[derive(Clone, Debug)]
pub struct Masters(pub Vec<Placement>);

impl FromStr for Masters {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut masters = Vec::new();
        for (index, part) in text.trim().trim_end_matches(';').split(';').enumerate() {
            let place = format!("master {} ({:?})", index + 1, part.trim());
            let numbers = part
                .split(',')
                .map(|number| number.trim().parse::<f64>().ok().filter(|value| value.is_finite()))
                .collect::<Option<Vec<_>>>()
                .ok_or_else(|| format!("{place}: every part must be a finite number"))?;
            let found = numbers.len();
            let numbers: [f64; 5] = numbers
                .try_into()
                .map_err(|_| format!("{place}: {found} numbers, expected x,y,z,pitch_deg,roll_deg"))?;
            masters.push(numbers.into());
        }
        Ok(Self(masters))
    }
}

impl ExperimentArgs {
    /// The objective that was asked for; `otherwise` names a preset where none is given, `roll` is the rule where none
    /// is given.
    pub fn objective(&self, otherwise: Option<&str>, roll: Roll) -> anyhow::Result<Objective> {
        let Some(preset) = self.preset.as_deref().or(otherwise) else {
            bail!("which experiment? Give --preset, one of {}", Preset::names());
        };
        let preset = Preset::named(preset)?;
        let experiment = Experiment {
            path: match self.path {
                PathArg::Lateral => Path::Lateral,
                PathArg::Forward => Path::Forward,
            },
            voxel_m: self.voxel.unwrap_or(preset.voxel_m),
            azimuths: self.azimuths.unwrap_or(preset.azimuths),
            roll: self.roll.map_or(roll, |rule| rule.0),
            mirror: !self.no_mirror,
            sub_poses: self.sub_poses,
            phase: match self.phase {
                PhaseArg::Locked => Phase::Locked,
                PhaseArg::Free => Phase::Free,
            },
            ..Experiment::published(preset)
        };
        if !(self.lambda.is_finite() && self.least_distance.is_finite() && self.least_distance >= 0.0) {
            bail!("--lambda and --least-distance take finite numbers, the distance none below 0");
        }
        if !(self.registration_weight.is_finite() && self.registration_weight >= 0.0) {
            bail!("--registration-weight {}, expected a number of at least 0", self.registration_weight);
        }
        if !(0.0..1.0 / 3.0).contains(&self.min_conditioning) {
            bail!("--min-conditioning {}, expected at least 0 and below 1/3", self.min_conditioning);
        }
        let weights = Weights {
            sensor_cost: self.lambda,
            registration: self.registration_weight,
            least_conditioning: self.min_conditioning,
            ..Weights::default()
        };
        Ok(Objective::new(Simulator::new(&experiment)?, weights, self.least_distance)?)
    }
}

/// The document that `evaluate` prints.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    evaluation: &'a Evaluation,
    coverage_sha256: String,
    preset: &'static str,
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
    let (objective, sensors) = match (&args.mount, &args.masters) {
        (Some(path), _) => from_file(args, path)?,
        (None, Some(Masters(masters))) => from_masters(args, masters)?,
        (None, None) => bail!("give --mount or --masters"),
    };
    let start = Instant::now();
    let seen = objective.simulator().see(&sensors)?;
    let evaluation = objective.score_counts(&sensors, &seen.coverage.counts());
    let wall_s = start.elapsed().as_secs_f64();
    let experiment = objective.simulator().experiment();
    let document = Document {
        evaluation: &evaluation,
        coverage_sha256: seen.coverage.union_sha256(),
        preset: experiment.preset.name,
        path: experiment.path,
        voxel_m: experiment.voxel_m,
        azimuths: experiment.azimuths,
        sub_poses: experiment.sub_poses,
        phase: experiment.phase,
        lost_rays: seen.lost_rays,
        mounts: sensors.iter().map(|sensor| (*sensor).into()).collect(),
        wall_s,
    };
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary(&document))?;
    }
    Ok(Outcome::Done)
}

fn from_masters(args: &Args, masters: &[Placement]) -> anyhow::Result<(Objective, Vec<Placement>)> {
    let objective = args.experiment.objective(None, Roll::Fixed(0.0))?;
    let experiment = objective.simulator().experiment();
    if experiment.replaces_a_roll(masters) {
        output::say_notice(
            "the given roll is replaced by the experiment's fixed roll; --roll free takes it as given",
        );
    }
    let sensors = experiment.sensors(masters);
    Ok((objective, sensors))
}

fn from_file(args: &Args, path: &std::path::Path) -> anyhow::Result<(Objective, Vec<Placement>)> {
    let file = MountFile::read(path)?;
    let objective = args.experiment.objective(file.preset.as_deref(), Roll::Free)?;
    let experiment = objective.simulator().experiment();
    let wanted = experiment.preset.model;
    if let Some(other) = file.sensors.iter().find(|sensor| !sensor.model.eq_ignore_ascii_case(wanted)) {
        bail!(
            "mount file {}: sensor {:?} is a {}, but preset {} simulates {wanted}: give the preset of that sensor",
            path.display(),
            other.name,
            other.model,
            experiment.preset.name
        );
    }
    let listed: Vec<_> = file
        .sensors
        .iter()
        .map(|s| Placement::from([s.x_m, s.y_m, s.z_m, s.pitch_deg, s.roll_deg]))
        .collect();
    if experiment.replaces_a_roll(&listed) {
        output::say_notice("the roll in the mount file is replaced, as --roll says");
    }
    let as_listed = Experiment { mirror: false, ..*experiment };
    let sensors = as_listed.sensors(&listed);
    Ok((objective, sensors))
}

fn summary(document: &Document) -> String {
    let evaluation = document.evaluation;
    let terms = &evaluation.terms;
    let angle = evaluation.min_angle_deg.map_or("one sensor".into(), |angle| format!("{angle:.2} degrees"));
    let mut text = format!(
        "{}, path {:?}\n\
         J              {:.2} = coverage {:.0} {:+.2} overlap {:+.2} angular {:+.0} cost\n\
         voxels seen    {} of {} that can be hit ({:.2} %)\n\
         overlap        {:.2} %\n\
         least angle    {angle}\n",
        document.preset,
        document.path,
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
    text += "sensor       x m      y m      z m    pitch     roll   voxels    alone\n";
    for (index, [x_m, y_m, z_m, pitch_deg, roll_deg]) in document.mounts.iter().enumerate() {
        text += &format!(
            "{:6} {x_m:9.4}{y_m:9.4}{z_m:9.4}{pitch_deg:9.3}{roll_deg:9.3}{:9}{:9}\n",
            index + 1,
            evaluation.per_sensor_voxels[index],
            evaluation.unique_per_sensor[index]
        );
    }
    if evaluation.feasible {
        text += "allowed        yes: every pair of housings is apart\n";
    }
    for violation in &evaluation.violations {
        text += &format!("allowed        no: {violation}\n");
    }
    text + &format!("{} rays in {:.4} s\n", evaluation.rays, document.wall_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masters_are_read_or_refused_by_name() {
        let masters = "0.1,-0.2,0,25,0; -0.1,0,0,-25,5;".parse::<Masters>().unwrap().0;
        assert_eq!(masters.len(), 2);
        assert_eq!(masters[1].pitch_deg, -25.0);
        for (bad, words) in [
            ("", "master 1"),
            ("1,2,3,4", "4 numbers"),
            ("0,0,0,NaN,0", "finite"),
            ("0,0,0,0,0;0,0,0,x,0", "master 2"),
            ("0,0,0,0,0;;0,0,0,0,0", "master 2"),
        ] {
            let error = bad.parse::<Masters>().unwrap_err();
            assert!(error.contains(words), "{bad}: {error}");
        }
        assert!("fixed:NaN".parse::<RollArg>().is_err());
    }
}
