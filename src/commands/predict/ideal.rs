//! `predict --ideal`: ideal beams, every one cast in double precision.

use std::time::Instant;

use super::Args;
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, wrong_usage};
use crate::design::scene_search::{SceneWeights, WeightRule, angle_deg};
use crate::report::seen::{Document, Scored};
use crate::rig::{Rig, Unit};
use crate::simulate::prediction::Site;
use crate::simulate::view::{CastView, Precision, Sampling, Seen, Shades, View as _, ViewSite};
use crate::world::placement::Placement;

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
    /// Coefficients of the score of ideal sensors: shares of the voxels that can be seen, or as published.
    #[arg(long, value_enum, requires = "ideal", default_value_t)]
    weights: WeightRule,
}

/// What has no use for ideal sensors.
const OF_REAL_SENSORS: [&str; 15] = [
    "sample_count",
    "samples",
    "no_baselines",
    "fidelity",
    "out",
    "report",
    "seed",
    "spin_phase",
    "range_noise",
    "max_incidence",
    "reflectivity",
    "drop_out",
    "sub_rays",
    "wearer",
    "no_housings",
];

/// Casts and prints.
pub fn run(
    args: &Args,
    context: Context,
    (units, rig): (&[Unit], &Rig),
    site: Site,
    placement: Placement,
) -> anyhow::Result<Outcome> {
    context.ensure_not_typed(&OF_REAL_SENSORS, "is about real sensors, and --ideal casts ideal ones")?;
    let start = Instant::now();
    let sampling = Sampling { scan_stride: args.ideal.scan_stride, ..args.sensing.ideal() };
    let Site { loaded, trajectory, grid } = site;
    let trajectory_length_m = trajectory.length_m();
    let view_site = ViewSite { scene: loaded.scene, trajectory, grid, shades: Shades::default() };
    let view = CastView::new(view_site, units, &sampling, Precision::Double).map_err(wrong_usage)?;
    let stage = Stage::begin("casting the rays of the rig");
    let coverage = view.cover(rig);
    let counts = coverage.counts();
    let rays = view.rays(rig);
    stage.next("looking what could be seen from the trajectory");
    let weights = SceneWeights::new(args.ideal.weights, view.observable());
    drop(stage);
    placement.doubts.iter().for_each(|doubt| output::say_notice(doubt));
    let scored = Scored {
        terms: weights.terms(rig, &Seen::exact(&counts, rays)),
        reachable_voxels: weights.observable,
        min_angle_deg: angle_deg(rig),
        rays,
        origin: loaded.origin,
        trajectory_length_m,
        warnings: loaded.warnings.into_iter().chain(placement.doubts).collect(),
        wall_s: start.elapsed().as_secs_f64(),
    };
    let spin = |sensor: &crate::rig::MountedSensor| {
        let (fan, scans) = view.fan_of(&sensor.model);
        (fan.columns, scans.count)
    };
    let spins: Vec<_> = rig.sensors.iter().map(spin).collect();
    let document = Document::new(rig, &coverage, &counts, &spins, scored);
    output::print_result(context.json, &document, || document.summary(), &[])?;
    Ok(if placement.is_wrong { Outcome::DataLost } else { Outcome::Done })
}
