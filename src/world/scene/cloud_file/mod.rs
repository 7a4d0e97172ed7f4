//! Point cloud files: PLY, PCD, LAS, LAZ, E57 and text to points in metres, with what a file says about who saw them.
//!
//! Where a point was seen from is read from the properties `vp_x`, `vp_y`, `vp_z` (as the Point Cloud Library names
//! them), when from `timestamp`, `time` or `gps_time`, in seconds. The viewpoint in the header of a PCD file is passed
//! over: programs write the origin there when they know of none. A scan of an E57 file was seen from where the file places it.

#[cfg(feature = "survey")]
mod e57_file;
#[cfg(feature = "survey")]
mod guard;
#[cfg(feature = "survey")]
mod las_file;
mod lzf;
mod pcd;
mod ply;
mod xyz;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::mesh_file::{Fault, makes_surface, single_step};
use crate::base::files::ending;

/// One point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// Where it is, m; no numbers where the sensor measured nothing.
    pub position_m: DVec3,
    /// Where the sensor was, m.
    pub seen_from_m: Option<DVec3>,
    /// When it was seen, s, on the clock of the file.
    pub time_s: Option<f64>,
}

/// Endings of the files that can be read.
pub const CLOUD_ENDINGS: &str = ".ply (without faces), .pcd, .las, .laz, .e57, .xyz, .txt, .asc, .csv, .pts";

/// Whether a file is a point cloud, and not a mesh, by its ending; a PLY file by what its header lists.
pub fn is_cloud(path: &Path) -> bool {
    match ending(path).as_str() {
        "pcd" | "las" | "laz" | "e57" | "xyz" | "txt" | "asc" | "csv" | "pts" => true,
        "ply" => ply_without_faces(path),
        _ => false,
    }
}

/// Reads a cloud, point by point; what is odd about it.
///
/// # Errors
/// A file that cannot be read or is malformed (with line, byte or element), or holds no point.
pub fn read_cloud(path: &Path, mut take: impl FnMut(CloudPoint)) -> Result<Vec<String>, CloudFileError> {
    let unreadable = |source| CloudFileError::Unreadable { path: path.to_owned(), source };
    let malformed = |fault| CloudFileError::Malformed { path: path.to_owned(), fault };
    let (mut points, mut steps) = (0_u64, Steps::default());
    let mut count = |point: CloudPoint| {
        points += 1;
        steps.add(point.position_m);
        take(point);
    };
    let content = || crate::base::files::read(path).map_err(unreadable);
    let file = || crate::base::files::open(path).map_err(unreadable);
    let notes = match ending(path).as_str() {
        "ply" => ply::read(&content()?, &mut count).map(|()| Vec::new()),
        "pcd" => pcd::read(&content()?, &mut count).map(|()| Vec::new()),
        "xyz" | "txt" | "asc" | "csv" | "pts" => xyz::read(&content()?, &mut count).map(|()| Vec::new()),
        "las" | "laz" => las_file::read(file()?, &mut count).map(|()| Vec::new()),
        "e57" => e57_file::read(file()?, &mut count),
        _ => return Err(CloudFileError::UnknownFormat { path: path.to_owned() }),
    };
    let mut notes = notes.map_err(malformed)?;
    if points == 0 {
        return Err(CloudFileError::Empty { path: path.to_owned() });
    }
    notes.extend(steps.note());
    Ok(notes.into_iter().map(|note| format!("{}: {note}", path.display())).collect())
}

/// Steps of coordinates that are stored in 32 bits, whatever the format says.
#[derive(Default)]
struct Steps {
    largest_m: DVec3,
    is_fine: bool,
    is_fractional: bool,
}

impl Steps {
    /// Steps up to this are as good as none, m.
    const FINE_M: f64 = 1e-3;

    fn add(&mut self, position_m: DVec3) {
        if self.is_fine || !position_m.is_finite() {
            return;
        }
        self.largest_m = self.largest_m.max(position_m.abs());
        for value in position_m.to_array() {
            let (step, off) = (single_step(value), (f64::from(value as f32) - value).abs());
            // what is printed with few digits, and near zero, says nothing
            self.is_fine |= step > Self::FINE_M && off > 0.02 * step;
            self.is_fractional |= step > Self::FINE_M && value.fract() != 0.0;
        }
    }

    fn note(&self) -> Option<String> {
        let at_m = self.largest_m.max_element();
        let step_m = single_step(at_m);
        (!self.is_fine && self.is_fractional && step_m > Self::FINE_M).then(|| {
            format!(
                "its coordinates are 32-bit floats, in steps of {step_m} m at {at_m:.1e} m: points are that far off; write \
                 them with 64 bits, or nearer to the origin"
            )
        })
    }
}

/// Stands in for the reader that was left out.
#[cfg(not(feature = "survey"))]
mod las_file {
    use std::fs::File;

    use super::{CloudPoint, Fault};

    pub(super) fn read(_: File, _: &mut dyn FnMut(CloudPoint)) -> Result<(), Fault> {
        Err(Fault::at("LAS", crate::base::features::left_out("LAS and LAZ", "survey")))
    }
}

/// Stands in for the reader that was left out.
#[cfg(not(feature = "survey"))]
mod e57_file {
    use std::fs::File;

    use super::{CloudPoint, Fault};

    pub(super) fn read(_: File, _: &mut dyn FnMut(CloudPoint)) -> Result<Vec<String>, Fault> {
        Err(Fault::at("E57", crate::base::features::left_out("E57", "survey")))
    }
}

fn ply_without_faces(path: &Path) -> bool {
    const LONGEST_HEADER: u64 = 1 << 16;
    let mut start = Vec::new();
    let read =
        crate::base::files::open(path).and_then(|file| file.take(LONGEST_HEADER).read_to_end(&mut start));
    let Some(end) = start.windows(10).position(|window| window == b"end_header") else { return false };
    let header = String::from_utf8_lossy(&start[..end]);
    let makes_surface = header.lines().any(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        matches!(words[..], ["element", name, count] if makes_surface(name, count.parse().unwrap_or(1)))
    });
    read.is_ok() && !makes_surface
}

/// Numbers of a point, as files name them.
const NAMES: [&str; 9] = ["x", "y", "z", "vp_x", "vp_y", "vp_z", "timestamp", "time", "gps_time"];

/// Which of the numbers a property is; other programs write some of them differently.
fn slot(name: &str) -> Option<usize> {
    let name = name.strip_prefix("scalar_").unwrap_or(name).to_ascii_lowercase();
    let name = if name == "gpstime" { "gps_time" } else { &name };
    NAMES.iter().position(|known| *known == name)
}

/// A point from its numbers; what is missing is NaN.
fn point(n: &[f64; 9]) -> CloudPoint {
    let seen_from_m = DVec3::new(n[3], n[4], n[5]);
    CloudPoint {
        position_m: DVec3::new(n[0], n[1], n[2]),
        seen_from_m: seen_from_m.is_finite().then_some(seen_from_m),
        time_s: n[6..].iter().copied().find(|time_s| time_s.is_finite()),
    }
}

/// Why a file is no cloud.
#[derive(Debug, thiserror::Error)]
pub enum CloudFileError {
    /// The system does not give it.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The name says no known format.
    #[error("{}: no point cloud by its name; known are {CLOUD_ENDINGS}", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// Against its format.
    #[error("{}: {fault}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What and where.
        fault: Fault,
    },
    /// Well-formed, but without a point.
    #[error("{}: the cloud holds no point", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

#[cfg(test)]
mod tests;
