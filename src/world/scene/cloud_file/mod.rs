//! Point cloud files: PLY, PCD, LAS and LAZ to points in metres, with what a file says about who saw them.
//!
//! Where a point was seen from is read from the properties `vp_x`, `vp_y`, `vp_z` (as the Point Cloud Library names
//! them), when from `timestamp`, `time` or `gps_time`, in seconds. The viewpoint in the header of a PCD file is passed
//! over: programs write the origin there when they know of none.

#[cfg(feature = "survey")]
mod las_file;
mod lzf;
mod pcd;
mod ply;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::mesh_file::Fault;
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
pub const CLOUD_ENDINGS: &str = ".ply (without faces), .pcd, .las, .laz";

/// Whether a file is a point cloud, and not a mesh, by its ending; a PLY file by what its header lists.
pub fn is_cloud(path: &Path) -> bool {
    match ending(path).as_str() {
        "pcd" | "las" | "laz" => true,
        "ply" => ply_without_faces(path),
        _ => false,
    }
}

/// Reads a cloud, point by point.
///
/// # Errors
/// A file that cannot be read or is malformed (with line, byte or element), or holds no point.
pub fn read_cloud(path: &Path, mut take: impl FnMut(CloudPoint)) -> Result<(), CloudFileError> {
    let unreadable = |source| CloudFileError::Unreadable { path: path.to_owned(), source };
    let malformed = |fault| CloudFileError::Malformed { path: path.to_owned(), fault };
    let mut points = 0_u64;
    let mut count = |point: CloudPoint| {
        points += 1;
        take(point);
    };
    match ending(path).as_str() {
        "ply" => {
            ply::read(&crate::base::files::read(path).map_err(unreadable)?, &mut count).map_err(malformed)?
        }
        "pcd" => {
            pcd::read(&crate::base::files::read(path).map_err(unreadable)?, &mut count).map_err(malformed)?
        }
        "las" | "laz" => {
            let file = crate::base::files::open(path).map_err(unreadable)?;
            las_file::read(file, &mut count).map_err(malformed)?;
        }
        _ => return Err(CloudFileError::UnknownFormat { path: path.to_owned() }),
    }
    if points == 0 {
        return Err(CloudFileError::Empty { path: path.to_owned() });
    }
    Ok(())
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

fn ply_without_faces(path: &Path) -> bool {
    const LONGEST_HEADER: u64 = 1 << 16;
    let mut start = Vec::new();
    let read =
        crate::base::files::open(path).and_then(|file| file.take(LONGEST_HEADER).read_to_end(&mut start));
    let Some(end) = start.windows(10).position(|window| window == b"end_header") else { return false };
    let header = String::from_utf8_lossy(&start[..end]);
    let faces = header.lines().find_map(|line| line.trim().strip_prefix("element face"));
    read.is_ok() && faces.is_none_or(|count| count.trim() == "0")
}

/// Numbers of a point, as files name them.
const NAMES: [&str; 9] = ["x", "y", "z", "vp_x", "vp_y", "vp_z", "timestamp", "time", "gps_time"];

/// Which of the numbers a property is; other programs write some of them in their own way.
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
