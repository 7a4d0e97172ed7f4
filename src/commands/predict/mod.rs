//! `outrigger predict`

mod document;
mod left_out;
mod page;
mod scan;
mod sensing;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};
use glam::DVec3;
use rayon::prelude::*;

use self::document::Document;
use super::evaluate::FidelityArg;
use super::ground::{MeshArgs, MeshTaken, Room, TrajectoryArgs, stations};
use super::scene_file::{self, MapArgs, MapTaken, ReadScene, map_grid};
use super::stage::Stage;
use super::surface::{SampleArgs, Surface};
use super::{Context, Outcome, output};
use crate::rig::{MountFile, Rig, Unit, UnitChoice};
use crate::simulate::scan::Scanner;
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::{Mesh, Scene};
use crate::world::trajectory::Trajectory;

/// Arguments of `predict`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("place").required(true),
    after_help = "Every channel is cast at its own time and azimuth with the model's beam geometry. Voxels are centred on \
                  flat walls of the scene's bounds; those of a map are its cells. The coverage file is a PLY cloud of voxel centres, in metres, with one \
                  bit per sensor; its header says the grid.\n\n\
                  Each sensor is of the model that the mount file names, as calibrated where calibrations or --sensor name \
                  a file. Beside the rig stand one level sensor and the best single one (pitch in steps of 5 degrees, \
                  searched on about 24 revolutions), of the rig's model with the most channels."
)]
pub struct Args {
    /// Sensors of the rig.
    #[arg(long, value_name = "FILE")]
    mount: PathBuf,
    /// Another model or the calibration of a sensor (of every one without NAME=): a name of the catalogue, Ouster
    /// metadata (.json), Velodyne calibration (.xml, .yaml), or MODEL:FILE. May be given several times.
    #[arg(long, value_name = "[NAME=]MODEL")]
    sensor: Vec<UnitChoice>,
    /// Surface (.ply, .obj, .stl, .gltf or .glb), or what a map is made of: a recorded session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las or .laz).
    #[arg(long, group = "place", value_name = "PATH")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its least and greatest corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Room>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    #[command(flatten)]
    trajectory: TrajectoryArgs,
    /// Edge of a voxel.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    voxel: f64,
    #[command(flatten)]
    sensing: sensing::SensingArgs,
    #[command(flatten)]
    samples: SampleArgs,
    /// Of noise and drop-out, and of the drawn samples.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// auto: also say what the model leaves out and what that is worth, measured on about 24 revolutions; the sensors' own
    /// columns and revolutions are all cast either way.
    #[arg(long, value_enum, default_value = "auto")]
    fidelity: FidelityArg,
    /// Leave out the single sensors beside which the rig is judged.
    #[arg(long)]
    no_baselines: bool,
    /// Coverage file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// Where the rig walks.
struct Place {
    scene: Scene,
    /// Of the scene, where it is one.
    mesh: Option<(Arc<Mesh>, MeshTaken)>,
    map: Option<MapTaken>,
    trajectory: Trajectory,
    grid: VoxelGrid,
    warnings: Vec<String>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if args.room.is_some() {
        scene_file::ensure_none_typed(context, "the scene is a room")?;
    }
    output::check_places([&args.out, &args.report])?;
    let (units, rig) = units(args)?;
    let place = place(args, context)?;
    for notice in units.iter().filter_map(|unit| unit.notice.as_ref()).chain(&place.warnings) {
        output::say_notice(notice);
    }
    let scanner = args.sensing.scanner(&place.scene, &place.trajectory, &rig, &units, args.seed)?;
    ensure_a_revolution(&scanner, &args.trajectory.name())?;
    let start = Instant::now();
    let stage = Stage::begin("looking which samples of the surface can be seen");
    let mounts: Vec<_> = rig.sensors.iter().map(|sensor| sensor.mount).collect();
    let surface = match &place.mesh {
        Some((mesh, _)) => {
            let samples = args.samples.take(mesh, args.seed)?;
            Some(Surface::new(mesh, samples, &stations(&place.trajectory, &mounts)))
        }
        None => None,
    };
    stage.next("casting the rays of the rig");
    stage.counts(scan::revolutions(&scanner), 0);
    let scanned = scan::scan(&scanner, &place.grid, surface.as_ref(), &stage);
    let wall_s = start.elapsed().as_secs_f64();
    let mut doubts = silent(&scanner, &scanned.returns);
    doubts.extend(
        surface
            .as_ref()
            .zip(place.mesh.as_ref())
            .and_then(|(surface, (mesh, _))| few_samples(surface.samples.len(), mesh.area_m2(), args.voxel)),
    );
    doubts.extend(noisy(args));
    stage.next("looking what single sensors would see (--no-baselines leaves them out)");
    let baselines = (!args.no_baselines)
        .then(|| scan::baselines(&scanner, &place.grid, surface.as_ref(), &scanned, &stage));
    stage.next("looking what could be seen from the way");
    let reachable =
        reachable(&place, surface.as_ref(), &scanned.coverage, &stations(&place.trajectory, &mounts));
    let mut document =
        Document::new(&scanner, &place, &scanned, surface.as_ref(), &reachable, baselines, wall_s);
    if args.fidelity == FidelityArg::Auto {
        stage.next("measuring what the model leaves out");
        document.left_out = Some(left_out::left_out(&scanner, &place.grid));
    }
    document.total_s = start.elapsed().as_secs_f64();
    drop(stage);
    doubts.iter().for_each(|doubt| output::say_notice(doubt));
    document.warnings.extend(doubts);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    if let Some(path) = &args.out {
        let bytes = document::ply(&scanned.coverage, &rig);
        crate::base::files::write_whole(path, &bytes).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.report {
        let page = page::page(&document, &place, &scanned.coverage, &reachable);
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    Ok(Outcome::Done)
}

fn ensure_a_revolution(scanner: &Scanner<'_>, name: &str) -> anyhow::Result<()> {
    let [start_ns, end_ns] = scanner.trajectory.time_span_ns();
    let long_s = (end_ns - start_ns) as f64 * 1e-9;
    let turn_s = scanner.spins.iter().map(|spin| 1.0 / spin.rate_hz).fold(0.0, f64::max);
    ensure!(
        long_s >= 0.999 * turn_s,
        "{name}: {long_s} s long, expected at least one revolution of {turn_s} s; the way of a rig that stands is the same \
         pose twice"
    );
    Ok(())
}

fn units(args: &Args) -> anyhow::Result<(Vec<Unit>, Rig)> {
    let file = MountFile::read(&args.mount)?;
    let units = file.units(&args.sensor)?;
    let rig = file.rig_of(&units);
    if args.out.is_some() && rig.sensors.len() > 32 {
        bail!("{} sensors: a coverage file has bits for 32", rig.sensors.len());
    }
    Ok((units, rig))
}

fn place(args: &Args, context: Context) -> anyhow::Result<Place> {
    let ReadScene { scene, mesh, map, mut warnings } = match (&args.scene, &args.room) {
        (Some(path), _) => scene_file::read(path, &args.mesh, &args.map, context)?,
        (None, Some(room)) => ReadScene { scene: room.scene(), mesh: None, map: None, warnings: Vec::new() },
        (None, None) => refuse!("give --scene or --room"),
    };
    if mesh.is_none() {
        context.ensure_not_typed(
            &["samples", "sample_count"],
            "is about the surface of a mesh: give one behind --scene, or leave it out",
        )?;
    }
    let trajectory = args.trajectory.read()?;
    let what = match &scene {
        Scene::Mesh(_) => "mesh",
        Scene::Box(_) => "room",
        Scene::Voxels(_) => "map",
    };
    warnings.extend(args.trajectory.doubts(what, scene.bounds_m(), &trajectory));
    let grid = grid(args.voxel, &scene)?;
    Ok(Place { scene, mesh, map, trajectory, grid, warnings })
}

/// Most voxels of the walls of a room, which are held one by one (half a GiB).
const MOST_WALL_CELLS: f64 = 67_108_864.0;

fn grid(voxel_m: f64, scene: &Scene) -> anyhow::Result<VoxelGrid> {
    let bounds_m = scene.bounds_m();
    let cells = (bounds_m[1] - bounds_m[0]) / voxel_m + 2.0;
    // bricks are numbered in 21 bits along each axis
    if cells.max_element() > f64::from(1 << 23) || cells.element_product() > 2f64.powi(60) {
        bail!("--voxel {voxel_m} makes {cells:.0} cells of this scene, more than can be numbered");
    }
    let grid = match scene {
        // the map's cells are where its points are: a cell of the grid is a cell of the map
        Scene::Voxels(map) => map_grid(map, voxel_m),
        Scene::Mesh(_) | Scene::Box(_) => VoxelGrid::centred_on(bounds_m, voxel_m),
    };
    let walls = grid.outer_count();
    if matches!(scene, Scene::Box(_)) && walls > MOST_WALL_CELLS {
        bail!(
            "--voxel {voxel_m} makes {walls:.0} voxels of the walls of --room, expected {MOST_WALL_CELLS:.0} at most: give a \
             larger --voxel"
        );
    }
    Ok(grid)
}

/// Sensors of which nothing came back, and why most likely.
fn silent(scanner: &Scanner<'_>, returns: &[u64]) -> Vec<String> {
    let silent = scanner.rig.sensors.iter().zip(returns).filter(|(_, returns)| **returns == 0);
    silent
        .map(|(sensor, _)| {
            format!(
                "{}: not one ray came back: is its mount in metres, is it inside the wearer or another housing, and does the \
                 scene lie within its range?",
                sensor.name
            )
        })
        .collect()
}

/// Says so where noise makes cells that the scene has nothing in.
fn noisy(args: &Args) -> Option<String> {
    args.sensing.is_noisy().then(|| {
        "--range-noise throws returns into voxels beside the surface, and these count as seen, and as voxels that can be seen: \
         both numbers are greater than without noise"
            .into()
    })
}

/// A voxel of the surface is known of if a sample falls into it: of fewer samples for each than this, many are not.
const SAMPLES_PER_VOXEL: f64 = 4.0;

/// Says so where surface samples are too few to count the voxels that can be seen.
fn few_samples(samples: usize, area_m2: f64, voxel_m: f64) -> Option<String> {
    let needed = SAMPLES_PER_VOXEL * area_m2 / (voxel_m * voxel_m);
    ((samples as f64) < needed).then(|| {
        format!(
            "{samples} samples on {area_m2:.0} m2 are too few for voxels of {voxel_m} m: more can be seen than are counted \
             as such; --sample-count {:.0} would do",
            needed.ceil()
        )
    })
}

/// The cells that could be seen from the path, ascending: the walls of a room, where a mesh has an observable sample or
/// was seen, or the occupied cells of a map that have a line of sight to the path or were seen.
fn reachable(
    place: &Place,
    surface: Option<&Surface>,
    coverage: &Coverage,
    stations_m: &[DVec3],
) -> Vec<usize> {
    let mut cells = match (surface, &place.scene) {
        (Some(surface), _) => {
            let points = surface.samples.points_m().iter().zip(&surface.visible);
            points
                .filter(|(_, visible)| **visible)
                .filter_map(|(at, _)| place.grid.index(*at))
                .collect::<Vec<usize>>()
        }
        (None, Scene::Voxels(map)) => {
            let tolerance_m = 2.0 * map.voxel_m();
            let sees = |at: &DVec3| stations_m.iter().any(|from| place.scene.sees(*from, *at, tolerance_m));
            let points_m: Vec<DVec3> = map.occupied_m().collect();
            let seen = points_m.par_iter().filter(|at| sees(at));
            seen.filter_map(|at| place.grid.index(*at)).collect()
        }
        (None, _) => return place.grid.outer_cells().collect(),
    };
    cells.extend(coverage.union_cells());
    cells.sort_unstable();
    cells.dedup();
    cells
}
