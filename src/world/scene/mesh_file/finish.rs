//! From the triangles of a file to a mesh in metres with z up, with every doubt about it.

use std::path::Path;

use glam::DVec3;

use super::{Fault, LoadedMesh, MeshFileError, MeshUnit, Soup, UpAxis};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Mesh;

/// Largest extent that is believed without a stated unit, m.
const LARGEST_EXTENT_M: f64 = 1000.0;
/// Smallest such extent, m.
const SMALLEST_EXTENT_M: f64 = 0.5;
/// Beyond this the single precision of the ray caster is coarser than half a millimetre, m.
const PRECISE_EXTENT_M: f64 = 8000.0;
/// Steps of stored coordinates up to this are as good as none, m.
const FINE_STEP_M: f64 = 1e-3;

/// Share of its step by which a printed number may be off the 32-bit float that it comes from.
const PRINTED_OFF: f64 = 0.02;

/// What the user states, and what the format does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stated {
    pub unit: Option<MeshUnit>,
    pub up: Option<UpAxis>,
    pub native_up: UpAxis,
}

pub(super) fn finish(path: &Path, mut soup: Soup, stated: Stated) -> Result<LoadedMesh, MeshFileError> {
    let mut warnings = Vec::new();
    let mut say = |words: String| warnings.push(format!("{}: {words}", path.display()));
    let unit = stated.unit.or(soup.unit).unwrap_or(MeshUnit::Metre);
    let scale = unit.metres();
    let crossing = soup.cut_polygons();
    if crossing.polygons > 0 {
        let [area, read] = [crossing.area, crossing.read].map(|area| area * scale * scale);
        say(format!(
            "{} polygons cross themselves: {area:.2} m² by their edges, read as {read:.2} m² of triangles",
            crossing.polygons
        ));
    }
    if soup.short_faces > 0 {
        say(format!("{} faces of fewer than 3 corners left out", soup.short_faces));
    }
    let endless = soup.drop_endless();
    if endless > 0 && soup.triangles.is_empty() {
        let reason =
            format!("no triangle is left: {endless} have a corner that is not finite (NaN or infinite)");
        return Err(MeshFileError::Malformed {
            path: path.to_owned(),
            fault: Fault::at("triangles", reason),
        });
    }
    if endless > 0 {
        say(format!("{endless} triangles with a corner that is not finite (NaN or infinite) dropped"));
    }
    for vertex in &mut soup.vertices {
        *vertex *= scale;
        if stated.up.unwrap_or(stated.native_up) == UpAxis::Y {
            *vertex = DVec3::new(vertex.x, -vertex.z, vertex.y);
        }
    }
    let [step_units, at_units] = soup.single_step();
    let step_m = step_units * scale;
    if step_m > FINE_STEP_M {
        say(format!(
            "its coordinates are 32-bit floats, in steps of {step_m} m at {:.1e} m: surfaces are that far off; write them \
             with 64 bits, or nearer to the origin",
            at_units * scale
        ));
    }
    let origin = soup.bounds().map_or(LocalOrigin::default(), LocalOrigin::of_box);
    soup.vertices.iter_mut().for_each(|vertex| *vertex = origin.local(*vertex));
    let mesh = Mesh::new(soup.vertices, soup.triangles)
        .map_err(|source| MeshFileError::NoMesh { path: path.to_owned(), source })?;
    let extent = mesh.bounds_m()[1] - mesh.bounds_m()[0];
    let largest_m = extent.max_element();
    let plausible = (SMALLEST_EXTENT_M..=LARGEST_EXTENT_M).contains(&largest_m);
    if stated.unit.is_none() && !plausible {
        let extent_units = (extent / scale).to_array();
        let stated = match (soup.unit, stated.native_up) {
            (Some(unit), _) => format!("the file states {} as its unit", unit.name()),
            (None, UpAxis::Y) => "glTF is in metres by its standard".to_owned(),
            (None, UpAxis::Z) => "the file states no unit".to_owned(),
        };
        return Err(MeshFileError::UnitUnclear { path: path.to_owned(), extent_units, stated });
    }
    if let (None, Some(unit)) = (stated.unit, soup.unit)
        && unit != MeshUnit::Metre
    {
        say(format!("read in {}, as the file itself states (--mesh-unit says another)", unit.name()));
    }
    if mesh.degenerate() > 0 {
        let area = match mesh.degenerate_area_m2() {
            gone_m2 if gone_m2 >= 0.5e-4 => format!(" ({gone_m2:.4} m² in all)"),
            _ => String::new(),
        };
        say(format!("{} triangles without area dropped{area}", mesh.degenerate()));
    }
    if stated.up.is_none() && stated.native_up == UpAxis::Z && extent.y < 0.8 * extent.x.min(extent.z) {
        say(format!(
            "the mesh is {:.2} x {:.2} x {:.2} m, flattest along y: if y points up in this file, pass --up y",
            extent.x, extent.y, extent.z
        ));
    }
    if largest_m > PRECISE_EXTENT_M {
        say(format!(
            "the mesh is {largest_m:.0} m wide; ray casting in single precision is coarser than 0.5 mm there"
        ));
    }
    Ok(LoadedMesh { mesh, origin, unit, is_unit_stated: stated.unit.or(soup.unit).is_some(), warnings })
}

impl Soup {
    /// Drops triangles with a corner that is no place, and counts them.
    fn drop_endless(&mut self) -> usize {
        if self.vertices.iter().all(|vertex| vertex.is_finite()) {
            return 0;
        }
        let vertices = &self.vertices;
        // a corner beyond the vertices is for the mesh to name
        let is_endless =
            |corner: &u32| vertices.get(*corner as usize).is_some_and(|vertex| !vertex.is_finite());
        let before = self.triangles.len();
        self.triangles.retain(|corners| !corners.iter().any(is_endless));
        for vertex in self.vertices.iter_mut().filter(|vertex| !vertex.is_finite()) {
            *vertex = DVec3::ZERO; // no triangle names it any more
        }
        before - self.triangles.len()
    }

    /// Box around the corners of the triangles.
    fn bounds(&self) -> Option<[DVec3; 2]> {
        let corners =
            self.triangles.iter().flatten().filter_map(|corner| self.vertices.get(*corner as usize));
        corners.fold(None, |bounds, corner| {
            let [low, high] = bounds.unwrap_or([*corner; 2]);
            Some([low.min(*corner), high.max(*corner)])
        })
    }

    /// Says that every vertex is stored as 32-bit floats.
    pub(super) fn note_single_precision(&mut self) {
        let finite = self.vertices.iter().filter(|vertex| vertex.is_finite());
        let largest = finite.map(|vertex| vertex.abs().max_element()).fold(0.0, f64::max);
        self.note_single_step(largest, 1.0);
    }

    /// Says that some coordinates, the largest of them `at`, are stored as 32-bit floats, to be multiplied by `scale`.
    pub(super) fn note_single_step(&mut self, at: f64, scale: f64) {
        let step = single_step(at) * scale;
        if step > self.single[0] {
            self.single = [step, at * scale];
        }
    }

    /// The coarsest step of 32-bit coordinates and where it is, in the file's units. Text shows it too: numbers printed from
    /// 32-bit floats are whole multiples of their step.
    fn single_step(&self) -> [f64; 2] {
        if self.single[0] > 0.0 {
            return self.single;
        }
        let (mut coarsest, mut is_fractional) = ([0.0, 0.0], false);
        for axis in 0..3 {
            let used = || self.vertices.iter().map(|vertex| vertex[axis]);
            let at = used().map(f64::abs).fold(0.0, f64::max);
            let step = single_step(at);
            if step <= FINE_STEP_M {
                continue; // printed with fewer digits than it has
            }
            if !used().all(|value| (f64::from(value as f32) - value).abs() <= PRINTED_OFF * step) {
                return [0.0, 0.0];
            }
            // whole numbers are what a drawing has too
            is_fractional |= used().any(|value| value.fract() != 0.0);
            if step > coarsest[0] {
                coarsest = [step, at];
            }
        }
        if is_fractional { coarsest } else { [0.0, 0.0] }
    }
}

/// From a number of this size to the next that 32 bits hold.
pub(crate) fn single_step(at: f64) -> f64 {
    let at = (at as f32).abs();
    if at.is_finite() { f64::from(at.next_up()) - f64::from(at) } else { 0.0 }
}
