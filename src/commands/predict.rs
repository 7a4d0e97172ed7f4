//! `outrigger predict`

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail};
use glam::DVec3;
use serde::Serialize;

use super::validate::{UnitArg, UpArg, read_mesh, read_trajectory};
use super::{Context, Outcome, output};
use crate::coverage::{Coverage, VoxelGrid};
use crate::registration::{Information, RegistrationQuality};
use crate::rig::{MountFile, Rig};
use crate::scene::{BoxScene, Scene};
use crate::simulate::occluder::Occluder;
use crate::simulate::scan::{Flaws, Scanner, Spin};
use crate::trajectory::Trajectory;

/// Every so many columns count for the registration quality.
const REGISTRATION_STEP: u64 = 8;
/// Union bitmaps are hashed up to this many cells.
const HASHED_CELLS: usize = 1 << 33;

/// Arguments of `predict`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("place").required(true),
    after_help = "Every channel is cast at its own time and azimuth with the model's beam geometry. Voxels are centred on \n\
                  flat walls of the scene's bounds. The coverage file is a PLY cloud of voxel centres, in metres, with one \n\
                  bit per sensor; its header says the grid."
)]
pub struct Args {
    /// Sensors of the rig.
    #[arg(long, value_name = "FILE")]
    mount: PathBuf,
    /// Surface: .ply, .obj, .stl, .gltf or .glb.
    #[arg(long, group = "place", value_name = "FILE")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its least and greatest corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Numbers<6>>,
    /// Unit of the mesh file [default: m, refused where the size makes that absurd].
    #[arg(long, value_name = "UNIT", requires = "scene")]
    mesh_unit: Option<UnitArg>,
    /// Axis of the mesh file that points up [default: z; y for glTF].
    #[arg(long, value_name = "AXIS", requires = "scene")]
    up: Option<UpArg>,
    /// Way of the body: TUM format, or KITTI poses with --rate.
    #[arg(long, value_name = "FILE")]
    trajectory: PathBuf,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Edge of a voxel.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    voxel: f64,
    /// Columns per revolution [default: 1024 for Ouster models, 1800 for others].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    azimuths: Option<u32>,
    /// Revolutions per second.
    #[arg(long, value_name = "HZ", default_value_t = 10.0)]
    spin_rate: f64,
    /// Encoder azimuth of every sensor when the trajectory begins.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    spin_phase: f64,
    /// Least range that is reported [default: the model's].
    #[arg(long, value_name = "M")]
    min_range: Option<f64>,
    /// Greatest range that is reported [default: the model's].
    #[arg(long, value_name = "M")]
    max_range: Option<f64>,
    /// Standard deviation of a range.
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    range_noise: f64,
    /// Surfaces seen more obliquely return nothing.
    #[arg(long, value_name = "DEG")]
    max_incidence: Option<f64>,
    /// Share of returns lost at random.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    drop_out: f64,
    /// Rays spread over each beam's divergence; the median range counts.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=64))]
    sub_rays: u32,
    /// Who carries the rig: "x,y,z,x,y,z,radius", the ends of a capsule in the body frame (x forward, y left), m.
    #[arg(long, allow_hyphen_values = true, value_name = "CAPSULE")]
    wearer: Option<Numbers<7>>,
    /// Let beams pass through the other sensors.
    #[arg(long)]
    no_housings: bool,
    /// Of noise and drop-out.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Coverage file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// So many finite numbers, separated by commas.
#[derive(Clone, Copy, Debug)]
struct Numbers<const N: usize>([f64; N]);

impl<const N: usize> FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> =
            text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.ok_or("every part must be a finite number")?;
        let found = numbers.len();
        numbers.try_into().map(Self).map_err(|_| format!("{found} numbers, expected {N}"))
    }
}

/// The document that `predict` prints.
#[derive(Serialize)]
struct Document {
    sensors: Vec<SensorDocument>,
    unique_voxels: u64,
    overlap_ratio: f64,
    rays: u64,
    returns: u64,
    /// Returns beyond the scene's bounds by more than half a voxel: range noise.
    outside_grid: u64,
    grid: GridDocument,
    /// Union bitmap; null for grids of more than 2^33 cells.
    coverage_sha256: Option<String>,
    registration: Option<RegistrationQuality>,
    trajectory_length_m: f64,
    warnings: Vec<String>,
    wall_s: f64,
}

#[derive(Serialize)]
struct SensorDocument {
    name: String,
    model: String,
    rays: u64,
    returns: u64,
    voxels: u64,
    unique_voxels: u64,
}

#[derive(Serialize)]
struct GridDocument {
    origin_m: [f64; 3],
    voxel_m: f64,
    cells: [usize; 3],
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let rig = MountFile::read(&args.mount)?.rig()?;
    if args.out.is_some() && rig.sensors.len() > 32 {
        bail!("{} sensors: a coverage file has bits for 32", rig.sensors.len());
    }
    let (scene, warnings) = scene(args)?;
    let trajectory = read_trajectory(&args.trajectory, args.rate)?;
    for warning in &warnings {
        output::say_notice(warning);
    }
    let grid = grid(args, &scene)?;
    let scanner = scanner(args, &scene, &trajectory, &rig)?;
    let start = Instant::now();
    let mut coverage = Coverage::new(grid, rig.sensors.len());
    let (returns, registration) = scan(&scanner, &mut coverage);
    let wall_s = start.elapsed().as_secs_f64();
    if let Some(path) = &args.out {
        let bytes = ply(&coverage, &rig);
        crate::files::write_whole(path, &bytes).with_context(|| path.display().to_string())?;
    }
    let document = document(&scanner, &coverage, &returns, registration, warnings, wall_s);
    if context.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&summary(&document))?;
    }
    Ok(Outcome::Done)
}

fn scene(args: &Args) -> anyhow::Result<(Scene, Vec<String>)> {
    match (&args.scene, &args.room) {
        (Some(path), _) => {
            let loaded = read_mesh(path, args.mesh_unit, args.up)?;
            Ok((Scene::Mesh(Arc::new(loaded.mesh)), loaded.warnings))
        }
        (None, Some(Numbers([x0, y0, z0, x1, y1, z1]))) => {
            let (low, high) = (DVec3::new(*x0, *y0, *z0), DVec3::new(*x1, *y1, *z1));
            if !low.cmplt(high).all() {
                bail!("--room: the first corner must lie below the second in x, y and z");
            }
            Ok((Scene::Box(BoxScene::closed(low, high)), Vec::new()))
        }
        (None, None) => bail!("give --scene or --room"),
    }
}

fn grid(args: &Args, scene: &Scene) -> anyhow::Result<VoxelGrid> {
    let voxel_m = args.voxel;
    if !(voxel_m.is_finite() && voxel_m > 0.0) {
        bail!("--voxel {voxel_m}, expected above 0");
    }
    let bounds_m = scene.bounds_m();
    let cells = (bounds_m[1] - bounds_m[0]) / voxel_m + 2.0;
    // bricks are numbered in 21 bits along each axis
    if cells.max_element() > f64::from(1 << 23) || cells.element_product() > 2f64.powi(60) {
        bail!("--voxel {voxel_m} makes {cells:.0} cells of this scene, more than can be numbered");
    }
    Ok(VoxelGrid::centred_on(bounds_m, voxel_m))
}

fn scanner<'a>(
    args: &Args,
    scene: &'a Scene,
    trajectory: &'a Trajectory,
    rig: &'a Rig,
) -> anyhow::Result<Scanner<'a>> {
    for (name, value) in [
        ("--spin-rate", args.spin_rate),
        ("--max-incidence", args.max_incidence.unwrap_or(90.0)),
        ("--max-range", args.max_range.unwrap_or(1.0)),
    ] {
        if !(value.is_finite() && value > 0.0) {
            bail!("{name} {value}, expected above 0");
        }
    }
    for (name, value) in [("--range-noise", args.range_noise), ("--min-range", args.min_range.unwrap_or(0.0))]
    {
        if !(value.is_finite() && value >= 0.0) {
            bail!("{name} {value}, expected 0 or more");
        }
    }
    if !(args.spin_phase.is_finite() && (0.0..1.0).contains(&args.drop_out)) {
        bail!("--spin-phase takes an angle, --drop-out a share of at least 0 and below 1");
    }
    let mut scanner = Scanner::new(scene, trajectory, rig, Spin::default());
    for (spin, sensor) in scanner.spins.iter_mut().zip(&rig.sensors) {
        let columns = if sensor.model.name.starts_with("os") { 1024 } else { 1800 };
        *spin = Spin {
            rate_hz: args.spin_rate,
            columns: args.azimuths.unwrap_or(columns),
            phase_rad: args.spin_phase.to_radians(),
            clockwise: true,
        };
    }
    if args.no_housings {
        scanner.occluders.iter_mut().for_each(Vec::clear);
    }
    if let Some(Numbers([x0, y0, z0, x1, y1, z1, radius_m])) = args.wearer {
        if radius_m <= 0.0 {
            bail!("--wearer: the radius is {radius_m}, expected above 0");
        }
        let (from_m, to_m) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
        let wearer = Occluder::Capsule { from_m, to_m, radius_m };
        scanner.occluders.iter_mut().for_each(|solids| solids.push(wearer));
    }
    scanner.flaws = Flaws {
        min_range_m: args.min_range,
        max_range_m: args.max_range,
        range_noise_m: args.range_noise,
        max_incidence_rad: args.max_incidence.map(f64::to_radians),
        drop_out: args.drop_out,
        sub_rays: args.sub_rays,
    };
    scanner.seed = args.seed;
    Ok(scanner)
}

/// Fills the coverage; returns by sensor, and how well whole revolutions are tied down.
fn scan(scanner: &Scanner<'_>, coverage: &mut Coverage) -> (Vec<u64>, Option<RegistrationQuality>) {
    let mut returns = vec![0; scanner.rig.sensors.len()];
    let mut scans: Vec<Information> = Vec::new();
    let start_ns = scanner.trajectory.time_span_ns()[0];
    scanner.for_each_column(|sensor, column| {
        returns[sensor] += column.returns.len() as u64;
        for back in &column.returns {
            coverage.add(sensor, back.point_m);
        }
        if column.column % REGISTRATION_STEP != 0 {
            return;
        }
        let spin = &scanner.spins[sensor];
        let turn = column.column / u64::from(spin.columns);
        let turn_ns = start_ns + spin.offset_ns(turn * u64::from(spin.columns));
        let Some(world_from_body) = scanner.trajectory.at(turn_ns) else { return };
        let turn = turn as usize;
        scans.resize(scans.len().max(turn + 1), Information::default());
        for back in &column.returns {
            scans[turn].add(back.point_m - world_from_body.translation_m, back.normal);
        }
    });
    // the last revolution is not a whole one
    if scans.len() > 1 {
        scans.pop();
    }
    (returns, RegistrationQuality::of_scans(&scans))
}

fn document(
    scanner: &Scanner<'_>,
    coverage: &Coverage,
    returns: &[u64],
    registration: Option<RegistrationQuality>,
    warnings: Vec<String>,
    wall_s: f64,
) -> Document {
    let counts = coverage.counts();
    let sensor = |(index, sensor): (usize, &crate::rig::MountedSensor)| SensorDocument {
        name: sensor.name.clone(),
        model: sensor.model.name.clone(),
        rays: scanner.columns(index) * sensor.model.channels() as u64,
        returns: returns[index],
        voxels: counts.per_sensor[index],
        unique_voxels: counts.unique_per_sensor[index],
    };
    let sensors: Vec<_> = scanner.rig.sensors.iter().enumerate().map(sensor).collect();
    let grid = coverage.grid();
    Document {
        unique_voxels: counts.union,
        overlap_ratio: counts.overlap_ratio(),
        rays: sensors.iter().map(|sensor| sensor.rays).sum(),
        returns: returns.iter().sum(),
        outside_grid: coverage.outside(),
        grid: GridDocument { origin_m: grid.origin_m.to_array(), voxel_m: grid.voxel_m, cells: grid.cells },
        coverage_sha256: (grid.len() <= HASHED_CELLS).then(|| coverage.union_sha256()),
        registration,
        trajectory_length_m: scanner.trajectory.length_m(),
        warnings,
        wall_s,
        sensors,
    }
}

/// Voxel centres with one bit per sensor.
fn ply(coverage: &Coverage, rig: &Rig) -> Vec<u8> {
    let grid = coverage.grid();
    let cells = coverage.union_cells();
    let [x, y, z] = grid.origin_m.to_array();
    let [nx, ny, nz] = grid.cells;
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\n\
         comment outrigger coverage, world frame, metres\n\
         comment grid origin {x} {y} {z} voxel {} cells {nx} {ny} {nz}\n",
        grid.voxel_m
    );
    for (bit, sensor) in rig.sensors.iter().enumerate() {
        let name: String = sensor.name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        text += &format!("comment sensors bit {bit}: {name}\n");
    }
    text += &format!(
        "element vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty uint sensors\nend_header\n",
        cells.len()
    );
    let mut bytes = text.into_bytes();
    for cell in cells {
        for value in grid.centre_m(cell).to_array() {
            bytes.extend(value.to_le_bytes());
        }
        let seen_by = |mask, sensor| mask | u32::from(coverage.contains(sensor, cell)) << sensor;
        bytes.extend((0..rig.sensors.len()).fold(0u32, seen_by).to_le_bytes());
    }
    bytes
}

fn summary(document: &Document) -> String {
    let mut text = format!(
        "{:.2} m of way, {} rays, {} returns\n\
         voxels seen    {} of {} m, {:.2} % of them by two sensors or more\n\
         sensor                 model        returns   voxels    alone\n",
        document.trajectory_length_m,
        document.rays,
        document.returns,
        document.unique_voxels,
        document.grid.voxel_m,
        100.0 * document.overlap_ratio,
    );
    for sensor in &document.sensors {
        text += &format!(
            "{:22} {:10}{:10}{:9}{:9}\n",
            sensor.name, sensor.model, sensor.returns, sensor.voxels, sensor.unique_voxels
        );
    }
    if let Some(quality) = &document.registration {
        text += &format!(
            "registration   least translation eigenvalue per hit: median {:.4}, 5th percentile {:.4}; {:.1} % of {} scans \
             have a loose direction\n",
            quality.translation_median,
            quality.translation_p5,
            100.0 * quality.degenerate_share,
            quality.scans
        );
    }
    text + &format!("{:.2} s\n", document.wall_s)
}
