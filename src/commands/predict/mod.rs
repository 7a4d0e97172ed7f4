//! `outrigger predict`

mod ideal;
mod sensing;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};

use super::experiment_args::FidelityArg;
use super::masters::Masters;
use super::scene_args::{MeshArgs, Room, SampleArgs, TrajectoryArgs};
use super::scene_file::{self, MapArgs};
use super::stage::Stage;
use super::{Context, Outcome, output, wrong_usage};
use crate::report::prediction::{Document, page};
use crate::rig::{MountFile, MountedSensor, Rig, Unit, UnitChoice};
use crate::simulate::prediction::{Site, baselines, doubts, grid_of, omissions, predict};
use crate::simulate::published::Placement;
use crate::simulate::scan::Scanner;
use crate::world::scene::LoadedScene;
use crate::world::surface::ObservableSurface;

/// Arguments of `predict`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("place").required(true),
    group = clap::ArgGroup::new("mounted").required(true),
    after_help = "Every channel is cast at its own time and azimuth with the model's beam geometry. Voxels are centred on \
                  flat walls of the scene's bounds; those of a map are its cells. The coverage file is a PLY cloud of voxel centres, in metres, with one \
                  bit per sensor; its header says the grid.\n\n\
                  Each sensor is of the model that the mount file names, as calibrated where calibrations or --sensor name \
                  a file. Beside the rig stand one level sensor and the best single one (pitch in steps of 5 degrees, \
                  searched on about 24 revolutions), of the rig's model with the most channels."
)]
pub struct Args {
    /// Sensors of the rig.
    #[arg(long, group = "mounted", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Sensors as they are: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees.
    #[arg(long, group = "mounted", allow_hyphen_values = true, requires = "sensors", value_name = "LIST")]
    mounts: Option<Masters>,
    /// Models of the sensors of --mounts: one for all, or one for each, with commas between them.
    #[arg(long, value_delimiter = ',', requires = "mounts", value_name = "MODEL,MODEL")]
    sensors: Vec<String>,
    /// Another model or the calibration of a sensor (of every one without NAME=): a name of the catalogue, Ouster
    /// metadata (.json), Velodyne calibration (.xml, .yaml), or MODEL:FILE. May be given several times.
    #[arg(long, value_name = "[NAME=]MODEL")]
    sensor: Vec<UnitChoice>,
    /// Surface (.ply, .obj, .stl, .off, .gltf or .glb), or what a map is made of: a recorded session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las, .laz, .e57 or text).
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
    ideal: ideal::IdealArgs,
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

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if args.room.is_some() {
        scene_file::ensure_none_typed(context, "the scene is a room")?;
    }
    output::check_places([&args.out, &args.report])?;
    let (units, rig) = units(args)?;
    let site = site(args, context)?;
    for notice in units.iter().filter_map(|unit| unit.notice.as_ref()).chain(&site.loaded.warnings) {
        output::say_notice(notice);
    }
    let (scene, origin) = (&site.loaded.scene, site.loaded.origin);
    let placement = args.trajectory.placement(scene, &site.trajectory, rig.mean_height_m(), origin);
    if args.ideal.ideal {
        return ideal::run(args, context, (&units, &rig), site, placement);
    }
    let scanner = args.sensing.scanner(scene, &site.trajectory, &rig, &units, args.seed)?;
    ensure_a_revolution(&scanner, &args.trajectory.name())?;
    let start = Instant::now();
    let stage = Stage::begin("looking which samples of the surface can be seen");
    let stations_m = site.trajectory.sight_stations_m(rig.mean_height_m());
    let samples = scene.mesh().map(|mesh| args.samples.samples(mesh, origin, args.seed)).transpose()?;
    let surface = samples.map(|samples| ObservableSurface::new(scene, samples, &stations_m));
    let surface = surface.as_ref();
    stage.next("casting the rays of the rig");
    let prediction = predict(&scanner, &site.grid, surface, &stage.progress());
    let wall_s = start.elapsed().as_secs_f64();
    let mut doubts = doubts(&scanner, &site, surface, &prediction);
    doubts.extend(placement.doubts);
    stage.next("looking what single sensors would see (--no-baselines leaves them out)");
    let baselines = (!args.no_baselines)
        .then(|| baselines(&scanner, &site.grid, surface, &prediction, &stage.progress()));
    stage.next("looking what could be seen from the way");
    let observable = site.observable_voxels(surface, &prediction.coverage, &stations_m);
    let mut document = Document::new(&scanner, &site, &prediction, surface, &observable);
    (document.baselines, document.wall_s) = (baselines, wall_s);
    if args.fidelity == FidelityArg::Auto {
        stage.next("measuring what the model leaves out");
        document.left_out = Some(omissions(&scanner, &site.grid));
    }
    document.total_s = start.elapsed().as_secs_f64();
    drop(stage);
    doubts.iter().for_each(|doubt| output::say_notice(doubt));
    document.warnings.extend(doubts);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    if let Some(path) = &args.out {
        let names: Vec<_> = rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        let bytes = prediction.coverage.ply(&names, origin);
        crate::base::files::write_whole(path, &bytes).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.report {
        let page = page(&document, scene, &prediction.coverage, &observable, origin, &output::again());
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    Ok(if placement.is_wrong { Outcome::DataLost } else { Outcome::Done })
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
    let (units, rig) = match (&args.mount, &args.mounts) {
        (Some(path), _) => {
            let file = MountFile::read(path)?;
            let units = file.units(&args.sensor)?;
            let rig = file.rig_of(&units);
            (units, rig)
        }
        (None, Some(mounts)) => mounted(mounts, &args.sensors, &args.sensor)?,
        (None, None) => refuse!("give --mount or --mounts"),
    };
    if args.out.is_some() && rig.sensors.len() > 32 {
        bail!("{} sensors: a coverage file has bits for 32", rig.sensors.len());
    }
    Ok((units, rig))
}

/// The sensors of `--mounts`, nominal ones of these models.
fn mounted(
    mounts: &Masters,
    models: &[String],
    calibrated: &[UnitChoice],
) -> anyhow::Result<(Vec<Unit>, Rig)> {
    if !calibrated.is_empty() {
        refuse!("--sensor is about the sensors of --mount; those of --mounts are what --sensors says");
    }
    let mounts = mounts.without_models()?;
    let models: Vec<&String> = match models {
        [model] => vec![model; mounts.len()],
        models if models.len() == mounts.len() => models.iter().collect(),
        models => refuse!(
            "--sensors names {} models and --mounts lists {} sensors: give one model for all, or one for each",
            models.len(),
            mounts.len()
        ),
    };
    let units = models.into_iter().map(|model| Ok(Unit::typed(model).map_err(wrong_usage)?.0));
    let units: Vec<Unit> = units.collect::<anyhow::Result<_>>()?;
    let sensor = |(index, (unit, placement)): (usize, (&Unit, &Placement))| MountedSensor {
        name: format!("sensor {}", index + 1),
        model: unit.model.clone(),
        mount: placement.mount(),
    };
    let sensors = units.iter().zip(&mounts).enumerate().map(sensor).collect();
    Ok((units, Rig { sensors }))
}

fn site(args: &Args, context: Context) -> anyhow::Result<Site> {
    let mut loaded = match (&args.scene, &args.room) {
        (Some(path), _) => scene_file::read(path, &args.mesh, &args.map, context)?,
        (None, Some(room)) => LoadedScene::of_room(&room.scene()),
        (None, None) => refuse!("give --scene or --room"),
    };
    if loaded.mesh.is_none() {
        context.ensure_not_typed(
            &["samples", "sample_count"],
            "is about the surface of a mesh: give one behind --scene, or leave it out",
        )?;
    }
    let (trajectory, notes) = args.trajectory.read(loaded.origin)?;
    loaded.warnings.extend(notes);
    let grid = grid_of(&loaded.scene, args.voxel)?;
    Ok(Site { loaded, trajectory, grid })
}
