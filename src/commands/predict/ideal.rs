//! `predict --ideal`: ideal beams, every one cast in double precision.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;

use super::Args;
use super::ideal_sensors::{ensure_a_revolution, sensors, spins};
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, wrong_usage};
use crate::report::completeness::{Pictures, SurfaceDocument, Times};
use crate::report::seen::{Document, Elsewhere, report};
use crate::rig::{Rig, Unit};
use crate::simulate::prediction::Site;
use crate::simulate::view::{CastView, Precision, Sampling, Shades, View as _, ViewSite};
use crate::world::placement::Placement;
use crate::world::surface::{Completeness, MAIN_RANK, write_flags};

/// Arguments about ideal beams.
#[derive(clap::Args, Debug)]
pub struct IdealArgs {
    /// Cast ideal sensors: every beam from the sensor's origin at its nominal elevation, in evenly spaced columns, the first
    /// along the mount's x axis; nothing shades, nothing is noisy.
    #[arg(long)]
    pub ideal: bool,
    /// Of ideal sensors cast every N-th revolution.
    #[arg(long, value_name = "N", requires = "ideal", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    scan_stride: u32,
    /// Write which surface samples ideal sensors cover within 5 cm, one bit each as numpy.packbits does (a .npy file).
    #[arg(long, value_name = "FILE", requires = "ideal")]
    pub covered_out: Option<PathBuf>,
}

/// What has no use for ideal sensors.
const OF_REAL_SENSORS: [&str; 8] =
    ["fidelity", "out", "spin_phase", "range_noise", "reflectivity", "drop_out", "sub_rays", "no_housings"];

/// Casts and prints.
pub fn run(
    args: &Args,
    context: Context,
    (units, rig): (&[Unit], &Rig),
    site: Site,
    placement: Placement,
) -> anyhow::Result<Outcome> {
    refuse_unused(context, site.loaded.mesh.is_some())?;
    let start = Instant::now();
    let sampling = sampling(args);
    let sensors = sensors(units, rig, &site, &sampling);
    ensure_a_revolution(&sensors, &args.trajectory.name())?;
    let Site { loaded, trajectory, grid } = site;
    let view_site = ViewSite { scene: loaded.scene, trajectory, grid, shades: Shades::default() };
    let view = CastView::new(view_site, units, &sampling, Precision::Double).map_err(wrong_usage)?;
    let samples =
        sensors.scene.mesh().map(|mesh| args.samples.samples(mesh, loaded.origin, args.seed)).transpose()?;
    let prepare_s = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let stage = Stage::begin("casting the rays of the rig");
    let coverage = view.cover(rig);
    let (counts, rays) = (coverage.counts(), view.rays(rig));
    stage.next("finding what is observable from the trajectory");
    let observable = view.observable();
    let surface = samples.map(|samples| sensors.observable_surface(samples));
    let observable_s = start.elapsed().as_secs_f64();
    stage.next("casting the rays on the samples of the surface");
    let covered = surface.as_ref().map(|surface| sensors.cover(surface));
    let wall_s = start.elapsed().as_secs_f64();
    if args.baselines {
        stage.next("casting single sensors to compare with");
    }
    let of_surface =
        surface.as_ref().zip(covered).zip(loaded.mesh).map(|((surface, (shares, flags)), mesh)| {
            let (baselines, baselines_s) =
                timed(|| args.baselines.then(|| sensors.baselines(surface, &shares)));
            let times = Times { prepare_s, observable_s, baselines_s };
            (SurfaceDocument::new(&sensors, mesh, surface, shares, baselines, times), flags)
        });
    let (surface_document, flags) = of_surface.unzip();
    drop(stage);
    placement.doubts.iter().for_each(|doubt| output::say_notice(doubt));
    let elsewhere = Elsewhere {
        observable,
        weights: args.weights,
        rays,
        origin: loaded.origin,
        trajectory_length_m: sensors.trajectory.length_m(),
        quality: sampling.quality.asked(),
        warnings: [notices(units), loaded.warnings, placement.doubts].concat(),
        wall_s,
        surface: surface_document,
    };
    let document = Document::new(rig, &coverage, &counts, &spins(&view, rig), elsewhere);
    let pictured = args.report.as_ref().and(surface.as_ref());
    let pictures = pictured.map(|surface| Pictures::new(&sensors, surface, loaded.origin));
    write(args, context, &document, pictures.as_ref(), flags.as_ref())?;
    Ok(if placement.is_wrong { Outcome::DataLost } else { Outcome::Done })
}

/// The result, and the files that were asked for.
fn write(
    args: &Args,
    context: Context,
    document: &Document,
    pictures: Option<&Pictures<'_>>,
    flags: Option<&Completeness>,
) -> anyhow::Result<()> {
    let report = report(document, pictures);
    output::print_result(context.json, document, &report, &[])?;
    if let (Some(path), Some(flags)) = (&args.ideal.covered_out, flags) {
        let written = write_flags(path, &flags.covered(MAIN_RANK));
        written.with_context(|| path.display().to_string())?;
    }
    output::write_page(args.report.as_deref(), &report)
}

fn sampling(args: &Args) -> Sampling {
    let scan_stride = args.ideal.scan_stride;
    Sampling { scan_stride, ..args.sensing.ideal(args.experiment.of_scene().columns) }
}

fn notices(units: &[Unit]) -> Vec<String> {
    units.iter().filter_map(|unit| unit.notice.clone()).collect()
}

/// With the seconds that it took.
fn timed<T>(run: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    (run(), start.elapsed().as_secs_f64())
}

/// Refuses what has no use for ideal sensors.
fn refuse_unused(context: Context, is_on_mesh: bool) -> anyhow::Result<()> {
    let why = "is about real sensors, and --ideal casts ideal ones";
    context.ensure_not_typed(&OF_REAL_SENSORS, why)?;
    context.ensure_not_typed(&["operator"], why)?;
    if !is_on_mesh {
        let on_a_surface = ["baselines", "report", "covered_out"];
        context.ensure_not_typed(&on_a_surface, "is about the surface of a mesh: give one behind --scene")?;
    }
    Ok(())
}
