//! Point files: PCD, PLY, CSV, NumPy, LAS/LAZ, E57 and MCAP.
//!
//! A file appears under its name only when it is whole. Coordinates are metres in the sensor frame (x forward, y left,
//! z up), or in the rig's or the world's where a cloud was moved there. `t` is the time since the frame's first column in nanoseconds, `timestamp` the device clock in seconds; LAS
//! and E57 have GPS time.

mod bag;
mod cloud;
mod csv;
#[cfg(feature = "survey")]
mod e57;
#[cfg(feature = "mcap")]
pub mod foxglove;
#[cfg(feature = "survey")]
mod gps;
#[cfg(feature = "survey")]
mod las;
#[cfg(feature = "mcap")]
mod mcap;
mod npy;
mod pcd;
mod ply;
mod record;
mod reference_system;
mod scale;
#[cfg(any(feature = "mcap", feature = "survey"))]
mod sink;

use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use sensors::ouster::ImuSample;

#[cfg(not(all(feature = "mcap", feature = "survey")))]
use crate::base::features::left_out;
use crate::base::files;
use crate::rig::NamedFrame;
use crate::world::local_origin::LocalOrigin;

use record::RecordWriter;

pub use bag::write_metadata as write_bag_metadata;
pub(crate) use cloud::place;
pub use cloud::{Cloud, Echo, Placer, Point, Source};
pub(crate) use reference_system::ReferenceSystem;
pub(crate) use scale::FIRST_DATE_NS;
pub use scale::TimeScale;

/// A file format for points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Point Cloud Library, binary.
    Pcd,
    /// Polygon file, binary little-endian.
    Ply,
    /// ASPRS LAS 1.4.
    Las,
    /// LAS, compressed.
    Laz,
    /// ASTM E57: one scan per frame.
    E57,
    /// One line per point.
    Csv,
    /// NumPy: one structured array with the columns of the CSV file.
    Npy,
    /// MCAP with ROS 2 PointCloud2 and Imu messages, topics per sensor; into a folder: a ROS 2 bag.
    Mcap,
    /// MCAP with Foxglove PointCloud messages, a topic per sensor.
    Foxglove,
}

impl Format {
    /// By a file's extension.
    pub(crate) fn of_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        <Self as clap::ValueEnum>::from_str(&extension, true).ok()
    }

    /// The usual extension.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Pcd => "pcd",
            Self::Ply => "ply",
            Self::Las => "las",
            Self::Laz => "laz",
            Self::E57 => "e57",
            Self::Csv => "csv",
            Self::Npy => "npy",
            Self::Mcap | Self::Foxglove => "mcap",
        }
    }

    /// Whether a file keeps the points of several sensors apart.
    pub(crate) fn holds_several_sensors(self) -> bool {
        !matches!(self, Self::Pcd | Self::Ply)
    }

    /// Whether it has coordinates of 64 bits where points lie far from the origin.
    pub(crate) fn holds_far_points(self) -> bool {
        !matches!(self, Self::Pcd | Self::Mcap | Self::Foxglove)
    }

    /// Whether it says where frames are in others.
    pub(crate) fn holds_transforms(self) -> bool {
        matches!(self, Self::Mcap | Self::Foxglove)
    }

    /// Whether it says which coordinate reference system its points are in.
    pub(crate) fn holds_reference_system(self) -> bool {
        matches!(self, Self::Las | Self::Laz)
    }

    /// Whether users expect one file per frame.
    pub(crate) fn is_per_frame(self) -> bool {
        matches!(self, Self::Pcd | Self::Ply)
    }
}

/// The frame that the points of a file are in.
#[derive(Clone, Debug, Default)]
pub(crate) struct FileFrame {
    /// Its name; none where points are in their sensor's own frame.
    pub name: Option<&'static str>,
    /// Whole metres near the points, where these lie far from the origin.
    pub origin: LocalOrigin,
    /// Its coordinate reference system as well-known text.
    pub wkt: Option<String>,
}

impl FileFrame {
    /// Whether 32 bits are too few for its coordinates.
    pub(crate) fn is_far(&self) -> bool {
        self.origin != LocalOrigin::default()
    }
}

/// One kind of message, as files and streams of messages describe it.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Last part of the topic's name.
    pub topic: &'static str,
    /// Name of the schema.
    pub schema: &'static str,
    /// How the schema is written: `protobuf`, `ros2msg`.
    pub schema_encoding: &'static str,
    /// The schema itself.
    pub schema_data: fn() -> Cow<'static, [u8]>,
    /// How messages are written: `protobuf`, `cdr`.
    pub encoding: &'static str,
}

/// What a topic holds so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// With its leading slash.
    pub name: String,
    /// Type of its messages.
    pub kind: &'static str,
    /// Number of messages.
    pub messages: u32,
    /// Earliest and latest time of record, ns since 1970.
    pub log_time_ns: [u64; 2],
}

/// `/NAME/KIND`, with what a ROS name may not hold turned into underscores.
pub(crate) fn topic(id: &str, kind: &str) -> String {
    let name: String = id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let digit_first = name.starts_with(|c: char| c.is_ascii_digit());
    format!("/{}{name}/{kind}", if digit_first { "_" } else { "" })
}

/// Why a point file was not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// Without the wish to overwrite.
    #[error("{} exists already", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The disk or the format refused.
    #[error("{}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The writer's error.
        cause: Cause,
    },
}

/// What a writer says went wrong.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// What every format does.
trait CloudWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause>;

    /// Adds an inertial sample, where the format has a place for one.
    fn add_imu(&mut self, _source: &Source, _sample: &ImuSample, _host_time_ns: u64) -> Result<(), Cause> {
        Ok(())
    }

    /// Adds where frames are in others: for good, or at a time, where the format has a place for it. Times: of record and of
    /// the stamp, ns since 1970.
    fn add_frames(
        &mut self,
        _is_static: bool,
        _times_ns: [u64; 2],
        _frames: &[NamedFrame],
    ) -> Result<(), Cause> {
        Ok(())
    }

    /// What was written, by topic, where the format has topics.
    fn topics(&self) -> Vec<Topic> {
        Vec::new()
    }

    fn close(self: Box<Self>) -> Result<(), Cause>;
}

/// What a finished file holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Points of all frames.
    pub points: u64,
    /// Messages by topic, where the format has topics.
    pub topics: Vec<Topic>,
}

/// A point file being written.
pub struct Export {
    path: PathBuf,
    temporary: tempfile::NamedTempFile,
    writer: Box<dyn CloudWriter>,
    overwrite: bool,
    points: u64,
}

impl Export {
    /// Begins a file; it appears under its name when [`Export::finish`] returns.
    pub fn create(path: &Path, format: Format, overwrite: bool) -> Result<Self, ExportError> {
        Self::create_in(&FileFrame::default(), path, format, overwrite)
    }

    /// The same for points of a frame.
    pub(crate) fn create_in(
        frame: &FileFrame,
        path: &Path,
        format: Format,
        overwrite: bool,
    ) -> Result<Self, ExportError> {
        let refuse = |cause: Cause| ExportError::Write { path: path.to_owned(), cause };
        if !overwrite && path.exists() {
            return Err(ExportError::Exists { path: path.to_owned() });
        }
        let temporary = files::temporary_near(path).map_err(|error| refuse(error.into()))?;
        let file = temporary.as_file().try_clone().map_err(|error| refuse(error.into()))?;
        let writer = writer(format, file, frame).map_err(refuse)?;
        Ok(Self { path: path.to_owned(), temporary, writer, overwrite, points: 0 })
    }

    /// Adds the points of one frame.
    pub fn add(&mut self, cloud: &Cloud) -> Result<(), ExportError> {
        self.points += cloud.points.len() as u64;
        self.writer.add(cloud).map_err(|cause| ExportError::Write { path: self.path.clone(), cause })
    }

    /// Adds an inertial sample where the format has a place for one; host time in ns since 1970.
    pub fn add_imu(
        &mut self,
        source: &Source,
        sample: &ImuSample,
        host_time_ns: u64,
    ) -> Result<(), ExportError> {
        self.writer
            .add_imu(source, sample, host_time_ns)
            .map_err(|cause| ExportError::Write { path: self.path.clone(), cause })
    }

    /// Adds where frames are in others: for good, or at a time, where the format has a place for it. Times: of record and of
    /// the stamp, ns since 1970.
    pub(crate) fn add_frames(
        &mut self,
        is_static: bool,
        times_ns: [u64; 2],
        frames: &[NamedFrame],
    ) -> Result<(), ExportError> {
        self.writer
            .add_frames(is_static, times_ns, frames)
            .map_err(|cause| ExportError::Write { path: self.path.clone(), cause })
    }

    /// Ends the file and gives it its name.
    pub fn finish(self) -> Result<Written, ExportError> {
        let refuse = |cause: Cause| ExportError::Write { path: self.path.clone(), cause };
        let written = Written { points: self.points, topics: self.writer.topics() };
        self.writer.close().map_err(refuse)?;
        self.temporary.as_file().sync_all().map_err(|error| refuse(error.into()))?;
        let persisted = match self.overwrite {
            true => self.temporary.persist(&self.path),
            false => self.temporary.persist_noclobber(&self.path),
        };
        match persisted {
            Ok(_) => Ok(written),
            Err(error) if error.error.kind() == std::io::ErrorKind::AlreadyExists => {
                Err(ExportError::Exists { path: self.path.clone() })
            }
            Err(error) => Err(refuse(error.error.into())),
        }
    }
}

fn writer(format: Format, file: File, frame: &FileFrame) -> Result<Box<dyn CloudWriter>, Cause> {
    Ok(match format {
        Format::Pcd => Box::new(RecordWriter::new(file, pcd::header, false)?),
        Format::Ply => Box::new(RecordWriter::new(file, ply::header, frame.is_far())?),
        Format::Csv => Box::new(csv::CsvWriter::new(file)?),
        Format::Npy => Box::new(npy::NpyWriter::new(file)?),
        #[cfg(feature = "survey")]
        Format::Las => Box::new(las::LasWriter::new(file, false, frame.clone())),
        #[cfg(feature = "survey")]
        Format::Laz => Box::new(las::LasWriter::new(file, true, frame.clone())),
        #[cfg(feature = "survey")]
        Format::E57 => Box::new(e57::E57Writer::new(file, frame.is_far())?),
        #[cfg(feature = "mcap")]
        Format::Mcap => Box::new(mcap::McapWriter::new(file, mcap::Dialect::Ros2)?),
        #[cfg(feature = "mcap")]
        Format::Foxglove => Box::new(mcap::McapWriter::new(file, mcap::Dialect::Foxglove)?),
        #[cfg(not(feature = "survey"))]
        Format::Las | Format::Laz | Format::E57 => return Err(left_out("LAS, LAZ and E57", "survey").into()),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap | Format::Foxglove => return Err(left_out("MCAP", "mcap").into()),
    })
}

/// Flushes a buffered file.
fn flush(mut file: BufWriter<File>) -> Result<File, Cause> {
    file.flush()?;
    Ok(file.into_inner()?)
}
