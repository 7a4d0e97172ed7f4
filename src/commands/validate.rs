//! `outrigger validate`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail};
use glam::DVec3;
use sensors::{SensorModel, catalogue};
use serde::Serialize;

use super::evaluate::Masters;
use super::{Context, Outcome, output};
use crate::rig::{Mount, MountFile};
use crate::scene::{LoadedMesh, Mesh, MeshUnit, Scene, UpAxis, load_mesh};
use crate::simulate::fan::BeamFan;
use crate::surface::{Completeness, SurfaceSamples, THRESHOLDS_M, observable, read_points};
use crate::trajectory::Trajectory;

/// Rank of the threshold that the shares of the observable surface and the search for a baseline use: 5 cm.
const MAIN_RANK: usize = 1;
/// Line of sight may end this much before a point, m.
const SIGHT_TOLERANCE_M: f64 = 0.02;
/// Way between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 0.5;
/// Pitches tried for the best single sensor, degrees.
const SEARCH_PITCHES_DEG: [f64; 10] = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0];
/// Every so many revolutions are cast in that search.
const SEARCH_STEP: u64 = 8;

/// Arguments of `validate`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("placed").required(true),
    after_help = "An ideal sensor is cast along the trajectory: every beam from the sensor's origin at its nominal elevation, \n\
                  columns evenly spaced, no noise. A surface sample is covered when some return lies within the threshold."
)]
pub struct Args {
    /// Surface: .ply, .obj, .stl, .gltf or .glb.
    #[arg(long, value_name = "FILE")]
    mesh: PathBuf,
    /// Unit of the mesh file [default: m, refused where the size makes that absurd].
    #[arg(long, value_name = "UNIT")]
    mesh_unit: Option<UnitArg>,
    /// Axis of the mesh file that points up [default: z; y for glTF].
    #[arg(long, value_name = "AXIS")]
    up: Option<UpArg>,
    /// Way of the body: TUM format, or KITTI poses with --rate.
    #[arg(long, value_name = "FILE")]
    trajectory: PathBuf,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Model of every sensor (os1-64, vlp-16, ...) [default: as the mount file says].
    #[arg(long, value_name = "MODEL", required_unless_present = "mount")]
    sensor: Option<String>,
    /// Sensors as they are: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees.
    #[arg(long, group = "placed", allow_hyphen_values = true, value_name = "LIST")]
    mounts: Option<Masters>,
    /// Sensors from a mount file.
    #[arg(long, group = "placed", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Columns per revolution [default: 1024 for Ouster models, 1800 for others].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    azimuths: Option<u32>,
    /// Revolutions per second.
    #[arg(long, value_name = "HZ", default_value_t = 10.0)]
    spin_rate: f64,
    /// Least range that counts.
    #[arg(long, value_name = "M", default_value_t = 0.3)]
    min_range: f64,
    /// Greatest range that counts [default: the model's].
    #[arg(long, value_name = "M")]
    max_range: Option<f64>,
    /// Surface samples: a NumPy file of floats, shape (n, 3), metres, in the frame of the trajectory.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sample_count", "seed"])]
    samples: Option<PathBuf>,
    /// Samples drawn from the mesh, evenly over its area.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    sample_count: u32,
    /// Of the drawn samples.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Leave out the single sensors beside which the mounts are judged.
    #[arg(long)]
    no_baselines: bool,
    /// Also write the covered flags at 5 cm, one bit per sample as numpy.packbits does (a .npy file).
    #[arg(long, value_name = "FILE")]
    covered_out: Option<PathBuf>,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(super) enum UnitArg {
    M,
    Cm,
    Mm,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(super) enum UpArg {
    Z,
    Y,
}

/// The document that `validate` prints.
#[derive(Serialize)]
struct Document {
    #[serde(flatten)]
    seen: Seen,
    observable_share: f64,
    baselines: BTreeMap<&'static str, Baseline>,
    sensors: usize,
    columns: usize,
    min_range_m: f64,
    max_range_m: f64,
    samples: usize,
    triangles: usize,
    triangles_without_area: usize,
    area_m2: f64,
    trajectory_length_m: f64,
    warnings: Vec<String>,
    /// Reading of files, tree and samples.
    prepare_s: f64,
    /// Casting and counting for the mounts, and the observable set.
    wall_s: f64,
    /// Of that, the observable set.
    observable_s: f64,
    baselines_s: f64,
}

/// What a set of sensors sees.
#[derive(Serialize)]
struct Seen {
    /// By threshold in metres.
    completeness: BTreeMap<String, f64>,
    /// At 5 cm; null when nothing is observable.
    completeness_of_observable: Option<f64>,
    /// x_m, y_m, z_m, pitch_deg, roll_deg.
    mounts: Vec<[f64; 5]>,
    rays: u64,
}

/// A single sensor beside the mounts.
#[derive(Serialize)]
struct Baseline {
    #[serde(flatten)]
    seen: Seen,
    /// Completeness of the mounts less that of the baseline, percentage points, by threshold.
    gain_points: BTreeMap<String, f64>,
}

/// Everything that is cast into.
struct Field {
    scene: Scene,
    mesh: Arc<Mesh>,
    trajectory: Trajectory,
    samples: SurfaceSamples,
    fan: BeamFan,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    let (mounts, model) = placed(args)?;
    let (field, warnings) = field(args, &model)?;
    for warning in &warnings {
        output::say_notice(warning);
    }
    let prepare_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let stations_m = stations(&field.trajectory, &mounts);
    let visible = observable(&field.mesh, &field.samples, &stations_m, SIGHT_TOLERANCE_M);
    let observable_share = visible.iter().filter(|seen| **seen).count() as f64 / visible.len() as f64;
    let observable_s = start.elapsed().as_secs_f64();
    let (seen, completeness) = see(&field, &mounts, &visible);
    let wall_s = start.elapsed().as_secs_f64();
    if let Some(path) = &args.covered_out {
        write_flags(path, &completeness.covered(MAIN_RANK))?;
    }

    let start = Instant::now();
    let baselines =
        if args.no_baselines { BTreeMap::new() } else { baselines(&field, &mounts, &visible, &seen) };
    let document = Document {
        observable_share,
        baselines,
        sensors: mounts.len(),
        columns: field.fan.columns(),
        min_range_m: field.fan.min_range_m,
        max_range_m: field.fan.max_range_m,
        samples: field.samples.len(),
        triangles: field.mesh.triangles(),
        triangles_without_area: field.mesh.degenerate(),
        area_m2: field.mesh.area_m2(),
        trajectory_length_m: field.trajectory.length_m(),
        warnings,
        prepare_s,
        wall_s,
        observable_s,
        baselines_s: start.elapsed().as_secs_f64(),
        seen,
    };
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary(&document))?;
    }
    Ok(Outcome::Done)
}

fn placed(args: &Args) -> anyhow::Result<(Vec<Mount>, SensorModel)> {
    let (mounts, listed): (Vec<Mount>, Option<String>) = match (&args.mounts, &args.mount) {
        (Some(Masters(listed)), _) => (listed.iter().map(|placement| placement.mount()).collect(), None),
        (None, Some(path)) => {
            let file = MountFile::read(path)?;
            let Some(first) = file.sensors.first() else { bail!("{}: no sensor", path.display()) };
            let other = file.sensors.iter().find(|s| !s.model.eq_ignore_ascii_case(&first.model));
            if let (Some(other), None) = (other, &args.sensor) {
                bail!(
                    "{}: {:?} is a {}, {:?} a {}: name one model for all with --sensor",
                    path.display(),
                    first.name,
                    first.model,
                    other.name,
                    other.model
                );
            }
            let model = first.model.clone();
            (file.sensors.iter().map(|entry| entry.mount()).collect(), Some(model))
        }
        (None, None) => bail!("give --mounts or --mount"),
    };
    let Some(name) = args.sensor.clone().or(listed) else { bail!("which sensor? Give --sensor") };
    Ok((mounts, catalogue::nominal(&name)?))
}

fn field(args: &Args, model: &SensorModel) -> anyhow::Result<(Field, Vec<String>)> {
    let LoadedMesh { mesh, mut warnings } = read_mesh(&args.mesh, args.mesh_unit, args.up)?;
    let trajectory = read_trajectory(&args.trajectory, args.rate)?;
    let fan = fan(args, model)?;
    if fan.scans(&trajectory) == 0 {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        bail!(
            "{}: {} s long, expected at least one revolution of {} s",
            args.trajectory.display(),
            (end_ns - start_ns) as f64 * 1e-9,
            1.0 / fan.rate_hz
        );
    }
    warnings.extend(doubts(args, &mesh, &trajectory));
    let samples = match &args.samples {
        Some(path) => {
            let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
            let points_m = read_points(&bytes).with_context(|| path.display().to_string())?;
            SurfaceSamples::new(points_m).with_context(|| path.display().to_string())?
        }
        None => SurfaceSamples::of_mesh(&mesh, args.sample_count as usize, args.seed),
    };
    let mesh = Arc::new(mesh);
    Ok((Field { scene: Scene::Mesh(mesh.clone()), mesh, trajectory, samples, fan }, warnings))
}

fn fan(args: &Args, model: &SensorModel) -> anyhow::Result<BeamFan> {
    let ouster = model.name.starts_with("os");
    let columns = args.azimuths.unwrap_or(if ouster { 1024 } else { 1800 });
    if !(args.spin_rate.is_finite() && args.spin_rate > 0.0) {
        bail!("--spin-rate {}, expected above 0", args.spin_rate);
    }
    let mut fan = BeamFan::nominal(model, columns as usize, args.spin_rate);
    fan.min_range_m = args.min_range;
    fan.max_range_m = args.max_range.unwrap_or(fan.max_range_m);
    if !(fan.min_range_m >= 0.0 && fan.max_range_m > fan.min_range_m) {
        bail!("ranges from {} to {} m, expected 0 or more, ascending", fan.min_range_m, fan.max_range_m);
    }
    Ok(fan)
}

pub(super) fn read_mesh(path: &Path, unit: Option<UnitArg>, up: Option<UpArg>) -> anyhow::Result<LoadedMesh> {
    let unit = unit.map(|unit| match unit {
        UnitArg::M => MeshUnit::Metre,
        UnitArg::Cm => MeshUnit::Centimetre,
        UnitArg::Mm => MeshUnit::Millimetre,
    });
    let up = up.map(|up| match up {
        UpArg::Z => UpAxis::Z,
        UpArg::Y => UpAxis::Y,
    });
    Ok(load_mesh(path, unit, up)?)
}

pub(super) fn read_trajectory(path: &Path, rate_hz: Option<f64>) -> anyhow::Result<Trajectory> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let parsed = match rate_hz {
        Some(rate_hz) => Trajectory::from_kitti(&text, rate_hz),
        None => Trajectory::from_tum(&text),
    };
    parsed.with_context(|| path.display().to_string())
}

/// What is odd about the trajectory, alone and with the mesh.
fn doubts(args: &Args, mesh: &Mesh, trajectory: &Trajectory) -> Vec<String> {
    let name = args.trajectory.display();
    let mut doubts = Vec::new();
    let suspicions = trajectory.suspicions(&Default::default());
    for suspicion in suspicions.iter().take(3) {
        doubts.push(format!("{name}: {suspicion}"));
    }
    if suspicions.len() > 3 {
        doubts.push(format!("{name}: {} more gaps, jumps or spins", suspicions.len() - 3));
    }
    let [low, high] = mesh.bounds_m();
    let stations_m = trajectory.stations_m(STATION_STEP_M);
    let outside = stations_m.iter().filter(|at| at.cmplt(low).any() || at.cmpgt(high).any()).count();
    if outside > 0 {
        doubts.push(format!(
            "{name}: {outside} of {} points of the path lie outside the mesh; do both use the same frame, unit and up axis?",
            stations_m.len()
        ));
    }
    doubts
}

/// Points of the path at the sensors' mean height.
fn stations(trajectory: &Trajectory, mounts: &[Mount]) -> Vec<DVec3> {
    let height_m = mounts.iter().map(|mount| mount.z_m).sum::<f64>() / mounts.len() as f64;
    trajectory.stations_m(STATION_STEP_M).into_iter().map(|at| at + height_m * DVec3::Z).collect()
}

fn see(field: &Field, mounts: &[Mount], visible: &[bool]) -> (Seen, Completeness) {
    let mut completeness = Completeness::new(&field.samples, &THRESHOLDS_M);
    let rays = field.fan.cover(&field.scene, &field.trajectory, mounts, 1, &mut completeness);
    let seen = Seen {
        completeness: by_threshold(completeness.shares()),
        completeness_of_observable: completeness.share_of(visible, MAIN_RANK),
        mounts: mounts.iter().map(numbers).collect(),
        rays,
    };
    (seen, completeness)
}

fn by_threshold(values: Vec<f64>) -> BTreeMap<String, f64> {
    THRESHOLDS_M.iter().zip(values).map(|(threshold_m, value)| (format!("{threshold_m:.2}"), value)).collect()
}

fn numbers(mount: &Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}

/// The first sensor alone, one level sensor and the best single one, both in the middle of the mounts.
fn baselines(
    field: &Field,
    mounts: &[Mount],
    visible: &[bool],
    seen: &Seen,
) -> BTreeMap<&'static str, Baseline> {
    let count = mounts.len() as f64;
    let middle = |value: fn(&Mount) -> f64| mounts.iter().map(value).sum::<f64>() / count;
    let level = Mount { x_m: 0.0, y_m: middle(|m| m.y_m), z_m: middle(|m| m.z_m), ..Mount::default() };
    let best = best_pitch(field, &level);
    let mut wanted = vec![("single_level", level), ("single_best", best)];
    if mounts.len() > 1 {
        wanted.push(("single_first", mounts[0]));
    }
    let judged = wanted.into_iter().map(|(name, mount)| {
        let (alone, _) = see(field, &[mount], visible);
        let gain = |(key, value): (&String, &f64)| (key.clone(), 100.0 * (seen.completeness[key] - value));
        let gain_points = alone.completeness.iter().map(gain).collect();
        (name, Baseline { seen: alone, gain_points })
    });
    judged.collect()
}

fn best_pitch(field: &Field, level: &Mount) -> Mount {
    let share = |mount: &Mount| {
        let mut completeness = Completeness::new(&field.samples, &THRESHOLDS_M[MAIN_RANK..=MAIN_RANK]);
        field.fan.cover(&field.scene, &field.trajectory, &[*mount], SEARCH_STEP, &mut completeness);
        completeness.shares()[0]
    };
    let tilted = SEARCH_PITCHES_DEG.map(|pitch_deg| Mount { pitch_rad: pitch_deg.to_radians(), ..*level });
    let judged = tilted.map(|mount| (share(&mount), mount));
    judged.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(*level, |(_, mount)| mount)
}

/// NumPy array file of bytes, version 1.0, whole or not at all.
fn write_flags(path: &Path, flags: &[bool]) -> anyhow::Result<()> {
    let packed: Vec<u8> = flags
        .chunks(8)
        .map(|eight| {
            eight.iter().enumerate().fold(0, |byte, (bit, flag)| byte | u8::from(*flag) << (7 - bit))
        })
        .collect();
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({},), }}", packed.len());
    // the data begin at a multiple of 64
    let padding = 63 - (10 + header.len()) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(packed);
    crate::files::write_whole(path, &bytes).with_context(|| path.display().to_string())
}

fn summary(document: &Document) -> String {
    let line = |name: &str, seen: &Seen| {
        let shares: Vec<String> =
            seen.completeness.values().map(|share| format!("{:8.3}", 100.0 * share)).collect();
        let observable =
            seen.completeness_of_observable.map_or("-".into(), |share| format!("{:.3}", 100.0 * share));
        format!("{name:14}{}  {observable:>10}\n", shares.join(""))
    };
    let mut text = format!(
        "{} sensors of {} columns, {} samples on {:.1} m2, {:.2} m of way\n\
         observable     {:.3} % of the samples\n\
         {:14}    2 cm    5 cm   10 cm  of observable at 5 cm (all in %)\n",
        document.sensors,
        document.columns,
        document.samples,
        document.area_m2,
        document.trajectory_length_m,
        100.0 * document.observable_share,
        ""
    );
    text += &line("mounts", &document.seen);
    for (name, baseline) in &document.baselines {
        text += &line(name, &baseline.seen);
    }
    text + &format!("{} rays in {:.2} s\n", document.seen.rays, document.wall_s)
}
