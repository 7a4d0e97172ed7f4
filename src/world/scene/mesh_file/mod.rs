//! Mesh files: OBJ, PLY, STL and glTF to triangles in metres with z up.
//!
//! None of the formats but glTF says what its unit is or which way is up. Without word from the user a file is taken
//! as metres, z up (glTF as its standard says: y up), and a size that no building has is refused.

mod gltf;
mod obj;
mod ply;
mod stl;

pub(super) use ply::{Passed, element_fault, header_fault, whole_number};

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::{Mesh, MeshError};
use crate::base::files::ending;

/// Length unit of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshUnit {
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
}

impl MeshUnit {
    /// Metres per unit.
    pub(crate) fn metres(self) -> f64 {
        match self {
            MeshUnit::Metre => 1.0,
            MeshUnit::Centimetre => 0.01,
            MeshUnit::Millimetre => 0.001,
        }
    }
}

/// The axis of a mesh file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// x right or ahead, y left or ahead, z up: taken as it is.
    Z,
    /// As in glTF and most graphics programs: (x, y, z) of the file becomes (x, -z, y).
    Y,
}

/// A mesh and what deserves a second look.
#[derive(Clone, Debug)]
pub struct LoadedMesh {
    /// The mesh, metres, z up.
    pub mesh: Mesh,
    /// Doubts about the file that the user can settle: dropped triangles, an unusual orientation.
    pub warnings: Vec<String>,
}

/// Largest extent that is believed without a stated unit, m.
const LARGEST_EXTENT_M: f64 = 1000.0;
/// Smallest such extent, m.
const SMALLEST_EXTENT_M: f64 = 0.5;
/// Beyond this the single precision of the ray caster is coarser than half a millimetre, m.
const PRECISE_EXTENT_M: f64 = 8000.0;

/// Endings of the files that can be read.
pub const MESH_ENDINGS: &str = ".obj, .ply, .stl, .gltf, .glb";

/// Reads a mesh file; the name's ending says which format. `unit` and `up` are what the user stated.
///
/// # Errors
/// A file that cannot be read, is malformed (with line, byte or element), holds no triangle with an area, or whose
/// size is implausible while nobody stated the unit.
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
        "gltf" | "glb" => gltf::read(&bytes, path.parent().unwrap_or(Path::new(""))),
        _ => return Err(MeshFileError::UnknownFormat { path: path.to_owned() }),
    };
    let soup = soup.map_err(|fault| MeshFileError::Malformed { path: path.to_owned(), fault })?;
    let native_up = if ending.starts_with("gl") { UpAxis::Y } else { UpAxis::Z };
    finish(path, soup, unit, up, native_up)
}

fn finish(
    path: &Path,
    mut soup: Soup,
    unit: Option<MeshUnit>,
    up: Option<UpAxis>,
    native_up: UpAxis,
) -> Result<LoadedMesh, MeshFileError> {
    let scale = unit.unwrap_or(MeshUnit::Metre).metres();
    for vertex in &mut soup.vertices {
        *vertex *= scale;
        if up.unwrap_or(native_up) == UpAxis::Y {
            *vertex = DVec3::new(vertex.x, -vertex.z, vertex.y);
        }
    }
    let mesh = Mesh::new(soup.vertices, soup.triangles)
        .map_err(|source| MeshFileError::NoMesh { path: path.to_owned(), source })?;
    let extent = mesh.bounds_m()[1] - mesh.bounds_m()[0];
    let largest_m = extent.max_element();
    let plausible = (SMALLEST_EXTENT_M..=LARGEST_EXTENT_M).contains(&largest_m);
    if unit.is_none() && native_up == UpAxis::Z && !plausible {
        let extent_units = extent.to_array();
        return Err(MeshFileError::UnitUnclear { path: path.to_owned(), extent_units });
    }
    let mut warnings = Vec::new();
    if mesh.degenerate() > 0 {
        warnings.push(format!("{}: {} triangles without area dropped", path.display(), mesh.degenerate()));
    }
    if up.is_none() && native_up == UpAxis::Z && extent.y < 0.8 * extent.x.min(extent.z) {
        warnings.push(format!(
            "{}: the mesh is {:.2} x {:.2} x {:.2} m, flattest along y: if y points up in this file, pass --up y",
            path.display(),
            extent.x,
            extent.y,
            extent.z
        ));
    }
    if largest_m > PRECISE_EXTENT_M {
        warnings.push(format!(
            "{}: the mesh is {largest_m:.0} m wide; ray casting in single precision is coarser than 0.5 mm there",
            path.display()
        ));
    }
    Ok(LoadedMesh { mesh, warnings })
}

/// Triangles as a file gives them: its own unit and axes.
#[derive(Debug, Default)]
struct Soup {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// A polygon as a fan of triangles.
    fn push_polygon(&mut self, corners: &[u32]) {
        for pair in corners.windows(2).skip(1) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }
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
        "{}: the mesh is {:.6} x {:.6} x {:.6} units large, which looks like no scene in metres; nobody stated the unit of the file",
        path.display(), extent_units[0], extent_units[1], extent_units[2]
    )]
    UnitUnclear {
        /// The file.
        path: PathBuf,
        /// Extent in the file's own units.
        extent_units: [f64; 3],
    },
}

#[cfg(test)]
mod tests;
