//! Any poses, no structure of a path: every ray of every pose on its own, in blocks of elements.
//!
//! Two steps. First f32: the beams of a column are one fan, and a fan crosses the six faces of the box in runs, so that
//! the ends of a block of beams say which faces the block can hit; where it crosses a face takes three fused
//! multiplications and a division. Each place comes with a bound of its error (`view.rs`), and a place that is further
//! than that from every voxel's face is what exact arithmetic would give. Second, whatever is nearer is left to the f64
//! definition (`brute.rs`), ray by ray: about one ray in five thousand. So every bit of the result is the definition's.

mod ends;
mod sweep;
mod view;

use super::elements::WIDTH;
use super::{BoxPose, PublishedBox, brute};
use crate::base::instructions::Instructions;
use view::View;

/// What is prepared once per experiment.
#[derive(Clone, Debug)]
pub(super) struct Faces {
    /// Faces of the box; face `2 * axis + side` lies at the low end of an axis (side 0) or at the high end (side 1).
    faces: [Face; 6],
    /// Voxels along each edge.
    cells: [usize; 3],
    /// Sines and cosines of the azimuths of a pattern that has not turned, filled up to whole blocks with the last one.
    azimuths: [Vec<f64>; 2],
    columns: usize,
    /// Sines and cosines of the elevations, filled up to whole blocks with the last beam.
    elevations: [Vec<f64>; 2],
    /// Tangents of the same.
    tangents: Vec<f32>,
    /// Tangents where the blocks begin, and of the last beam.
    ends: Vec<f32>,
    /// Largest size of a tangent.
    steepest: f64,
    beams: usize,
}

/// The voxels along one face of the box, in rows.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Axes across which the face lies, along its rows, and from row to row.
    axes: [usize; 3],
    /// Number of its first voxel among those of all faces.
    base: usize,
}

impl Faces {
    /// None where numbers would not fit an f32: extremely many voxels, beams that are almost upright.
    pub(crate) fn new(simulator: &PublishedBox) -> Option<Self> {
        const MOST_CELLS: usize = 1 << 11;
        const STEEPEST: f64 = 8.0;
        let cells = simulator.cells;
        let beams = simulator.elevations.len();
        let columns = simulator.experiment.azimuths;
        let beam = |part: fn(&[f64; 2]) -> f64| {
            let column =
                (0..beams.next_multiple_of(WIDTH)).map(|at| &simulator.elevations[at.min(beams - 1)]);
            column.map(part).collect::<Vec<f64>>()
        };
        let azimuth = |part: fn((f64, f64)) -> f64| {
            let row = (0..columns.next_multiple_of(WIDTH)).map(|at| at.min(columns - 1));
            row.map(|at| part(brute::azimuth_rad(simulator, 0.0, at).sin_cos())).collect::<Vec<f64>>()
        };
        let tangents = beam(|[sin, cos]| sin / cos);
        let steepest = tangents.iter().fold(0.0_f64, |most, tangent| most.max(tangent.abs()));
        if cells.iter().any(|cells| *cells > MOST_CELLS) || steepest > STEEPEST {
            return None;
        }
        let tangents: Vec<f32> = tangents.iter().map(|tangent| *tangent as f32).collect();
        let mut base = 0;
        let faces = std::array::from_fn(|face| {
            let axes = [[0, 1, 2], [1, 0, 2], [2, 0, 1]][face / 2];
            let face = Face { axes, base };
            base += cells[axes[1]] * cells[axes[2]];
            face
        });
        Some(Self {
            faces,
            cells,
            azimuths: [azimuth(|(sin, _)| sin), azimuth(|(_, cos)| cos)],
            columns,
            elevations: [beam(|[sin, _]| *sin), beam(|[_, cos]| *cos)],
            ends: tangents.iter().step_by(WIDTH).chain(tangents.last()).copied().collect(),
            tangents,
            steepest,
            beams,
        })
    }

    /// Sine and cosine of an azimuth as the definition has them.
    fn azimuth(&self, simulator: &PublishedBox, pose: &BoxPose, azimuth: usize) -> (f64, f64) {
        if pose.turn == 0.0 {
            (self.azimuths[0][azimuth], self.azimuths[1][azimuth])
        } else {
            brute::azimuth_rad(simulator, pose.turn, azimuth).sin_cos()
        }
    }

    /// Voxels of all faces, each face's own.
    fn voxels(&self) -> usize {
        let [nx, ny, nz] = self.cells;
        2 * (nx * ny + nx * nz + ny * nz)
    }

    /// Bitmap over the whole grid of what is marked.
    fn bitmap(&self, marks: &[u8]) -> Vec<u64> {
        let [nx, ny, nz] = self.cells;
        let mut bitmap = vec![0u64; (nx * ny * nz).div_ceil(64)];
        for (face, Face { axes: [axis, first, second], base }) in self.faces.iter().enumerate() {
            let mut cell = [0; 3];
            cell[*axis] = face % 2 * (self.cells[*axis] - 1);
            let rows = marks[*base..].chunks_exact(self.cells[*first]).take(self.cells[*second]);
            for (row, marks) in rows.enumerate() {
                cell[*second] = row;
                let start = cell[0] + nx * (cell[1] + ny * cell[2]);
                let step = [1, nx, nx * ny][*first];
                for (eight, bytes) in marks.chunks(8).enumerate() {
                    let mut padded = [0; 8];
                    padded[..bytes.len()].copy_from_slice(bytes);
                    let at = start + 8 * eight * step;
                    let mut seen = u64::from_le_bytes(padded);
                    if step == 1 {
                        // gathers the lowest bits of eight bytes in the uppermost byte
                        let bits = seen.wrapping_mul(0x0102_0408_1020_4080) >> 56;
                        bitmap[at / 64] |= bits << (at % 64);
                        if at % 64 > 56 && at / 64 + 1 < bitmap.len() {
                            bitmap[at / 64 + 1] |= bits >> (64 - at % 64);
                        }
                        continue;
                    }
                    while seen != 0 {
                        let index = at + seen.trailing_zeros() as usize / 8 * step;
                        seen &= seen - 1;
                        bitmap[index / 64] |= 1 << (index % 64);
                    }
                }
            }
        }
        bitmap
    }
}

/// Bitmap of what a sensor sees from poses, and the number of rays that the quirk lost.
pub(super) fn see(
    simulator: &PublishedBox,
    faces: &Faces,
    poses: &[BoxPose],
    instructions: Instructions,
) -> (Vec<u64>, u64) {
    let mut marks = vec![0; sweep::marks(faces)];
    let mut left = Left::default();
    let mut scratch = sweep::Scratch::new(faces);
    for pose in poses {
        match View::new(simulator, faces, pose) {
            Some(view) => sweep::run(faces, &view, &mut scratch, &mut marks, &mut left, instructions),
            None => left
                .rays
                .extend((0..faces.columns).flat_map(|at| (0..faces.beams).map(move |beam| (at, beam)))),
        }
        left.ends.push(left.rays.len());
    }
    let mut bitmap = faces.bitmap(&marks);
    let mut start = 0;
    for (pose, end) in poses.iter().zip(&left.ends) {
        for (azimuth, beam) in &left.rays[start..*end] {
            let direction =
                brute::direction_at(simulator, pose, faces.azimuth(simulator, pose, *azimuth), *beam);
            match brute::voxel(simulator, pose.origin_m, direction) {
                Some(index) => bitmap[index / 64] |= 1 << (index % 64),
                None => left.lost += 1,
            }
        }
        start = *end;
    }
    (bitmap, left.lost)
}

/// What only the definition can decide.
#[derive(Default)]
struct Left {
    /// How many rays the quirk lost.
    lost: u64,
    /// Azimuth and beam.
    rays: Vec<(usize, usize)>,
    /// Where each pose's rays end.
    ends: Vec<usize>,
}
