//! The flags about odometry.

use super::Context;
use super::ranges::within;
use crate::verify::walk::OdometrySpec;

/// How odometry samples a recording.
#[derive(clap::Args, Debug)]
pub struct OdometryArgs {
    /// Edge of a cell of odometry's map; by default a fifteenth of the median range, between 0.1 and 1 m.
    #[arg(long = "odometry-voxel", id = "odometry_voxel", value_name = "M", value_parser = within(0.01, 100.0))]
    voxel_m: Option<f64>,
    /// Returns nearer than this are not used by odometry: whoever carries the rig moves with it.
    #[arg(long = "odometry-min-range", id = "odometry_min_range", value_name = "M", default_value_t = OdometrySpec::default().nearest_m, value_parser = within(0.0, 10_000.0))]
    nearest_m: f64,
    /// Returns farther than this are not used by odometry.
    #[arg(long = "odometry-max-range", id = "odometry_max_range", value_name = "M", default_value_t = OdometrySpec::default().farthest_m, value_parser = within(1e-3, 10_000.0))]
    farthest_m: f64,
}

impl OdometryArgs {
    /// Refuses what was typed about odometry where the trajectory is not found by it.
    pub(crate) fn ensure_not_typed(context: Context) -> anyhow::Result<()> {
        context.ensure_not_typed(
            &["odometry_voxel", "odometry_min_range", "odometry_max_range"],
            "is about a trajectory by odometry, and --trajectory names another",
        )
    }

    pub(crate) fn spec(&self) -> OdometrySpec {
        OdometrySpec { voxel_m: self.voxel_m, nearest_m: self.nearest_m, farthest_m: self.farthest_m }
    }
}
