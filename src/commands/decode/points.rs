//! Which points `decode` writes, and in which frame: the options, and what they mean.

use std::path::PathBuf;

use crate::commands::part::PartArgs;
use crate::commands::ranges::within;
use crate::commands::{Context, ensure_consistent};
use crate::recording::TrajectorySource;
use crate::recording::decoding::{DecodingSpec, OutputFrame};
use crate::recording::export::{Format, ReferenceSystem};
use crate::recording::registered::{
    ClipBox, Mask, PointFilter, RangeLimits, Returns, TimeOffset, TimeWindow, VoxelThinning,
};

/// Where points are wanted, and which.
#[derive(clap::Args, Debug)]
pub struct PointArgs {
    /// Frame of the points: each sensor's own; the rig's; or the world's, each return at its own time, all sensors in one cloud.
    #[arg(long, value_enum, default_value_t)]
    frame: OutputFrame,
    /// Where the rig was, for --frame world and for the transforms of an MCAP file: TUM, EuRoC, KITTI (a pose for each revolution), a bag (BAG or BAG:/TOPIC),
    /// `odometry`, or `still` for a rig that does not move. Without it the session's or the bag's own.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<TrajectorySource>,
    /// Where the sensors sit; without it the session's own, or the static transforms of a bag.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Added to the recording's times to get those of the trajectory, s; `start` lets both begin together.
    #[arg(long, value_name = "S", allow_hyphen_values = true, default_value = "0")]
    time_offset: TimeOffset,
    /// One point per voxel of this edge: the first that was measured.
    #[arg(long, value_name = "M", value_parser = within(1e-3, 1000.0))]
    voxel: Option<f64>,
    /// Only points in this box: its minimum and its maximum corner, m, in the frame of the points; behind @ the angle by which
    /// it is turned about the vertical through its middle, degrees.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z[@YAW]", allow_hyphen_values = true)]
    clip: Option<ClipBox>,
    /// Only returns within these distances from their sensor, m: 0.5..30, 0.5.. or ..30.
    #[arg(long, value_name = "A..B")]
    range: Option<RangeLimits>,
    /// Which returns of a firing.
    #[arg(long, value_enum, default_value_t)]
    returns: Returns,
    /// Leave out what travels with the rig: `operator` is a capsule of 0.45 m around the vertical from the rig's origin to 1.7 m
    /// below it; any other one by both ends of its axis and its radius, in the rig's frame, m.
    #[arg(long, value_name = "operator|X,Y,Z,X,Y,Z,R", allow_hyphen_values = true)]
    mask: Option<Mask>,
    #[command(flatten)]
    part: PartArgs,
    /// Coordinate reference system of the trajectory, written to LAS and LAZ: EPSG:N, or a file with well-known text.
    #[arg(long, value_name = "EPSG:N|FILE")]
    crs: Option<ReferenceSystem>,
}

impl PointArgs {
    /// Refuses what does not fit together, before anything is read.
    pub(super) fn check(&self, context: Context, format: Option<Format>) -> anyhow::Result<()> {
        let words = "needs --frame world or --frame rig: without it points stay in their sensor's own frame";
        if self.frame == OutputFrame::Sensor {
            context.ensure_not_typed(&["mask", "crs"], words)?;
            if !format.is_some_and(Format::holds_transforms) {
                context.ensure_not_typed(&["trajectory", "mount", "time_offset"], words)?;
            }
        }
        if self.frame == OutputFrame::Rig {
            context.ensure_not_typed(&["trajectory", "time_offset", "crs"], "needs --frame world")?;
        }
        let Some(format) = format.filter(|format| !format.holds_reference_system()) else { return Ok(()) };
        let words = format!(
            "--crs: a {} file has no place for it; expected --out NAME.las or NAME.laz",
            format.extension()
        );
        ensure_consistent([(self.crs.is_some(), words)])
    }

    /// What is asked for of the points, `format` and `out` left open.
    pub(super) fn spec(&self) -> DecodingSpec {
        let part = self.part.part();
        DecodingSpec {
            format: None,
            out: None,
            is_forced: false,
            frame: self.frame,
            trajectory: self.trajectory.clone(),
            mount: self.mount.clone(),
            time_offset: self.time_offset,
            filter: PointFilter {
                range: self.range,
                returns: self.returns,
                window: TimeWindow::new(part.from, part.to),
                mask: self.mask,
                clip: self.clip,
                voxels: self.voxel.map(VoxelThinning::new),
            },
            part,
            frames: None,
            wkt: self.crs.as_ref().map(|crs| crs.wkt.clone()),
        }
    }
}
