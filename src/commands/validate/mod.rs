//! `outrigger validate`

mod document;
mod field;
mod flags;
mod page;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;

use self::document::Document;
use super::evaluate::Masters;
use super::ground::{MeshArgs, TrajectoryArgs};
use super::stage::Stage;
use super::surface::{MAIN_RANK, SampleArgs};
use super::{Context, Outcome, output};
use crate::rig::UnitChoice;

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
    /// Surface: .ply, .obj, .stl, .gltf or .glb.
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
    let placed = field::placed(args)?;
    let (field, warnings) = field::field(args, &placed)?;
    for warning in &warnings {
        output::say_notice(warning);
    }
    let prepare_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let stage = Stage::begin("looking what could be seen from the way");
    let surface = field.surface(&placed);
    let observable_s = start.elapsed().as_secs_f64();
    stage.next("casting the rays of the sensors");
    let (seen, completeness) = field.see(&placed, &surface);
    let wall_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    stage.next("looking what single sensors would see (--no-baselines leaves them out)");
    let baselines = (!args.no_baselines).then(|| field.baselines(&placed, &surface, &seen));
    let rig = field::rig(&placed);
    let document = Document {
        observable_share: surface.observable_share(),
        baselines,
        sensors: placed.len(),
        columns: field.fans.iter().map(|fan| fan.columns()).max().unwrap_or(0),
        min_range_m: field.fans[0].min_range_m,
        max_range_m: field.fans.iter().map(|fan| fan.max_range_m).fold(0.0, f64::max),
        samples: surface.samples.len(),
        mesh: field.taken.clone(),
        triangles: field.mesh.triangles(),
        triangles_without_area: field.mesh.degenerate(),
        area_m2: field.mesh.area_m2(),
        trajectory_length_m: field.trajectory.length_m(),
        tied: field.tied(&placed),
        violations: rig.clearances(0.0).into_iter().filter(|pair| !pair.is_kept()).collect(),
        touching: rig.touching(),
        warnings,
        prepare_s,
        wall_s,
        observable_s,
        baselines_s: start.elapsed().as_secs_f64(),
        seen,
    };
    drop(stage);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    if let Some(path) = &args.covered_out {
        flags::write_flags(path, &completeness.covered(MAIN_RANK))?;
    }
    if let Some(path) = &args.report {
        let page = page::page(&document, &field, &placed, &surface);
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    Ok(Outcome::Done)
}
