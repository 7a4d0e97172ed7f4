//! Which points of a recording are written, in which frame, and where to.

use std::path::PathBuf;

use super::frames::{FrameRange, OutputFrame};
use crate::recording::TrajectorySource;
use crate::recording::export::{FileFrame, Format};
use crate::recording::part::Part;
use crate::recording::registered::{PointFilter, Registration, TimeOffset};

/// What is asked for.
pub(crate) struct DecodingSpec {
    pub format: Option<Format>,
    pub out: Option<PathBuf>,
    /// Files that exist are overwritten.
    pub is_forced: bool,
    pub frame: OutputFrame,
    /// Where the rig was, for points in the world's frame.
    pub trajectory: Option<TrajectorySource>,
    pub mount: Option<PathBuf>,
    pub time_offset: TimeOffset,
    pub filter: PointFilter,
    pub part: Part,
    pub frames: Option<FrameRange>,
    /// Coordinate reference system of the trajectory, as well-known text.
    pub wkt: Option<String>,
}

impl DecodingSpec {
    /// Whether points leave their sensors' frames.
    pub(crate) fn is_moved(&self) -> bool {
        self.frame != OutputFrame::Sensor
    }

    /// Whether the recording is read before it is decoded.
    pub(crate) fn is_read_again(&self) -> bool {
        self.frame == OutputFrame::World || self.trajectory.is_some()
    }

    /// The format that was asked for, or that the name of the file says.
    pub(crate) fn file_format(&self) -> Option<Format> {
        self.format.or_else(|| self.out.as_deref().and_then(Format::of_path))
    }

    /// Whether some points may be left out.
    pub(super) fn is_selective(&self) -> bool {
        let has_times = self.part.from.is_some() || self.part.to.is_some();
        let PointFilter { clip, mask, range, .. } = &self.filter;
        let has_places = clip.is_some() || mask.is_some() || range.is_some();
        self.frame == OutputFrame::World || has_times || has_places || !self.part.only.is_empty()
    }

    /// The frames that are meant, by their numbers and by the part.
    pub(super) fn wanted_frames(&self) -> Option<FrameRange> {
        let [from, to] = self.part.revolutions();
        if from.is_none() && to.is_none() {
            self.frames
        } else {
            Some(self.frames.unwrap_or_default().within(from, to))
        }
    }

    /// The frame of the files.
    pub(super) fn file_frame(&self, registration: &Registration) -> FileFrame {
        FileFrame { name: registration.frame_name(), origin: registration.origin(), wkt: self.wkt.clone() }
    }
}
