//! Which points `decode` writes, and in which frame: the options, and what they mean.

use std::path::{Path, PathBuf};

use super::frames::{FrameRange, OutputFrame};
use crate::commands::Context;
use crate::commands::part::PartArgs;
use crate::commands::ranges::within;
use crate::commands::recorded::axis_zeros::AxisZeros;
use crate::commands::recording::Recording;
use crate::commands::registered::mounts::Mounts;
use crate::commands::registered::trajectory;
use crate::recording::export::{FileFrame, Format, ReferenceSystem};
use crate::recording::registered::{
    ClipBox, Mask, PointFilter, RangeLimits, Registration, Returns, Target, TimeOffset, TimeWindow,
    VoxelThinning,
};

/// Where points are wanted, and which.
#[derive(clap::Args, Debug)]
pub struct PointArgs {
    /// Frame of the points: each sensor's own; the rig's; or the world's, each return at its own time, all sensors in one cloud.
    #[arg(long, value_enum, default_value_t)]
    frame: OutputFrame,
    /// Where the rig was, for --frame world and for the transforms of an MCAP file: TUM, EuRoC, KITTI (a pose for each revolution), a bag (BAG or BAG:/TOPIC), or
    /// `odometry`. Without it the session's or the bag's own.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
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
    pub(super) part: PartArgs,
    /// Coordinate reference system of the trajectory, written to LAS and LAZ: EPSG:N, or a file with well-known text.
    #[arg(long, value_name = "EPSG:N|FILE")]
    crs: Option<ReferenceSystem>,
}

impl PointArgs {
    /// Whether points leave their sensors' frames.
    pub(super) fn is_moved(&self) -> bool {
        self.frame != OutputFrame::Sensor
    }

    /// Whether some points may be left out.
    pub(super) fn is_selective(&self) -> bool {
        let has_times = self.part.from.is_some() || self.part.to.is_some();
        let has_places = self.clip.is_some() || self.mask.is_some() || self.range.is_some();
        self.frame == OutputFrame::World || has_times || has_places || !self.part.only.is_empty()
    }

    /// Whether the recording is read before it is decoded.
    pub(super) fn is_read_again(&self) -> bool {
        self.frame == OutputFrame::World || self.trajectory.is_some()
    }

    /// Refuses what does not fit together, before anything is read.
    pub(super) fn check(&self, context: Context, format: Option<Format>) -> anyhow::Result<()> {
        let words = "needs --frame world or --frame rig: without it points stay in their sensor's own frame";
        if !self.is_moved() {
            context.ensure_not_typed(&["mask", "crs"], words)?;
        }
        if !self.is_moved() && !format.is_some_and(Format::holds_transforms) {
            context.ensure_not_typed(&["trajectory", "mount", "time_offset"], words)?;
        }
        if self.frame == OutputFrame::Rig {
            context.ensure_not_typed(&["trajectory", "time_offset", "crs"], "needs --frame world")?;
        }
        if let (Some(_), Some(format)) = (&self.crs, format.filter(|format| !format.holds_reference_system()))
        {
            refuse!(
                "--crs: a {} file has no place for it; expected --out NAME.las or NAME.laz",
                format.extension()
            );
        }
        Ok(())
    }

    /// The frames that are meant, by `--frames`, `--from` and `--to`.
    pub(super) fn frames(&self, frames: Option<FrameRange>) -> Option<FrameRange> {
        let [from, to] = self.part.revolutions();
        if from.is_none() && to.is_none() {
            frames
        } else {
            Some(frames.unwrap_or_default().within(from, to))
        }
    }

    pub(super) fn trajectory(&self) -> Option<&Path> {
        self.trajectory.as_deref()
    }

    pub(super) fn time_offset(&self) -> TimeOffset {
        self.time_offset
    }

    pub(super) fn filter(&self) -> PointFilter {
        PointFilter {
            range: self.range,
            returns: self.returns,
            window: TimeWindow::new(self.part.from, self.part.to),
            mask: self.mask,
            clip: self.clip,
            voxels: self.voxel.map(VoxelThinning::new),
        }
    }

    /// The frame of the files.
    pub(super) fn file_frame(&self, registration: &Registration) -> FileFrame {
        FileFrame {
            name: registration.frame_name(),
            origin: registration.origin(),
            wkt: self.crs.as_ref().map(|crs| crs.wkt.clone()),
        }
    }

    /// Where the sensors sit, and how their points are moved; none of the first where they stay.
    pub(super) fn registration(
        &self,
        recording: &Recording,
        format: Option<Format>,
        notices: &mut Vec<String>,
    ) -> anyhow::Result<(Option<Mounts>, Registration)> {
        if !self.is_moved() {
            return self.stated(recording, format, notices);
        }
        let mut mounts = Mounts::of(recording, self.mount.as_deref(), &AxisZeros::default())?;
        let target = match self.frame {
            OutputFrame::World => {
                let found = trajectory::find(self.trajectory(), self.time_offset, recording, &mut mounts)?;
                notices.extend(found.notices);
                Target::World { trajectory: found.trajectory, offset: found.offset }
            }
            OutputFrame::Rig | OutputFrame::Sensor => Target::Rig,
        };
        notices.extend(mounts.notices.iter().cloned());
        Ok((Some(mounts), Registration::new(target, self.filter())))
    }

    /// The same where points stay in their sensors' frames, for a file that has a place for transforms.
    fn stated(
        &self,
        recording: &Recording,
        format: Option<Format>,
        notices: &mut Vec<String>,
    ) -> anyhow::Result<(Option<Mounts>, Registration)> {
        let stay = Target::Sensor;
        if !format.is_some_and(Format::holds_transforms) {
            return Ok((None, Registration::new(stay, self.filter())));
        }
        let mut mounts = Mounts::of(recording, self.mount.as_deref(), &AxisZeros::default())?;
        let own = recording.checked_session().map(|session| session.trajectory()).transpose()?.flatten();
        let target = match (&self.trajectory, own) {
            (None, None) => stay,
            (None, Some(trajectory)) => Target::SensorOnTrajectory { trajectory, offset: self.time_offset },
            (Some(path), _) => {
                let found = trajectory::find(Some(path), self.time_offset, recording, &mut mounts)?;
                notices.extend(found.notices);
                Target::SensorOnTrajectory { trajectory: found.trajectory, offset: found.offset }
            }
        };
        let is_stated = mounts.is_known() || matches!(target, Target::SensorOnTrajectory { .. });
        if is_stated {
            notices.extend(mounts.notices.iter().cloned());
        }
        Ok((is_stated.then_some(mounts), Registration::new(target, self.filter())))
    }
}
