//! Mesh files: OBJ, PLY, STL, OFF and glTF to triangles in metres with z up.
//!
//! None of the formats but glTF states its unit or its up axis. Unless the user states them, a file is read
//! as metres, z up (glTF as its standard says: y up), and a size that no building has is refused, in any format.

mod finish;
mod gltf;
mod obj;
mod off;
mod ply;
mod polygon;
mod stl;
mod unit;

pub(super) use finish::single_step;
pub(super) use ply::{Passed, element_fault, header_fault, makes_surface, whole_number, with_numbers};
pub use unit::MeshUnit;
pub(crate) use unit::{UNITS, plausible_units};

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::{Mesh, MeshError};
use crate::base::files::ending;
use crate::world::local_origin::LocalOrigin;

/// The axis of a mesh file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// x right or ahead, y left or ahead, z up: not turned.
    Z,
    /// As in glTF and most graphics programs: (x, y, z) of the file becomes (x, -z, y).
    Y,
}

/// A mesh and what deserves a second look.
#[derive(Clone, Debug)]
pub struct LoadedMesh {
    /// The mesh, metres, z up, around its local origin.
    pub mesh: Mesh,
    /// Where the mesh's own frame begins in that of the file.
    pub origin: LocalOrigin,
    /// The unit that was read.
    pub unit: MeshUnit,
    /// Whether the user or a comment of the file states it.
    pub is_unit_stated: bool,
    /// Doubts about the file that the user can settle: dropped triangles, an unusual orientation.
    pub warnings: Vec<String>,
}

/// Endings of the files that can be read.
pub const MESH_ENDINGS: &str = ".obj, .ply, .stl, .gltf, .glb, .off";

/// Reads a mesh file; the name's ending says which format. `unit` and `up` are what the user stated.
///
/// # Errors
/// A file that cannot be read, is malformed (with line, byte or element), holds no triangle with an area, or its
/// size is implausible while the user did not state the unit.
pub fn load_mesh(
    path: &Path,
    unit: Option<MeshUnit>,
    up: Option<UpAxis>,
) -> Result<LoadedMesh, MeshFileError> {
    let bytes = crate::base::files::read(path)
        .map_err(|source| MeshFileError::Unreadable { path: path.to_owned(), source })?;
    let ending = ending(path);
    let soup = match ending.as_str() {
        "obj" => obj::read(&bytes),
        "ply" => ply::read(&bytes),
        "stl" => stl::read(&bytes),
        "off" => off::read(&bytes),
        "gltf" | "glb" => gltf::read(&bytes, path.parent().unwrap_or(Path::new(""))),
        _ => return Err(MeshFileError::UnknownFormat { path: path.to_owned() }),
    };
    let soup = soup.map_err(|fault| MeshFileError::Malformed { path: path.to_owned(), fault })?;
    let native_up = if ending.starts_with("gl") { UpAxis::Y } else { UpAxis::Z };
    finish::finish(path, soup, finish::Stated { unit, up, native_up })
}

/// Triangles as a file gives them: its own unit and axes.
#[derive(Debug, Default)]
struct Soup {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Which of the triangles are polygons of more than three corners.
    fans: Vec<polygon::Fan>,
    /// Faces of fewer than three corners.
    short_faces: usize,
    /// As a comment of the file states it.
    unit: Option<MeshUnit>,
    /// Coarsest step of coordinates that are stored in 32 bits, and where it is; 0 where none are.
    single: [f64; 2],
}

/// A coordinate; one that is not finite is read as it is, and the triangles that it spoils are dropped.
fn coordinate(word: &str, line: usize) -> Result<f64, Fault> {
    number(word).ok_or_else(|| {
        let comma = if word.contains(',') { ": decimals follow a point, not a comma" } else { "" };
        Fault::line(line, format!("{word:?} where a coordinate is expected{comma}"))
    })
}

/// A number as programs print it; those of Windows print `-nan(ind)`.
fn number(word: &str) -> Option<f64> {
    let unsigned = word.trim_start_matches(['+', '-']);
    let is_nan = unsigned.get(..3).is_some_and(|start| start.eq_ignore_ascii_case("nan"));
    if is_nan { Some(f64::NAN) } else { word.parse().ok() }
}

/// What is wrong in a file, and where.
#[derive(Debug, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct Fault {
    /// Line, byte or element.
    place: String,
    /// What was found and what was expected.
    reason: String,
}

impl Fault {
    pub(super) fn line(line: usize, reason: impl Into<String>) -> Self {
        Self { place: format!("line {line}"), reason: reason.into() }
    }

    pub(super) fn byte(byte: usize, reason: impl Into<String>) -> Self {
        Self { place: format!("byte {byte}"), reason: reason.into() }
    }

    pub(super) fn at(place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { place: place.into(), reason: reason.into() }
    }
}

/// Why a file is no mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The system does not give it.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The name says no known format.
    #[error("{}: no mesh format by its name; known are {MESH_ENDINGS}", path.display())]
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
    /// Well-formed, but no mesh.
    #[error("{}: {source}", path.display())]
    NoMesh {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: MeshError,
    },
    /// Its size fits no scene in metres.
    #[error(
        "{}: the mesh is {:.6} x {:.6} x {:.6} units large, which looks like no scene; {stated}",
        path.display(), extent_units[0], extent_units[1], extent_units[2]
    )]
    UnitUnclear {
        /// The file.
        path: PathBuf,
        /// Extent in the file's own units.
        extent_units: [f64; 3],
        /// What the file or its format says of the unit.
        stated: String,
    },
}

#[cfg(test)]
mod tests;
