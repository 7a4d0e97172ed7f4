//! `outrigger validate`

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, bail};

use super::masters::Masters;
use super::scene_args::{MeshArgs, SampleArgs, TrajectoryArgs};
use super::stage::Stage;
use super::{Context, Outcome, output};
use crate::report::completeness::{Document, Times, page};
use crate::rig::{MountFile, MountedSensor, Rig, Unit, UnitChoice};
use crate::simulate::fan::BeamFan;
use crate::simulate::ideal::IdealSensors;
use crate::world::scene::Scene;
use crate::world::surface::{MAIN_RANK, ObservableSurface, write_flags};
use crate::world::trajectory::Trajectory;

/// Arguments of `validate`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("placed").required(true),
    after_help = "An ideal sensor is cast along the trajectory: every beam from the sensor's origin at its elevation (nominal, or \
                  as calibrated), columns evenly spaced, no noise. A surface sample is covered when some return lies within \
                  the threshold. Beside the mounts stand one level sensor and the best single one (pitch in steps of 5 \
                  degrees, searched on about 24 revolutions), of the model with the most channels, and the first of several \
                  mounts without the others."
)]
pub struct Args {
    /// Surface: .ply, .obj, .stl, .off, .gltf or .glb.
    #[arg(long, value_name = "FILE")]
    mesh: PathBuf,
    #[command(flatten)]
    mesh_args: MeshArgs,
    #[command(flatten)]
    trajectory: TrajectoryArgs,
    /// Model of every sensor, or with NAME= of one in the mount file [default: as the mount file says]: a name of the
    /// catalogue, Ouster metadata (.json), Velodyne calibration (.xml, .yaml), or MODEL:FILE. May be given several
    /// times.
    #[arg(long, value_name = "[NAME=]MODEL")]
    sensor: Vec<UnitChoice>,
    /// Sensors as they are: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees.
    #[arg(long, group = "placed", allow_hyphen_values = true, value_name = "LIST")]
    mounts: Option<Masters>,
    /// Sensors from a mount file.
    #[arg(long, group = "placed", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Columns per revolution [default: as the calibration says; else 1024 for Ouster models, 1800 for others].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    azimuths: Option<u32>,
    /// Revolutions per second [default: as the calibration says; else 10].
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(0.1, 200.0))]
    spin_rate: Option<f64>,
    /// Least range that counts.
    #[arg(long, value_name = "M", default_value_t = 0.3, value_parser = crate::commands::ranges::within(0.0, 10_000.0))]
    min_range: f64,
    /// Greatest range that counts [default: the model's].
    #[arg(long, value_name = "M", value_parser = crate::commands::ranges::within(1e-3, 10_000.0))]
    max_range: Option<f64>,
    #[command(flatten)]
    samples: SampleArgs,
    /// Of the drawn samples.
    #[arg(long, default_value_t = 0, conflicts_with = "samples")]
    seed: u64,
    /// Leave out the single sensors beside which the mounts are judged.
    #[arg(long)]
    no_baselines: bool,
    /// Also write the covered flags at 5 cm, one bit per sample as numpy.packbits does (a .npy file).
    #[arg(long, value_name = "FILE")]
    covered_out: Option<PathBuf>,
    /// Write a page with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    output::check_places([&args.covered_out, &args.report])?;
    let start = Instant::now();
    let (units, rig) = units(args)?;
    let mut warnings: Vec<String> = units.iter().filter_map(|unit| unit.notice.clone()).collect();
    warnings.dedup();
    let read = args.mesh_args.read(&args.mesh)?;
    let (scene, origin) = (Scene::Mesh(read.mesh.clone()), read.origin);
    warnings.extend(read.warnings);
    let (trajectory, notes) = args.trajectory.read(origin)?;
    warnings.extend(notes);
    let fans = fans(args, &units, &trajectory)?;
    let placement = args.trajectory.placement(&scene, &trajectory, rig.mean_height_m(), origin);
    warnings.extend(placement.doubts);
    let samples = args.samples.samples(&read.mesh, origin, args.seed)?;
    warnings.iter().for_each(|warning| output::say_notice(warning));
    let sensors = IdealSensors { scene, trajectory, rig, fans };
    let prepare_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let stage = Stage::begin("looking what could be seen from the way");
    let stations_m = sensors.trajectory.sight_stations_m(sensors.rig.mean_height_m());
    let surface = ObservableSurface::new(&sensors.scene, samples, &stations_m);
    let observable_s = start.elapsed().as_secs_f64();
    stage.next("casting the rays of the sensors");
    let (coverage, completeness) = sensors.cover(&surface);
    let wall_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    stage.next("looking what single sensors would see (--no-baselines leaves them out)");
    let baselines = (!args.no_baselines).then(|| sensors.baselines(&surface, &coverage));
    let mut document = Document::new(&sensors, (&read.mesh, read.summary), &surface, coverage, baselines);
    document.warnings = warnings;
    document.times = Times { prepare_s, wall_s, observable_s, baselines_s: start.elapsed().as_secs_f64() };
    drop(stage);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    if let Some(path) = &args.covered_out {
        write_flags(path, &completeness.covered(MAIN_RANK)).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.report {
        let page = page(&document, &sensors, &surface, origin, &output::again());
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    Ok(if placement.is_wrong { Outcome::DataLost } else { Outcome::Done })
}

/// The sensors of `--mounts` or of the mount file.
fn units(args: &Args) -> anyhow::Result<(Vec<Unit>, Rig)> {
    match (&args.mounts, &args.mount) {
        (Some(masters), _) => {
            let unit = unit_of_all(&args.sensor)?;
            let mounted = |(index, mount)| MountedSensor {
                name: format!("sensor {}", index + 1),
                model: unit.model.clone(),
                mount,
            };
            let mounts = masters.without_models()?;
            let mounts = mounts.iter().map(|placement| placement.mount());
            let sensors: Vec<_> = mounts.enumerate().map(mounted).collect();
            Ok((vec![unit.clone(); sensors.len()], Rig { sensors }))
        }
        (None, Some(path)) => {
            let file = MountFile::read(path)?;
            let units = file.units(&args.sensor)?;
            let rig = file.rig_of(&units);
            Ok((units, rig))
        }
        (None, None) => refuse!("give --mounts or --mount"),
    }
}

fn unit_of_all(choices: &[UnitChoice]) -> anyhow::Result<Unit> {
    let [choice] = choices else { refuse!("--mounts takes one --sensor for all of them") };
    Ok(match choice {
        UnitChoice { sensor: Some(name), .. } => {
            refuse!("--sensor {name}=...: sensors of --mounts have no names; give one --sensor for all")
        }
        UnitChoice { file: Some(file), model, .. } => Unit::calibrated(file, model.as_deref())?,
        UnitChoice { model, .. } => Unit::nominal(model.as_deref().unwrap_or_default())?,
    })
}

/// The beams of each sensor; each turns at least once along the trajectory.
fn fans(args: &Args, units: &[Unit], trajectory: &Trajectory) -> anyhow::Result<Vec<BeamFan>> {
    let fans: Vec<_> = units.iter().map(|unit| fan(args, unit)).collect::<Result<_, _>>()?;
    if let Some(slow) = fans.iter().find(|fan| fan.scans(trajectory) == 0) {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        bail!(
            "{}: {} s long, expected at least one revolution of {} s",
            args.trajectory.name(),
            (end_ns - start_ns) as f64 * 1e-9,
            1.0 / slow.rate_hz
        );
    }
    Ok(fans)
}

fn fan(args: &Args, unit: &Unit) -> anyhow::Result<BeamFan> {
    let columns = args.azimuths.unwrap_or(unit.columns);
    let rate_hz = args.spin_rate.unwrap_or(unit.rate_hz);
    let mut fan = BeamFan::nominal(&unit.model, columns as usize, rate_hz);
    fan.min_range_m = args.min_range;
    fan.max_range_m = args.max_range.unwrap_or(fan.max_range_m);
    if !(fan.min_range_m >= 0.0 && fan.max_range_m > fan.min_range_m) {
        bail!("ranges from {} to {} m, expected 0 or more, ascending", fan.min_range_m, fan.max_range_m);
    }
    Ok(fan)
}
