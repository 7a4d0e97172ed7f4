//! `predict --scene` and `--room`.

use std::time::Instant;

use anyhow::{Context as _, ensure};

use super::scene_rig::units;
use super::{Args, ideal};
use crate::commands::experiment_args::FidelityArg;
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, scene_file};
use crate::report::prediction::{Document, Pictures, report};
use crate::simulate::prediction::{Site, baselines, doubts, grid_of, omissions, predict};
use crate::simulate::scan::Scanner;
use crate::world::surface::ObservableSurface;

/// Edge of a voxel where none is given, m.
const DEFAULT_VOXEL_M: f64 = 0.1;

/// Casts and prints.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if args.room.is_some() {
        scene_file::ensure_none_typed(context, "the scene is a room")?; // before any file is read
    }
    if !args.trajectory.is_file() {
        context.ensure_not_typed(&["rate"], "is about a trajectory in KITTI format, which is not given")?;
    }
    args.sensing.check()?;
    let (units, rig) = units(args)?;
    let site = site(args, context)?;
    for notice in units.iter().filter_map(|unit| unit.notice.as_ref()).chain(&site.loaded.warnings) {
        output::say_notice(notice);
    }
    args.sensing.quality.ensure_known_in(&site.loaded.scene)?;
    let (scene, origin) = (&site.loaded.scene, site.loaded.origin);
    let placement = args.trajectory.placement(scene, &site.trajectory, rig.mean_height_m(), origin);
    if args.ideal.ideal {
        return ideal::run(args, context, (&units, &rig), site, placement);
    }
    let scanner = args.sensing.scanner(
        scene,
        &site.trajectory,
        (&rig, &units),
        args.experiment.of_scene().columns,
        args.seed,
    )?;
    ensure_a_revolution(&scanner, &args.trajectory.name())?;
    let start = Instant::now();
    let stage = Stage::begin("finding the observable samples of the surface");
    let stations_m = site.trajectory.sight_stations_m(rig.mean_height_m());
    let samples = scene.mesh().map(|mesh| args.samples.samples(mesh, origin, args.seed)).transpose()?;
    let surface = samples.map(|samples| ObservableSurface::new(scene, samples, &stations_m));
    let surface = surface.as_ref();
    stage.next("casting the rays of the rig");
    let prediction = predict(&scanner, &site.grid, surface, &stage.progress());
    let wall_s = start.elapsed().as_secs_f64();
    let mut doubts = doubts(&scanner, &site, surface, &prediction);
    doubts.extend(placement.doubts);
    let baselines = args.baselines.then(|| {
        stage.next("casting single sensors to compare with");
        baselines(&scanner, &site.grid, surface, &stage.progress())
    });
    stage.next("finding what is observable from the trajectory");
    let observable = site.observable_voxels(surface, &prediction.coverage, &stations_m);
    let mut document = Document::new(&scanner, &site, &prediction, surface, &observable, args.weights);
    (document.baselines, document.wall_s) = (baselines, wall_s);
    document.quality = args.sensing.quality.quality().asked();
    if args.fidelity != Some(FidelityArg::Given) {
        stage.next("measuring what the model leaves out");
        document.left_out = Some(omissions(&scanner, &site.grid));
    }
    document.total_s = start.elapsed().as_secs_f64();
    drop(stage);
    doubts.iter().for_each(|doubt| output::say_notice(doubt));
    document.warnings.extend(doubts);
    let pictures =
        Pictures { scanner: &scanner, coverage: &prediction.coverage, observable: &observable, origin };
    write(args, context, &document, &pictures)?;
    Ok(if placement.is_wrong { Outcome::DataLost } else { Outcome::Done })
}

/// The result, and the files that were asked for.
fn write(args: &Args, context: Context, document: &Document, pictures: &Pictures<'_>) -> anyhow::Result<()> {
    let report = report(document, args.report.as_ref().map(|_| pictures));
    output::print_result(context.json, document, &report, &[])?;
    if let Some(path) = &args.out {
        let names: Vec<_> = pictures.scanner.rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        let bytes = pictures.coverage.ply(&names, pictures.origin);
        crate::base::files::write_whole(path, &bytes).with_context(|| path.display().to_string())?;
    }
    output::write_page(args.report.as_deref(), &report)
}

fn ensure_a_revolution(scanner: &Scanner<'_>, name: &str) -> anyhow::Result<()> {
    let [start_ns, end_ns] = scanner.trajectory.time_span_ns();
    let long_s = (end_ns - start_ns) as f64 * 1e-9;
    let turn_s = scanner.spins.iter().map(|spin| 1.0 / spin.rate_hz).fold(0.0, f64::max);
    ensure!(
        long_s >= 0.999 * turn_s,
        "{name}: {long_s} s long, expected at least one revolution of {turn_s} s; of a rig that does not move \
         the trajectory is the same pose twice"
    );
    Ok(())
}

fn site(args: &Args, context: Context) -> anyhow::Result<Site> {
    let scene = args.scene.as_deref();
    let loaded = scene_file::read_or_room(scene, args.room, &args.mesh, &args.map, context)?;
    let mut loaded = loaded.context("give --scene or --room")?;
    if loaded.mesh.is_none() {
        context.ensure_not_typed(
            &["samples", "sample_count"],
            "is about the surface of a mesh: give one behind --scene, or leave it out",
        )?;
    }
    let (trajectory, notes) = args.trajectory.read(&loaded.scene, loaded.origin)?;
    loaded.warnings.extend(notes);
    let voxel_m = args.experiment.of_scene().voxel_m.unwrap_or(DEFAULT_VOXEL_M);
    let grid = grid_of(&loaded.scene, voxel_m)?;
    Ok(Site { loaded, trajectory, grid })
}
